#include "proto/wire/session_setup.h"

#include <limits>

#include "gem/v1/ingest_service.pb.h"
#include "tests/proto/refused.h"

namespace gem::wire {
namespace {

v1::OpenSession GoodOpen() {
  v1::OpenSession open;
  open.set_map("site-1");
  open.set_robot("r_1");
  open.set_session("2026.11.22");
  v1::SensorSetup* sensor = open.add_sensors();
  sensor->set_name("top");
  sensor->mutable_base_from_sensor()->set_qw(1);
  return open;
}

absl::StatusOr<SessionSetup> Decode(const v1::OpenSession& open) {
  return FromProto(open, FieldPath("open"));
}

TEST(SessionSetup, TakesDefaultsForWhatIsUnset) {
  const auto setup = Decode(GoodOpen());
  ASSERT_TRUE(setup.ok()) << setup.status();
  EXPECT_EQ(setup->map, "site-1");
  ASSERT_EQ(setup->sensors.size(), 1u);
  EXPECT_TRUE(setup->sensors[0].noise.along_beam);
  EXPECT_EQ(setup->sensors[0].noise.axial_m[0], 0.018f);
  LocalMapOptions defaults;
  defaults.side_m = 12;
  EXPECT_EQ(setup->local_map.Over(defaults).side_m, 12);
  EXPECT_EQ(setup->map_setup.Over({}).cell_size_m, 0.2f);
}

TEST(SessionSetup, SurvivesTheRoundTrip) {
  SessionSetup setup{"m", "r", "s", Pose<Global, Odom>::FromTranslation(1, 2, 3), {}, {}, {}};
  setup.sensors.push_back({"top", Pose<Base, Sensor>::FromTranslation(0, 0, 2),
                           *MakeNoiseModel(LidarNoise{0.02f, 0.003f, 0.0f})});
  setup.sensors.push_back({"eye", {}, *MakeNoiseModel(StereoNoise{700, 0.5f, 0.4f, 0.3f})});
  setup.sensors.push_back(
      {"depth", {}, *MakeNoiseModel(DepthCameraNoise{0.01f, 0.002f, 0.5f, 0.003f})});
  setup.local_map = {16.0f, 0.25f, 50.0f, -2.0f, 1.5f, BodyBox{-1, -2, -3, 1, 2, 3}};
  setup.map_setup = {0.1f, 5.0f, true};
  v1::OpenSession proto;
  ToProto(setup, &proto);
  const auto back = Decode(proto);
  ASSERT_TRUE(back.ok()) << back.status();
  EXPECT_EQ(back->T_G_O.translation(), Eigen::Vector3d(1, 2, 3));
  ASSERT_EQ(back->sensors.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const NoiseModel& got = back->sensors[i].noise;
    const NoiseModel& sent = setup.sensors[i].noise;
    EXPECT_EQ(got.along_beam, sent.along_beam);
    // Variance of the point (3, 1, 5) along z, which every parameter has a share in.
    const float want = VarianceAlong(sent, 0, 0, 1, 3, 1, 5, 5.916f);
    EXPECT_NEAR(VarianceAlong(got, 0, 0, 1, 3, 1, 5, 5.916f), want, 1e-4f * want) << i;
  }
  const LocalMapOptions local = back->local_map.Over({});
  EXPECT_EQ(local.side_m, 16);
  EXPECT_EQ(local.range_m_min, 0.25f);
  EXPECT_EQ(local.range_m_max, 50);
  EXPECT_EQ(local.height_m_min, -2);
  EXPECT_EQ(local.height_m_max, 1.5f);
  EXPECT_EQ(local.body.y_m_min, -2);
  const GlobalMapOptions global = back->map_setup.Over({});
  EXPECT_EQ(global.cell_size_m, 0.1f);
  EXPECT_EQ(global.submap_length_m, 5);
  EXPECT_TRUE(global.traversable_only);
}

TEST(SessionSetup, RefusesIdsByName) {
  v1::OpenSession open = GoodOpen();
  open.set_map("");
  EXPECT_THAT(Decode(open),
              Refused("open.map",
                      "open.map is \"\", want 1 to 64 characters of [A-Za-z0-9_.-], the "
                      "first a letter or digit"));
  open = GoodOpen();
  open.set_robot("../etc");
  EXPECT_EQ(FieldOf(Decode(open).status()), "open.robot");
  open = GoodOpen();
  open.set_session(std::string(65, 'a'));
  EXPECT_EQ(FieldOf(Decode(open).status()), "open.session");
  open.set_session(std::string(64, 'a'));
  EXPECT_TRUE(Decode(open).ok());
}

TEST(SessionSetup, RefusesSensorsByName) {
  v1::OpenSession open = GoodOpen();
  open.clear_sensors();
  EXPECT_THAT(Decode(open), Refused("open.sensors", "open.sensors is 0 sensors, want 1 to 16"));

  open = GoodOpen();
  *open.add_sensors() = open.sensors(0);
  EXPECT_THAT(Decode(open),
              Refused("open.sensors[1].name",
                      "open.sensors[1].name is \"top\" for the second time, want each name once"));

  open = GoodOpen();
  open.mutable_sensors(0)->clear_base_from_sensor();
  EXPECT_EQ(FieldOf(Decode(open).status()), "open.sensors[0].base_from_sensor");

  open = GoodOpen();
  open.mutable_sensors(0)->mutable_lidar()->set_sigma_axial_m(-1);
  EXPECT_THAT(Decode(open),
              Refused("open.sensors[0].lidar.sigma_axial_m",
                      "open.sensors[0].lidar.sigma_axial_m is -1, want a finite number "
                      "above 0"));
  open = GoodOpen();
  open.mutable_sensors(0)->mutable_stereo()->set_focal_length_px(700);
  EXPECT_EQ(FieldOf(Decode(open).status()), "open.sensors[0].stereo.baseline_m");
}

TEST(SessionSetup, RefusesNumbersThatAreNotFinite) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  v1::OpenSession open = GoodOpen();
  open.mutable_local_map()->set_side_m(nan);
  EXPECT_EQ(FieldOf(Decode(open).status()), "open.local_map.side_m");
  open = GoodOpen();
  open.mutable_map_setup()->set_cell_size_m(nan);
  EXPECT_EQ(FieldOf(Decode(open).status()), "open.map_setup.cell_size_m");
  open = GoodOpen();
  open.mutable_local_map()->mutable_body()->set_y_min(2);
  EXPECT_THAT(Decode(open), Refused("open.local_map.body.y_min",
                                    "open.local_map.body.y_min is 2, want at most y_max = 0"));
  open = GoodOpen();
  open.mutable_map_from_odom();
  EXPECT_EQ(FieldOf(Decode(open).status()), "open.map_from_odom");
}

TEST(MapSetup, ConflictsNameTheFieldAndBothValues) {
  GlobalMapOptions map;
  map.cell_size_m = 0.2f;
  map.submap_length_m = 20;
  EXPECT_TRUE(MapSetup{}.CheckAgainst(map).ok());
  EXPECT_TRUE((MapSetup{0.2f, 20.0f, false}).CheckAgainst(map).ok());
  const absl::Status status = MapSetup{0.1f, {}, false}.CheckAgainst(map);
  EXPECT_EQ(status.code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(std::string(status.message()),
            "open.map_setup.cell_size_m is 0.1, want 0.2 as the map has");
  EXPECT_EQ(FieldOf(MapSetup{{}, 5.0f, false}.CheckAgainst(map)), "open.map_setup.submap_length_m");
  EXPECT_EQ(FieldOf(MapSetup{{}, {}, true}.CheckAgainst(map)), "open.map_setup.traversable_only");
}

}  // namespace
}  // namespace gem::wire
