#include "core/local/local_map_options.h"

#include <gtest/gtest.h>

#include <limits>

#include "core/local/local_mapper.h"

namespace gem {
namespace {

template <typename Change>
std::string ErrorAfter(Change change) {
  LocalMapOptions options;
  change(options);
  return std::string(Validate(options).message());
}

TEST(LocalMapOptions, DefaultsAreValidAndMakeFortyCellsASide) {
  EXPECT_TRUE(Validate(LocalMapOptions()).ok());
  EXPECT_EQ(SideCells(LocalMapOptions()), 40);
}

TEST(LocalMapOptions, NamesFieldValueAndRange) {
  EXPECT_EQ(ErrorAfter([](auto& o) { o.cell_size_m = -1; }),
            "local_map.cell_size_m is -1, want [0.01, 10]");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.side_m = 1000; }),
            "local_map.side_m is 1000, want 5 to 1024 cells of 0.2 m");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.side_m = 0.5f; }),
            "local_map.side_m is 0.5, want 5 to 1024 cells of 0.2 m");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.range_m_min = 200; }),
            "local_map.range_m_min is 200, want [0, 120)");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.height_m_min = 4; }),
            "local_map.height_m_min is 4, want [-1000, 3)");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.body.y_m_min = 1; }),
            "local_map.body.y_m_min is 1, want [-1000, 0]");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.gate_sigmas = 0; }),
            "local_map.gate_sigmas is 0, want (0, 100]");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.variance_m2_min = 2; }),
            "local_map.variance_m2_min is 2, want (0, 1)");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.variance_growth_m2_per_s = -1; }),
            "local_map.variance_growth_m2_per_s is -1, want [0, 1]");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.variance_growth_m2_per_m = 2; }),
            "local_map.variance_growth_m2_per_m is 2, want [0, 1]");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.below_gate_inflation = 0.5f; }),
            "local_map.below_gate_inflation is 0.5, want [1, 1000]");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.slope_weight = 2; }),
            "local_map.slope_weight is 2, want [0, 1]");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.roughness_weight = -2; }),
            "local_map.roughness_weight is -2, want [0, 1]");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.slope_critical_rad = 2; }),
            "local_map.slope_critical_rad is 2, want (0, 1.5708]");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.roughness_critical_m = 0; }),
            "local_map.roughness_critical_m is 0, want (0, 10]");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.traversability_free = 1; }),
            "local_map.traversability_free is 1, want (0, 1)");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.plane_cells_min = 26; }),
            "local_map.plane_cells_min is 26, want [3, 25]");
  EXPECT_EQ(ErrorAfter([](auto& o) { o.clear_sigmas = -3; }),
            "local_map.clear_sigmas is -3, want [0, 100]");
}

TEST(LocalMapOptions, RefusesNanEverywhere) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  float LocalMapOptions::*const fields[] = {&LocalMapOptions::cell_size_m,
                                            &LocalMapOptions::side_m,
                                            &LocalMapOptions::range_m_min,
                                            &LocalMapOptions::range_m_max,
                                            &LocalMapOptions::height_m_min,
                                            &LocalMapOptions::height_m_max,
                                            &LocalMapOptions::gate_sigmas,
                                            &LocalMapOptions::variance_m2_min,
                                            &LocalMapOptions::variance_m2_max,
                                            &LocalMapOptions::variance_growth_m2_per_s,
                                            &LocalMapOptions::variance_growth_m2_per_m,
                                            &LocalMapOptions::below_gate_inflation,
                                            &LocalMapOptions::slope_weight,
                                            &LocalMapOptions::roughness_weight,
                                            &LocalMapOptions::slope_critical_rad,
                                            &LocalMapOptions::roughness_critical_m,
                                            &LocalMapOptions::traversability_free,
                                            &LocalMapOptions::clear_sigmas};
  for (const auto field : fields) {
    EXPECT_FALSE(Validate([&] {
                   LocalMapOptions options;
                   options.*field = nan;
                   return options;
                 }())
                     .ok());
  }
  float BodyBox::*const sides[] = {&BodyBox::x_m_min, &BodyBox::y_m_min, &BodyBox::z_m_min,
                                   &BodyBox::x_m_max, &BodyBox::y_m_max, &BodyBox::z_m_max};
  for (const auto side : sides) {
    EXPECT_NE(ErrorAfter([&](auto& o) { o.body.*side = nan; }), "");
  }
}

TEST(LocalMapOptions, RoundsTheWindowUpToWholeCells) {
  LocalMapOptions options;
  options.cell_size_m = 0.7f;
  options.side_m = 7.0f;  // the quotient of these floats is a little above 10
  EXPECT_EQ(SideCells(options), 10);
  options.side_m = 7.1f;
  EXPECT_EQ(SideCells(options), 11);
}

TEST(LocalBackend, NamesParseBackAndOthersAreRefused) {
  EXPECT_EQ(*ParseLocalBackend("cpu"), LocalBackend::kCpu);
  EXPECT_EQ(*ParseLocalBackend("reference"), LocalBackend::kReference);
  EXPECT_EQ(*ParseLocalBackend("cuda"), LocalBackend::kCuda);
  EXPECT_EQ(*ParseLocalBackend("auto"), LocalBackend::kAuto);
  EXPECT_EQ(ParseLocalBackend("gpu").status().message(),
            "local backend is \"gpu\", want reference, cpu, cuda or auto");
}

TEST(LocalBackend, InvalidOptionsMakeNoMapper) {
  LocalMapOptions options;
  options.side_m = -1;
  EXPECT_EQ(MakeLocalMapper(LocalBackend::kCpu, options).status().code(),
            absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace gem
