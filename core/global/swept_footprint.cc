#include "core/global/swept_footprint.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace gem {
namespace {

/// Of coordinates up to 1e6 m, generously.
constexpr double kRounding_m = 1e-9;

/// On the line from p to q, p below q.
double XAt(double y_m, const Place& p, const Place& q) {
  return p.x_m + (q.x_m - p.x_m) * ((y_m - p.y_m) / (q.y_m - p.y_m));
}

}  // namespace

SweptFootprint::SweptFootprint(const Footprint& footprint, const Place& from, const Place& to,
                               const Heading& heading) {
  const double way_m = std::hypot(to.x_m - from.x_m, to.y_m - from.y_m);
  if (const auto* disc = std::get_if<Disc>(&footprint)) {
    radius_m_ = disc->radius_m;
    centers_ = {from, to};
    num_discs_ = way_m > 0 ? 2 : 1;
    // Between two discs lies a rectangle as wide as they are.
    if (way_m > 0) AddCorners({0, -radius_m_, 0, radius_m_}, from, way_m, heading);
    y_m_min_ = std::min(from.y_m, to.y_m) - radius_m_;
    y_m_max_ = std::max(from.y_m, to.y_m) + radius_m_;
    return;
  }
  AddCorners(std::get<Rectangle>(footprint), from, way_m, heading);
  const auto [lowest, highest] =
      std::minmax_element(corners_.begin(), corners_.end(),
                          [](const Place& a, const Place& b) { return a.y_m < b.y_m; });
  y_m_min_ = lowest->y_m;
  y_m_max_ = highest->y_m;
}

void SweptFootprint::AddCorners(const Rectangle& rectangle, const Place& from, double way_m,
                                const Heading& heading) {
  const auto in_G = [&](double x_m, double y_m) {
    return Place{from.x_m + heading.x * x_m - heading.y * y_m,
                 from.y_m + heading.y * x_m + heading.x * y_m};
  };
  const double front_m = rectangle.x_m_max + way_m;
  corners_ = {in_G(rectangle.x_m_min, rectangle.y_m_min), in_G(front_m, rectangle.y_m_min),
              in_G(front_m, rectangle.y_m_max), in_G(rectangle.x_m_min, rectangle.y_m_max)};
  has_corners_ = true;
}

SweptFootprint::Span SweptFootprint::SpanBetween(double low_m, double high_m) const {
  Span span{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  // Of a convex polygon the extremes lie on its edges.
  for (std::size_t i = 0; has_corners_ && i < corners_.size(); ++i) {
    Place p = corners_[i];
    Place q = corners_[(i + 1) % corners_.size()];
    if (p.y_m > q.y_m) std::swap(p, q);
    if (q.y_m < low_m || p.y_m > high_m) continue;
    span.Add(p.y_m >= low_m ? p.x_m : XAt(low_m, p, q));
    span.Add(q.y_m <= high_m ? q.x_m : XAt(high_m, p, q));
  }
  for (std::size_t i = 0; i < num_discs_; ++i) {
    const double off_m = centers_[i].y_m - std::clamp(centers_[i].y_m, low_m, high_m);
    if (std::abs(off_m) > radius_m_ + kRounding_m) continue;
    const double half_m = std::sqrt(std::max(0.0, radius_m_ * radius_m_ - off_m * off_m));
    span.Add(centers_[i].x_m - half_m);
    span.Add(centers_[i].x_m + half_m);
  }
  return span;
}

}  // namespace gem
