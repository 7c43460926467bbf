#include "client/evaluation/svg_plot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace gem::evaluation {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;

TEST(Ticks, AreRoundNumbersThatCoverTheValues) {
  EXPECT_THAT(Ticks(0, 10, 5), ElementsAre(0, 2, 4, 6, 8, 10));
  EXPECT_THAT(Ticks(-0.3, 0.9, 4), ElementsAre(-0.5, 0, 0.5, 1.0));
  EXPECT_THAT(Ticks(3, 397, 4), ElementsAre(0, 100, 200, 300, 400));
}

TEST(DrawSvg, PutsPointsWhereTheAxesSay) {
  const Plot plot{.name = "p", .title = "T & U", .series = {{"a", {0, 10}, {0, 10}}}};
  const std::string svg = DrawSvg(plot);
  // The plot's area goes from (72, 40) to (590, 364); y grows upwards.
  EXPECT_THAT(svg, HasSubstr("72.0,364.0 590.0,40.0"));
  EXPECT_THAT(svg, HasSubstr("T &amp; U"));
}

TEST(DrawSvg, LeavesOutWhatIsNotFinite) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Plot plot{.series = {{"a", {0, 1, 2}, {0, nan, 4}}}};
  EXPECT_THAT(DrawSvg(plot), Not(HasSubstr("nan")));
}

TEST(DrawSvg, OfNothingIsAnEmptyFrame) { EXPECT_THAT(DrawSvg({}), HasSubstr("</svg>")); }

}  // namespace
}  // namespace gem::evaluation
