#include "proto/wire/terrain.h"

#include <cmath>
#include <functional>
#include <limits>

#include "gem/v1/terrain_service.pb.h"
#include "tests/proto/refused.h"

namespace gem::wire {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

v1::CheckPathRequest GoodRequest() {
  v1::CheckPathRequest request;
  ToProto(PathQuestion{{{1, 2}, {3, 4}}, Disc{0.5}, 0.25}, &request);
  return request;
}

using Spoil = std::function<void(v1::CheckPathRequest&)>;
absl::StatusOr<PathQuestion> Spoilt(const Spoil& spoil) {
  v1::CheckPathRequest request = GoodRequest();
  spoil(request);
  return FromProto(request);
}

TEST(PathQuestion, SurvivesTheRoundTrip) {
  const auto disc = FromProto(GoodRequest());
  ASSERT_TRUE(disc.ok()) << disc.status();
  EXPECT_EQ(disc->path, (std::vector<Place>{{1, 2}, {3, 4}}));
  EXPECT_EQ(std::get<Disc>(disc->footprint).radius_m, 0.5);
  EXPECT_EQ(disc->step_m, 0.25);
  v1::CheckPathRequest request;
  ToProto(PathQuestion{{{1, 2}}, Rectangle{-1, -2, 3, 4}, 0}, &request);
  const auto rectangle = FromProto(request);
  ASSERT_TRUE(rectangle.ok()) << rectangle.status();
  EXPECT_EQ(std::get<Rectangle>(rectangle->footprint).y_m_min, -2);
  EXPECT_EQ(std::get<Rectangle>(rectangle->footprint).x_m_max, 3);
}

TEST(PathQuestion, RefusesCornersByName) {
  EXPECT_THAT(Spoilt([](auto& r) { r.clear_path(); }),
              Refused("path", "path is 0 places, want 1 to 4096"));
  EXPECT_THAT(Spoilt([](auto& r) {
                while (r.path_size() < 4097) r.add_path();
              }),
              Refused("path", "path is 4097 places, want 1 to 4096"));
  EXPECT_THAT(Spoilt([](auto& r) { r.mutable_path(1)->set_x(kNan); }),
              Refused("path[1].x", "path[1].x is nan, want at most 1e+06 in magnitude"));
  EXPECT_THAT(Spoilt([](auto& r) { r.mutable_path(0)->set_y(-kInfinity); }),
              Refused("path[0].y", "path[0].y is -inf, want at most 1e+06 in magnitude"));
  EXPECT_THAT(Spoilt([](auto& r) { r.mutable_path(0)->set_y(1e300); }),
              Refused("path[0].y", "path[0].y is 1e+300, want at most 1e+06 in magnitude"));
  EXPECT_THAT(Spoilt([](auto& r) { r.mutable_path(1)->set_x(10'002); }),
              Refused("path", "path is 10001 m long, want at most 10000 m"));
}

TEST(PathQuestion, RefusesFootprintsByName) {
  EXPECT_THAT(Spoilt([](auto& r) { r.clear_footprint(); }),
              Refused("footprint", "footprint is without a shape, want radius_m or rectangle"));
  for (const double radius_m : {-0.1, 10.1, kInfinity})
    EXPECT_THAT(Spoilt([&](auto& r) { r.mutable_footprint()->set_radius_m(radius_m); }),
                Refused("footprint.radius_m",
                        absl::StrCat("footprint.radius_m is ", radius_m, ", want 0 to 10")));
  EXPECT_THAT(Spoilt([](auto& r) { r.mutable_footprint()->set_radius_m(kNan); }),
              Refused("footprint.radius_m", "footprint.radius_m is nan, want 0 to 10"));
  const auto rectangle = [](double x_min, double y_min, double x_max, double y_max) {
    v1::CheckPathRequest request;
    ToProto(PathQuestion{{{1, 2}}, Rectangle{x_min, y_min, x_max, y_max}, 0}, &request);
    return FromProto(request);
  };
  EXPECT_THAT(rectangle(-10.5, -1, 1, 1),
              Refused("footprint.rectangle.x_min",
                      "footprint.rectangle.x_min is -10.5, want at most 10 in magnitude"));
  EXPECT_THAT(rectangle(-1, -1, 1, kNan),
              Refused("footprint.rectangle.y_max",
                      "footprint.rectangle.y_max is nan, want at most 10 in magnitude"));
  EXPECT_THAT(rectangle(1, -1, 1, 1),
              Refused("footprint.rectangle.x_max",
                      "footprint.rectangle.x_max is 1, want more than x_min 1"));
  EXPECT_THAT(rectangle(-1, 2, 1, 1),
              Refused("footprint.rectangle.y_max",
                      "footprint.rectangle.y_max is 1, want more than y_min 2"));
}

TEST(PathQuestion, RefusesStepsByName) {
  EXPECT_THAT(Spoilt([](auto& r) { r.set_step_m(-1); }),
              Refused("step_m", "step_m is -1, want 0, or a positive length"));
  EXPECT_THAT(Spoilt([](auto& r) { r.set_step_m(kNan); }),
              Refused("step_m", "step_m is nan, want 0, or a positive length"));
  EXPECT_THAT(Spoilt([](auto& r) { r.set_step_m(kInfinity); }),
              Refused("step_m", "step_m is inf, want 0, or a positive length"));
}

TEST(GroundPoints, AreBoundedAndNamed) {
  v1::SampleHeightsRequest request;
  EXPECT_THAT(PointsFromProto(request), Refused("points", "points is 0 places, want 1 to 65536"));
  ToProto(std::vector<Place>(65'536, Place{5, -6}), &request);
  ASSERT_TRUE(PointsFromProto(request).ok());
  EXPECT_EQ(PointsFromProto(request)->back(), (Place{5, -6}));
  request.mutable_points(9)->set_y(kNan);
  EXPECT_THAT(PointsFromProto(request),
              Refused("points[9].y", "points[9].y is nan, want at most 1e+06 in magnitude"));
  request.add_points();
  EXPECT_THAT(PointsFromProto(request),
              Refused("points", "points is 65537 places, want 1 to 65536"));
}

TEST(GroundSamples, SurviveTheRoundTrip) {
  const std::vector<GroundSample> samples = {{GroundState::kUnknown, 0, 0, 0, std::nullopt},
                                             {GroundState::kHeightOnly, 1, 0.5f, 0, std::nullopt},
                                             {GroundState::kObstacle, -2, 0.25f, 0.125f, 0.0f},
                                             {GroundState::kFree, 3, 0.125f, 0.875f, 1.5f}};
  v1::SampleHeightsResponse response;
  ToProto(samples, &response);
  EXPECT_FALSE(response.samples(1).has_slope_rad());
  EXPECT_TRUE(response.samples(2).has_slope_rad()) << "a slope of zero is a slope";
  const auto back = FromProto(response, 4);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(*back, samples);
}

// The client draws conclusions from the state: one that it does not know must not become one.
TEST(GroundSamples, FromAServerAreJudged) {
  v1::SampleHeightsResponse response;
  ToProto({{GroundState::kFree, 1, 1, 1, 0.5f}}, &response);
  EXPECT_THAT(FromProto(response, 2),
              Refused("samples", "samples is 1 samples, want 2, one for each point"));
  response.mutable_samples(0)->set_state(v1::GroundSample::STATE_UNSPECIFIED);
  EXPECT_THAT(FromProto(response, 1),
              Refused("samples[0].state", "samples[0].state is 0, want a state that is known"));
  response.mutable_samples(0)->set_state(v1::GroundSample::STATE_FREE);
  response.mutable_samples(0)->set_slope_rad(NAN);
  EXPECT_THAT(FromProto(response, 1),
              Refused("samples[0].slope_rad", "samples[0].slope_rad is nan, want a finite number"));
}

PathCheck GoodCheck() {
  PathSample sample;
  sample.distance_m = 0.5;
  sample.position = {7, 8};
  sample.ground = {GroundState::kFree, 3, 0.125f, 0.875f, 1.5f};
  sample.worst = GroundState::kObstacle;
  sample.traversability_min = 0.25f;
  sample.slope_rad_max = 1.25f;
  sample.unknown_share = 0.75f;
  // A footprint at the end of the world reaches beyond it.
  return {{PathSample(), sample},
          false,
          {{-1'000'009, 10}, {GroundState::kObstacle, 1, 2, 0.25f, std::nullopt}, 1},
          0.5};
}

TEST(PathCheck, SurvivesTheRoundTrip) {
  v1::CheckPathResponse response;
  ToProto(GoodCheck(), &response);
  const auto back = FromProto(response);
  ASSERT_TRUE(back.ok()) << back.status();
  ASSERT_EQ(back->samples.size(), 2u);
  const PathSample& got = back->samples[1];
  const PathSample want = GoodCheck().samples[1];
  EXPECT_EQ(got.distance_m, want.distance_m);
  EXPECT_EQ(got.position, want.position);
  EXPECT_EQ(got.ground, want.ground);
  EXPECT_EQ(got.worst, want.worst);
  EXPECT_EQ(got.traversability_min, want.traversability_min);
  EXPECT_EQ(got.slope_rad_max, want.slope_rad_max);
  EXPECT_EQ(got.unknown_share, want.unknown_share);
  EXPECT_FALSE(back->free);
  EXPECT_EQ(back->worst.position, GoodCheck().worst.position);
  EXPECT_EQ(back->worst.ground, GoodCheck().worst.ground);
  EXPECT_EQ(back->worst.sample, 1u);
  EXPECT_EQ(back->free_distance_m, 0.5);
}

TEST(PathCheck, FromAServerIsJudged) {
  v1::CheckPathResponse response;
  EXPECT_THAT(FromProto(response), Refused("samples", "samples is 0 samples, want 1 to 65536"));
  ToProto(GoodCheck(), &response);
  response.mutable_worst()->set_sample(2);
  EXPECT_THAT(FromProto(response), Refused("worst.sample", "worst.sample is 2, want less than 2"));
  response.mutable_worst()->set_sample(0);
  response.mutable_samples(0)->set_worst(static_cast<v1::GroundSample::State>(9));
  EXPECT_THAT(FromProto(response),
              Refused("samples[0].worst", "samples[0].worst is 9, want a state that is known"));
}

}  // namespace
}  // namespace gem::wire
