// A simulated robot in the test's process that streams to a shipped server with the client library:
// sweeps with and without poses and time offsets, odometry apart. Every run of a drive sends the
// same.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "client/ingest_client.h"
#include "client/map_client.h"
#include "client/scan_source.h"
#include "client/simulation/scenes.h"

namespace gem::test {

/// What one robot measures on its way, and where it really was.
struct Drive {
  std::vector<SourceScan> scans;
  Pose<Base, Sensor> T_B_S;
  NoiseModel noise;

  /// The true poses of the first `num_scans`, as SLAM would give them.
  std::vector<StampedPose<Global, Base>> TrueUntil(std::size_t num_scans) const;
};

Drive Simulate(const SceneOptions& options);

class StreamingRobot {
 public:
  StreamingRobot(const std::string& address, const client::SessionSetup& setup, const Drive& drive,
                 client::IngestOptions options = {});

  /// The scans of [begin, end), counted from 0, and the odometry to fuse them with. Every second
  /// scan carries no pose but has time offsets, so that it is deskewed.
  absl::Status Send(std::size_t begin, std::size_t end);
  client::IngestClient& client() { return *client_; }

 private:
  absl::Status SendSweep(std::size_t index);
  /// From half a period after scan index - 1 to half a period after scan `index`.
  absl::Status SendOdometry(std::size_t index);

  const Drive& drive_;
  Trajectory<Odom, Base> odometry_;
  std::unique_ptr<client::IngestClient> client_;
  std::vector<float> offsets_s_;
};

/// Sensors of a drive; the caller names map, robot and session.
client::SessionSetup SetupOf(const Drive& drive, const std::string& map, const std::string& robot,
                             const std::string& session);

/// Every cell of every tile, bit by bit, without the version.
std::vector<client::MapTile> ReadWholeMap(const std::string& address, const std::string& map);

/// "" if both have the same cells with the same bits; else what differs first.
std::string DifferenceOf(const std::vector<client::MapTile>& a,
                         const std::vector<client::MapTile>& b);

}  // namespace gem::test
