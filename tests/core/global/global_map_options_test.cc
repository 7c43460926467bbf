#include "core/global/global_map_options.h"

#include <gtest/gtest.h>

#include <limits>

namespace gem {
namespace {

TEST(GlobalMapOptions, DefaultsAreValid) { EXPECT_TRUE(Validate(GlobalMapOptions()).ok()); }

TEST(GlobalMapOptions, TheRefusalNamesFieldValueAndRange) {
  GlobalMapOptions options;
  options.cell_size_m = -1;
  EXPECT_EQ(Validate(options).message(), "map.cell_size_m is -1, want [0.01, 10]");
}

TEST(GlobalMapOptions, BoundsThemselvesAreInRange) {
  GlobalMapOptions options;
  options.cell_size_m = 0.01f;
  options.submap_length_m = 0.1f;
  options.gate_sigmas = 100;
  options.compose_threads = 64;
  options.merge_overlap_min = 1;
  options.merge_fuse_time_s_max = 0;
  options.merge_height_difference_m_max = 1000;
  options.odometry_poses_max = 2;
  EXPECT_TRUE(Validate(options).ok()) << Validate(options);
}

struct BadOption {
  const char* field;
  void (*spoil)(GlobalMapOptions&);
};

class BadGlobalMapOption : public testing::TestWithParam<BadOption> {};

TEST_P(BadGlobalMapOption, IsRefusedByName) {
  GlobalMapOptions options;
  GetParam().spoil(options);
  const absl::Status status = Validate(options);
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(status.message().find(std::string("map.") + GetParam().field + " is "),
            absl::string_view::npos)
      << status;
}

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

INSTANTIATE_TEST_SUITE_P(
    EachField, BadGlobalMapOption,
    testing::Values(
        BadOption{"cell_size_m", [](GlobalMapOptions& o) { o.cell_size_m = kNaN; }},
        BadOption{"cell_size_m", [](GlobalMapOptions& o) { o.cell_size_m = 10.1f; }},
        BadOption{"submap_length_m", [](GlobalMapOptions& o) { o.submap_length_m = 0; }},
        BadOption{"traversability_free", [](GlobalMapOptions& o) { o.traversability_free = 1; }},
        BadOption{"gate_sigmas", [](GlobalMapOptions& o) { o.gate_sigmas = 0; }},
        BadOption{"compose_threads", [](GlobalMapOptions& o) { o.compose_threads = 0; }},
        BadOption{"merge_overlap_min", [](GlobalMapOptions& o) { o.merge_overlap_min = 0; }},
        BadOption{"merge_fuse_time_s_max",
                  [](GlobalMapOptions& o) { o.merge_fuse_time_s_max = -1; }},
        BadOption{"merge_height_difference_m_max",
                  [](GlobalMapOptions& o) { o.merge_height_difference_m_max = kNaN; }},
        BadOption{"odometry_poses_max", [](GlobalMapOptions& o) { o.odometry_poses_max = 1; }}));

}  // namespace
}  // namespace gem
