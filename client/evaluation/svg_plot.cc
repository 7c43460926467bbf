#include "client/evaluation/svg_plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_replace.h"

namespace gem::evaluation {
namespace {

constexpr double kWidth = 800, kHeight = 420;
constexpr double kLeft = 72, kRight = 210, kTop = 40, kBottom = 56;
constexpr double kPlotWidth = kWidth - kLeft - kRight;
constexpr double kPlotHeight = kHeight - kTop - kBottom;
// Told apart by people who see few colours, too.
constexpr std::array<const char*, 8> kColors = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                                "#e69f00", "#56b4e9", "#000000", "#999999"};

struct Interval {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  void Add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
  // Room above the highest value; zero as the floor where values are not far from it.
  Interval Rounded() const {
    if (low > high) return {0, 1};
    Interval rounded = *this;
    if (rounded.low > 0 && rounded.low < 0.5 * rounded.high) rounded.low = 0;
    if (rounded.low == rounded.high) rounded.high += std::max(1.0, std::fabs(rounded.high));
    const std::vector<double> ticks = Ticks(rounded.low, rounded.high, 6);
    return {ticks.front(), ticks.back()};
  }
};

std::string Escape(const std::string& text) {
  return absl::StrReplaceAll(text, {{"&", "&amp;"}, {"<", "&lt;"}, {">", "&gt;"}});
}

std::string Text(double x, double y, const char* anchor, const std::string& text,
                 const char* more = "") {
  return absl::StrFormat("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"%s\" %s>%s</text>\n", x, y,
                         anchor, more, Escape(text));
}

std::string Line(double x0, double y0, double x1, double y1, const char* color) {
  return absl::StrFormat("<line x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\" stroke=\"%s\"/>\n",
                         x0, y0, x1, y1, color);
}

class Canvas {
 public:
  explicit Canvas(const Plot& plot) : plot_(plot) {
    for (const Series& series : plot.series) {
      for (std::size_t i = 0; i < series.x.size(); ++i) {
        if (!Finite(series, i)) continue;
        x_.Add(series.x[i]);
        y_.Add(series.y[i]);
      }
    }
    x_ = x_.Rounded();
    y_ = y_.Rounded();
  }

  std::string Axes() const {
    std::string svg;
    for (const double tick : Ticks(x_.low, x_.high, 6)) {
      const double x = X(tick);
      svg += Line(x, kTop, x, kTop + kPlotHeight, "#e5e5e5");
      svg += Text(x, kTop + kPlotHeight + 18, "middle", absl::StrFormat("%g", tick));
    }
    for (const double tick : Ticks(y_.low, y_.high, 6)) {
      const double y = Y(tick);
      svg += Line(kLeft, y, kLeft + kPlotWidth, y, "#e5e5e5");
      svg += Text(kLeft - 8, y + 4, "end", absl::StrFormat("%g", tick));
    }
    svg += Line(kLeft, kTop, kLeft, kTop + kPlotHeight, "#333333");
    svg += Line(kLeft, kTop + kPlotHeight, kLeft + kPlotWidth, kTop + kPlotHeight, "#333333");
    svg += Text(kLeft + kPlotWidth / 2, kHeight - 12, "middle", plot_.x_label);
    const std::string turned =
        absl::StrFormat("transform=\"rotate(-90 16 %.1f)\"", kTop + kPlotHeight / 2);
    svg += Text(16, kTop + kPlotHeight / 2, "middle", plot_.y_label, turned.c_str());
    svg += Text(kLeft, 22, "start", plot_.title, "font-size=\"15\" font-weight=\"bold\"");
    return svg;
  }

  std::string Curves() const {
    std::string svg;
    for (std::size_t i = 0; i < plot_.series.size(); ++i) {
      const char* color = kColors[i % kColors.size()];
      svg += plot_.points ? Dots(plot_.series[i], color) : Curve(plot_.series[i], color);
      const double y = kTop + 14 + 20 * static_cast<double>(i);
      svg +=
          absl::StrFormat("<rect x=\"%.1f\" y=\"%.1f\" width=\"12\" height=\"12\" fill=\"%s\"/>\n",
                          kLeft + kPlotWidth + 12, y - 10, color);
      svg += Text(kLeft + kPlotWidth + 30, y, "start", plot_.series[i].name);
    }
    return svg;
  }

 private:
  static bool Finite(const Series& series, std::size_t i) {
    return std::isfinite(series.x[i]) && std::isfinite(series.y[i]);
  }
  double X(double x) const { return kLeft + kPlotWidth * (x - x_.low) / (x_.high - x_.low); }
  double Y(double y) const { return kTop + kPlotHeight * (y_.high - y) / (y_.high - y_.low); }

  std::string Curve(const Series& series, const char* color) const {
    std::string svg = absl::StrFormat(
        "<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"1.5\" points=\"", color);
    for (std::size_t i = 0; i < series.x.size(); ++i)
      if (Finite(series, i))
        absl::StrAppendFormat(&svg, "%.1f,%.1f ", X(series.x[i]), Y(series.y[i]));
    return svg + "\"/>\n";
  }
  std::string Dots(const Series& series, const char* color) const {
    std::string svg;
    for (std::size_t i = 0; i < series.x.size(); ++i)
      if (Finite(series, i))
        absl::StrAppendFormat(&svg, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"2\" fill=\"%s\"/>\n",
                              X(series.x[i]), Y(series.y[i]), color);
    return svg;
  }

  const Plot& plot_;
  Interval x_, y_;
};

}  // namespace

std::vector<double> Ticks(double low, double high, int count) {
  const double raw = (high - low) / std::max(count, 1);
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  double step = 10 * power;
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= raw * (1 - 1e-9)) {
      step = factor * power;
      break;
    }
  }
  const auto first = static_cast<std::int64_t>(std::floor(low / step + 1e-9));
  const auto last = static_cast<std::int64_t>(std::ceil(high / step - 1e-9));
  std::vector<double> ticks;
  for (std::int64_t i = first; i <= last; ++i) ticks.push_back(static_cast<double>(i) * step);
  return ticks;
}

std::string DrawSvg(const Plot& plot) {
  const Canvas canvas(plot);
  return absl::StrCat(
      absl::StrFormat("<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%.0f\" height=\"%.0f\" "
                      "font-family=\"sans-serif\" font-size=\"12\">\n"
                      "<rect width=\"100%%\" height=\"100%%\" fill=\"white\"/>\n",
                      kWidth, kHeight),
      canvas.Axes(), canvas.Curves(), "</svg>\n");
}

}  // namespace gem::evaluation
