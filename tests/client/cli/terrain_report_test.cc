#include "client/cli/terrain_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace gem::client {
namespace {

using ::testing::HasSubstr;

const GroundSample kFree{GroundState::kFree, 1.5f, 0.0625f, 0.875f, 0.25f};
const GroundSample kHeightOnly{GroundState::kHeightOnly, 2, 0.25f, 0, std::nullopt};

TEST(ParsePlace, TakesTwoNumbers) {
  EXPECT_EQ(*ParsePlace("--path", "1.5,-2"), (Place{1.5, -2}));
  for (const char* text : {"", "1", "1,2,3", "1,x", "1;2"})
    EXPECT_THAT(std::string(ParsePlace("--path", text).status().message()),
                HasSubstr(absl::StrCat("--path has \"", text, "\", want X,Y")));
}

TEST(HeightsReport, SaysOnlyWhatIsKnown) {
  const std::vector<Place> points = {{1, 2}, {3, 4}, {-5, 6}};
  const GroundHeights heights{{kFree, GroundSample(), kHeightOnly}, {7, 8}};
  EXPECT_EQ(HeightsTable(points, heights),
            "1,2: free, height 1.500 m +- 0.250 m, traversability 0.88, slope 0.250 rad\n"
            "3,4: unknown\n"
            "-5,6: height_only, height 2.000 m +- 0.500 m\n");
  EXPECT_EQ(HeightsJson(points, heights),
            "{\"epoch\":7,\"revision\":8,\"samples\":["
            "{\"x_m\":1,\"y_m\":2,\"state\":\"free\",\"elevation_m\":1.5,\"variance_m2\":0.0625,"
            "\"traversability\":0.875,\"slope_rad\":0.25},"
            "{\"x_m\":3,\"y_m\":4,\"state\":\"unknown\",\"elevation_m\":null,\"variance_m2\":null,"
            "\"traversability\":null,\"slope_rad\":null},"
            "{\"x_m\":-5,\"y_m\":6,\"state\":\"height_only\",\"elevation_m\":2,"
            "\"variance_m2\":0.25,\"traversability\":null,\"slope_rad\":null}]}\n");
}

CheckedPath Blocked() {
  PathSample start;
  start.ground = kFree;
  PathSample end = start;
  end.distance_m = 2;
  end.position = {2, 0};
  end.worst = GroundState::kUnknown;
  end.unknown_share = 0.5f;
  return {{{start, end}, false, {{2.25, 0.25}, GroundSample(), 1}, 0}, {7, 8}};
}

TEST(PathReport, SaysHowFarItIsFreeAndWhereItIsWorst) {
  EXPECT_EQ(PathText(Blocked()),
            "not free: 0.00 of 2.00 m\n"
            "worst cell at 2.25,0.25, 2.00 m from the start: unknown\n");
  CheckedPath free = Blocked();
  free.check.free = true;
  free.check.free_distance_m = 2;
  EXPECT_THAT(PathText(free), HasSubstr("free: 2.00 m\n"));
}

TEST(PathReport, HasEverySampleInJson) {
  const std::string json = PathJson(Blocked());
  EXPECT_THAT(json, HasSubstr("{\"epoch\":7,\"revision\":8,\"free\":false,\"free_distance_m\":0,"
                              "\"worst\":{\"x_m\":2.25,\"y_m\":0.25,\"sample\":1,\"ground\":{"
                              "\"state\":\"unknown\""));
  EXPECT_THAT(json, HasSubstr("{\"distance_m\":2,\"x_m\":2,\"y_m\":0,\"ground\":{\"state\":"
                              "\"free\""));
  EXPECT_THAT(json, HasSubstr("\"worst\":\"unknown\",\"traversability_min\":0,"
                              "\"slope_rad_max\":0,\"unknown_share\":0.5}]}\n"));
}

}  // namespace
}  // namespace gem::client
