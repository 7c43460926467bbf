#include "core/sensor/deskew.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "core/base/check.h"

namespace gem {
namespace {

constexpr double kKnotDistance_ns = 1e6;

/// T_S(stamp)_S(knot) as the 12 numbers that a point needs.
using Knot = Eigen::Matrix<float, 3, 4>;

/// The transforms at equal distances over the span, both ends included.
std::vector<Knot> KnotsOver(const TimeSpan& span, std::size_t num_intervals,
                            const Trajectory<Odom, Base>& trajectory,
                            const Pose<Sensor, Odom>& T_Sstamp_O, const Pose<Base, Sensor>& T_B_S) {
  std::vector<Knot> knots;
  knots.reserve(num_intervals + 1);
  const double length_ns = static_cast<double>(span.end_ns - span.begin_ns);
  for (std::size_t i = 0; i <= num_intervals; ++i) {
    const auto offset_ns = static_cast<std::int64_t>(length_ns * static_cast<double>(i) /
                                                     static_cast<double>(num_intervals));
    const auto T_O_B = trajectory.At(std::min(span.begin_ns + offset_ns, span.end_ns));
    GEM_CHECK(T_O_B.has_value());  // the span is covered
    const Pose<Sensor, Sensor> T = T_Sstamp_O * (*T_O_B * T_B_S);
    Knot& knot = knots.emplace_back();
    knot.leftCols<3>() = T.matrix().cast<float>();
    knot.col(3) = T.translation().cast<float>();
  }
  return knots;
}

}  // namespace

TimeSpan SpanOf(std::int64_t stamp_ns, std::span<const float> offsets_s) {
  if (offsets_s.empty()) return {stamp_ns, stamp_ns};
  const auto [min, max] = std::minmax_element(offsets_s.begin(), offsets_s.end());
  // Truncated towards the stamp.
  const auto whole_us_in_ns = [](float offset_s) {
    return 1000 * static_cast<std::int64_t>(double{offset_s} * 1e6);
  };
  return {stamp_ns + std::min<std::int64_t>(0, whole_us_in_ns(*min)),
          stamp_ns + std::max<std::int64_t>(0, whole_us_in_ns(*max))};
}

bool Covers(const Trajectory<Odom, Base>& trajectory, const TimeSpan& span) {
  return !trajectory.empty() && trajectory.front().stamp_ns <= span.begin_ns &&
         trajectory.back().stamp_ns >= span.end_ns;
}

void Deskew(const Trajectory<Odom, Base>& trajectory, std::int64_t stamp_ns,
            const Pose<Base, Sensor>& T_B_S, std::span<const float> offsets_s,
            std::span<ScanPoint> points) {
  GEM_CHECK(offsets_s.size() == points.size());
  const TimeSpan span = SpanOf(stamp_ns, offsets_s);
  GEM_CHECK(Covers(trajectory, span));
  const double length_ns = static_cast<double>(span.end_ns - span.begin_ns);
  if (length_ns == 0) return;

  const auto num_intervals = static_cast<std::size_t>(std::ceil(length_ns / kKnotDistance_ns));
  const Pose<Sensor, Odom> T_Sstamp_O = (*trajectory.At(stamp_ns) * T_B_S).Inverse();
  const std::vector<Knot> knots = KnotsOver(span, num_intervals, trajectory, T_Sstamp_O, T_B_S);

  const float begin_s = static_cast<float>(static_cast<double>(span.begin_ns - stamp_ns) * 1e-9);
  const float knots_per_s =
      static_cast<float>(static_cast<double>(num_intervals) * 1e9 / length_ns);
  for (std::size_t i = 0; i < points.size(); ++i) {
    ScanPoint& point = points[i];
    const float place = std::max(0.0f, (offsets_s[i] - begin_s) * knots_per_s);
    const std::size_t before = std::min(static_cast<std::size_t>(place), num_intervals - 1);
    const float fraction = std::min(place - static_cast<float>(before), 1.0f);
    const Knot T = knots[before] + fraction * (knots[before + 1] - knots[before]);
    const Eigen::Vector3f p_S(point.x_m, point.y_m, point.z_m);
    const Eigen::Vector3f moved = T.leftCols<3>() * p_S + T.col(3);
    point.x_m = moved.x();
    point.y_m = moved.y();
    point.z_m = moved.z();
  }
}

}  // namespace gem
