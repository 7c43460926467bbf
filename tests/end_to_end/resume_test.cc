// A radio link that breaks again and again: whatever it does, the map is the same as over a cable.
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "tests/end_to_end/process.h"
#include "tests/end_to_end/streaming_robot.h"
#include "tests/network/tcp_proxy.h"

namespace gem::test {
namespace {

constexpr int kNumFaults = 200;

/// Comes back at once and does not give up.
client::IngestOptions Stubborn() {
  client::IngestOptions options;
  options.backoff_s_min = options.backoff_s_max = 0.002;
  options.tries_max = 1000;
  options.progress_timeout_s = 60;
  return options;
}

/// Scans of 12 to 16 kB: most connections carry one to three of them.
Drive BlockDrive(int num_scans) {
  SceneOptions scene;
  scene.name = "block";
  scene.rings = 8;
  scene.azimuths = 128;
  scene.scans_max = num_scans;
  return Simulate(scene);
}

/// One connection after the other: each kind of fault in turn, at a random moment; one in ten while
/// the connection or the session is being opened.
std::vector<Fault> RandomFaults(unsigned seed) {
  std::mt19937 random(seed);
  std::vector<Fault> faults;
  for (int i = 0; i < kNumFaults; ++i) {
    Fault fault;
    fault.kind = static_cast<Fault::Kind>(1 + i % 4);
    fault.after_bytes = random() % 10 == 0 ? random() % 1000 : random() % 40'000;
    faults.push_back(fault);
  }
  return faults;
}

void DriveAndClose(const std::string& address, const std::string& map, const Drive& drive) {
  StreamingRobot robot(address, SetupOf(drive, map, "rover", "monday"), drive, Stubborn());
  ASSERT_TRUE(robot.Send(0, drive.scans.size()).ok());
  const auto closed = robot.client().Close();
  ASSERT_TRUE(closed.ok()) << closed.status();
  EXPECT_EQ(closed->num_scans_fused, drive.scans.size());
  EXPECT_EQ(closed->num_scans_refused, 0u);
  EXPECT_EQ(closed->num_scans_not_deskewed, 0u);
  EXPECT_EQ(robot.client().progress().num_problems, 0u);
}

void CorrectWithTheTruth(const std::string& address, const std::string& map, const Drive& drive) {
  client::ConnectionOptions connection;
  connection.address = address;
  const client::MapClient client(std::make_shared<const client::Connection>(connection));
  const auto corrected =
      client.CorrectTrajectory({map, "monday", "", drive.TrueUntil(drive.scans.size())});
  ASSERT_TRUE(corrected.ok()) << corrected.status();
}

std::string ExportedBytes(const ServerProcess& server, const std::string& map) {
  const ScratchDir scratch;
  const std::string file = scratch.File("map.xyz");
  const Finished run = Gem({"export", "--server", server.address(), "--map", map, "--layer",
                            "elevation", "--format", "xyz", "--out", file});
  EXPECT_EQ(run.exit_code, 0) << run.output;
  std::ifstream in(file);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// Patient, so that nothing is refused for its time.
const std::vector<std::string> kPatient = {"--pose_wait_s_max", "10"};

TEST(Resume, TwoHundredBrokenConnectionsLeaveTheSameMapAsNone) {
  const ServerProcess server(kPatient);
  const Drive drive = BlockDrive(500);
  DriveAndClose(server.address(), "cable", drive);
  const std::vector<Fault> faults = RandomFaults(/*seed=*/5);
  const TcpProxy radio(server.address(), [&](int connection) {
    return connection < kNumFaults ? faults[static_cast<std::size_t>(connection)] : Fault();
  });
  DriveAndClose(radio.address(), "radio", drive);
  EXPECT_EQ(radio.num_faults(), kNumFaults);

  EXPECT_EQ(DifferenceOf(ReadWholeMap(server.address(), "cable"),
                         ReadWholeMap(server.address(), "radio")),
            "");
  for (const char* map : {"cable", "radio"}) CorrectWithTheTruth(server.address(), map, drive);
  const std::string exported = ExportedBytes(server, "cable");
  EXPECT_GT(exported.size(), 100'000u);
  EXPECT_TRUE(exported == ExportedBytes(server, "radio"));
  EXPECT_EQ(DifferenceOf(ReadWholeMap(server.address(), "cable"),
                         ReadWholeMap(server.address(), "radio")),
            "");
}

TEST(Resume, ARobotThatMayDropScansLosesCountOfNone) {
  constexpr int kNumCuts = 40;  // few scans travel, and tries without one are bounded
  const ServerProcess server({"--pose_wait_s_max", "10", "--overload_age_s_max", "0.02"});
  const Drive drive = BlockDrive(300);
  const std::vector<Fault> faults = RandomFaults(/*seed=*/6);
  const TcpProxy radio(server.address(), [&](int connection) {
    return connection < kNumCuts ? faults[static_cast<std::size_t>(connection)] : Fault();
  });
  client::IngestOptions options = Stubborn();
  options.overload = client::OverloadPolicy::kDropOldest;
  options.unsent_scans_max = 100;
  options.backoff_s_min = options.backoff_s_max = 0.01;
  StreamingRobot robot(radio.address(), SetupOf(drive, "radio", "rover", "monday"), drive, options);
  ASSERT_TRUE(robot.Send(0, drive.scans.size()).ok());
  const auto closed = robot.client().Close();
  ASSERT_TRUE(closed.ok()) << closed.status();
  const client::IngestProgress progress = robot.client().progress();
  EXPECT_GT(progress.num_reconnects, 5u);
  EXPECT_GT(closed->num_scans_fused, 0u);
  EXPECT_EQ(closed->num_scans_refused, 0u);
  EXPECT_EQ(closed->num_scans_fused + closed->num_scans_dropped + progress.num_dropped,
            drive.scans.size());
}

TEST(Resume, TheComparisonSeesOneScanThatIsMissing) {
  const ServerProcess server(kPatient);
  Drive drive = BlockDrive(60);
  DriveAndClose(server.address(), "all", drive);
  drive.scans.erase(drive.scans.begin() + 30);
  DriveAndClose(server.address(), "one_less", drive);
  EXPECT_NE(DifferenceOf(ReadWholeMap(server.address(), "all"),
                         ReadWholeMap(server.address(), "one_less")),
            "");
}

TEST(Resume, AServerThatWasRestartedSaysSo) {
  const Drive drive = BlockDrive(20);
  auto server = std::make_unique<ServerProcess>();
  const std::string address = server->address();
  client::IngestOptions options = Stubborn();
  options.backoff_s_min = options.backoff_s_max = 0.05;  // outlasts the restart
  StreamingRobot robot(address, SetupOf(drive, "yard", "rover", "monday"), drive, options);
  ASSERT_TRUE(robot.Send(0, 10).ok());
  ASSERT_TRUE(robot.client().WaitUntilFused().ok());
  server.reset();
  server = std::make_unique<ServerProcess>(std::vector<std::string>{"--listen", address});
  absl::Status status = robot.Send(10, 20);
  if (status.ok()) status = robot.client().WaitUntilFused();
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_TRUE(
      absl::StrContains(status.message(),
                        "the server was restarted and what it had fused is lost: it wants scan 1, "
                        "the oldest that is kept is 11"))
      << status;
}

}  // namespace
}  // namespace gem::test
