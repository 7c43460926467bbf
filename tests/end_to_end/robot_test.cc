// A robot with the client library against the shipped server: what each of them promises alone must
// hold for the two together.
#include "client/ingest_client.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/end_to_end/process.h"

namespace gem::test {
namespace {

using client::IngestClient;
using client::OutgoingScan;

constexpr std::int64_t kPeriod_ns = 100'000'000;
constexpr std::size_t kNumPoints = 1000;  // 16,000 bytes with their time offsets

Pose<Odom, Base> Driven(std::int64_t stamp_ns) {
  return Pose<Odom, Base>::FromTranslation(1e-8 * static_cast<double>(stamp_ns), 0, 0);
}

class Robot {
 public:
  explicit Robot(const ServerProcess& server) {
    client::ConnectionOptions connection;
    connection.address = server.address();
    client::SessionSetup setup;
    setup.map = "yard";
    setup.robot = "rover";
    setup.session = "monday";
    setup.sensors = {{"lidar", Pose<Base, Sensor>::FromTranslation(0, 0, 1),
                      MakeNoiseModel(LidarNoise()).value()},
                     {"camera",
                      // Straight down.
                      Pose<Base, Sensor>(Eigen::Quaterniond(0, 1, 0, 0), {0, 0, 1}),
                      MakeNoiseModel(DepthCameraNoise()).value()}};
    client::IngestOptions options;
    options.progress_timeout_s = 30;
    auto opened =
        IngestClient::Open(std::make_shared<const client::Connection>(connection), setup, options);
    EXPECT_TRUE(opened.ok()) << opened.status();
    client_ = *std::move(opened);
    for (std::size_t i = 0; i < kNumPoints; ++i) {
      const float angle_rad = 0.00628f * static_cast<float>(i);
      points_.push_back({3 * std::cos(angle_rad), 3 * std::sin(angle_rad), -1, 0});
      offsets_s_.push_back(0.1f * static_cast<float>(i) / kNumPoints);
    }
  }

  /// A sweep from stamp to stamp + 0.1 s that carries no pose.
  absl::Status SendSweep(int number) {
    OutgoingScan scan{number * kPeriod_ns, "lidar", std::nullopt, std::nullopt, points_};
    scan.time_offsets_s = offsets_s_;
    return client_->Send(scan);
  }
  /// Ten poses: those of the period that ends when sweep `number` begins.
  absl::Status SendPosesUntil(int number) {
    std::vector<StampedPose<Odom, Base>> poses;
    for (int i = 9; i >= 0; --i) {
      const std::int64_t stamp_ns = number * kPeriod_ns - i * kPeriod_ns / 10;
      poses.push_back({stamp_ns, Driven(stamp_ns)});
    }
    return client_->SendPoses(poses);
  }
  IngestClient& client() { return *client_; }

 private:
  std::unique_ptr<IngestClient> client_;
  std::vector<ScanPoint> points_;
  std::vector<float> offsets_s_;
};

/// Holds six sweeps, three of them while they wait for poses; patient, so that nothing is refused
/// for its time.
std::vector<std::string> SmallQueue() {
  return {"--queue_bytes_max", "120000", "--scan_bytes_max", "20000", "--pose_wait_s_max", "10"};
}

TEST(Robot, StreamsPosesBehindItsSweepsThroughASmallQueue) {
  const ServerProcess server(SmallQueue());
  Robot robot(server);
  constexpr int kNumSweeps = 100;
  ASSERT_TRUE(robot.SendPosesUntil(1).ok());
  for (int i = 1; i <= kNumSweeps; ++i) {
    ASSERT_TRUE(robot.SendSweep(i).ok());
    ASSERT_TRUE(robot.SendPosesUntil(i + 1).ok());
  }
  const auto closed = robot.client().Close();
  ASSERT_TRUE(closed.ok()) << closed.status();
  EXPECT_EQ(closed->num_scans_fused, kNumSweeps);
  EXPECT_EQ(closed->num_scans_refused, 0u);
  EXPECT_EQ(closed->num_scans_not_deskewed, 0u);
  EXPECT_EQ(robot.client().progress().num_problems, 0u);
}

TEST(Robot, WhosePosesComeTooLateIsToldAndNotHeldUp) {
  const ServerProcess server(SmallQueue());
  Robot robot(server);
  constexpr int kNumSweeps = 30;
  for (int i = 1; i <= kNumSweeps; ++i) ASSERT_TRUE(robot.SendSweep(i).ok());
  for (int i = 1; i <= kNumSweeps + 1; ++i) ASSERT_TRUE(robot.SendPosesUntil(i).ok());
  const auto closed = robot.client().Close();
  ASSERT_TRUE(closed.ok()) << closed.status();
  EXPECT_GE(closed->num_scans_fused, 1u);
  EXPECT_EQ(closed->num_scans_fused + closed->num_scans_refused, kNumSweeps);
  EXPECT_EQ(robot.client().progress().num_problems, closed->num_scans_refused);
}

TEST(Robot, LosesScansInsteadOfTimeIfItIsAskedTo) {
  // The slow backend on a large window takes longer for a scan than the robot for its next one.
  const ServerProcess server({"--backend", "reference", "--overload_age_s_max", "0.01"});
  const Finished run =
      Gem({"simulate", "flat", "--server", server.address(), "--rings", "16", "--azimuths", "256",
           "--local_size_m", "40", "--scans", "60", "--overload", "drop_oldest"});
  EXPECT_EQ(run.exit_code, 0) << run.output;
  EXPECT_NE(run.output.find("dropped for newer ones: "), std::string::npos) << run.output;
  EXPECT_NE(run.output.find(" 0 refused"), std::string::npos) << run.output;
}

TEST(Robot, SendsDepthImagesBetweenItsSweeps) {
  const ServerProcess server;
  Robot robot(server);
  constexpr std::uint32_t kSide = 32;
  const std::vector<std::uint16_t> depths(kSide * kSide, 1000);
  OutgoingScan picture{kPeriod_ns / 2, "camera", Driven(kPeriod_ns / 2), std::nullopt, {}};
  picture.depth_image.emplace();
  picture.depth_image->width = picture.depth_image->height = kSide;
  picture.depth_image->fx_px = picture.depth_image->fy_px = 16;
  picture.depth_image->cx_px = picture.depth_image->cy_px = 15.5;
  picture.depth_image->depth = std::as_bytes(std::span(depths));
  ASSERT_TRUE(robot.client().Send(picture).ok());
  ASSERT_TRUE(robot.SendPosesUntil(1).ok());
  ASSERT_TRUE(robot.SendSweep(1).ok());
  ASSERT_TRUE(robot.SendPosesUntil(2).ok());
  const auto closed = robot.client().Close();
  ASSERT_TRUE(closed.ok()) << closed.status();
  EXPECT_EQ(closed->num_scans_fused, 2u);
  EXPECT_EQ(closed->num_scans_refused, 0u);
}

}  // namespace
}  // namespace gem::test
