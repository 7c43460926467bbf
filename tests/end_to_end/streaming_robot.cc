#include "tests/end_to_end/streaming_robot.h"

#include <gtest/gtest.h>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace gem::test {
namespace {

constexpr std::int64_t kHalfPeriod_ns = 50'000'000;
constexpr int kPosesOfPeriod = 4;

}  // namespace

std::vector<StampedPose<Global, Base>> Drive::TrueUntil(std::size_t num_scans) const {
  std::vector<StampedPose<Global, Base>> poses;
  for (std::size_t i = 0; i < num_scans; ++i) poses.push_back({scans[i].stamp_ns, *scans[i].T_G_B});
  return poses;
}

Drive Simulate(const SceneOptions& options) {
  auto source = MakeScene(options);
  GEM_CHECK(source.ok());
  Drive drive{{}, (*source)->T_B_S(), (*source)->noise()};
  SourceScan scan;
  while (*(*source)->Next(scan)) drive.scans.push_back(scan);
  return drive;
}

client::SessionSetup SetupOf(const Drive& drive, const std::string& map, const std::string& robot,
                             const std::string& session) {
  client::SessionSetup setup;
  setup.map = map;
  setup.robot = robot;
  setup.session = session;
  setup.sensors = {{"lidar", drive.T_B_S, drive.noise}};
  return setup;
}

StreamingRobot::StreamingRobot(const std::string& address, const client::SessionSetup& setup,
                               const Drive& drive, client::IngestOptions options)
    : drive_(drive) {
  odometry_.Append(drive.scans.front().stamp_ns - 2 * kHalfPeriod_ns, drive.scans.front().T_O_B);
  for (const SourceScan& scan : drive.scans) odometry_.Append(scan.stamp_ns, scan.T_O_B);
  odometry_.Append(drive.scans.back().stamp_ns + 2 * kHalfPeriod_ns, drive.scans.back().T_O_B);
  client::ConnectionOptions connection;
  connection.address = address;
  auto opened = client::IngestClient::Open(std::make_shared<const client::Connection>(connection),
                                           setup, std::move(options));
  EXPECT_TRUE(opened.ok()) << opened.status();
  GEM_CHECK(opened.ok());
  client_ = *std::move(opened);
}

absl::Status StreamingRobot::Send(std::size_t begin, std::size_t end) {
  for (std::size_t i = begin; i < end; ++i) {
    GEM_RETURN_IF_ERROR(SendSweep(i));
    GEM_RETURN_IF_ERROR(SendOdometry(i));
  }
  return absl::OkStatus();
}

absl::Status StreamingRobot::SendSweep(std::size_t index) {
  const SourceScan& scan = drive_.scans[index];
  client::OutgoingScan sweep{scan.stamp_ns, "lidar", scan.T_O_B, std::nullopt, scan.points};
  if (index % 2 == 1) {
    sweep.T_O_B.reset();
    offsets_s_.resize(scan.points.size());
    for (std::size_t i = 0; i < offsets_s_.size(); ++i)
      offsets_s_[i] =
          0.09f * (static_cast<float>(i) / static_cast<float>(offsets_s_.size()) - 0.5f);
    sweep.time_offsets_s = offsets_s_;
  }
  return client_->Send(sweep);
}

absl::Status StreamingRobot::SendOdometry(std::size_t index) {
  const std::int64_t end_ns = drive_.scans[index].stamp_ns + kHalfPeriod_ns;
  const std::int64_t begin_ns =
      index == 0 ? end_ns - 2 * kHalfPeriod_ns : drive_.scans[index - 1].stamp_ns + kHalfPeriod_ns;
  std::vector<StampedPose<Odom, Base>> poses;
  for (int i = index == 0 ? 0 : 1; i <= kPosesOfPeriod; ++i) {
    const std::int64_t stamp_ns = begin_ns + (end_ns - begin_ns) * i / kPosesOfPeriod;
    poses.push_back({stamp_ns, *odometry_.At(stamp_ns)});
  }
  return client_->SendPoses(poses);
}

std::vector<client::MapTile> ReadWholeMap(const std::string& address, const std::string& map) {
  client::ConnectionOptions connection;
  connection.address = address;
  const client::MapClient client(std::make_shared<const client::Connection>(connection));
  client::CellSelection selection;
  selection.layers = {Layer::kElevation, Layer::kVariance, Layer::kTraversability, Layer::kColor,
                      Layer::kAge};
  selection.encoding = client::CellEncoding::kRaw;
  const auto tiles = client.ReadMap(map, std::nullopt, selection);
  EXPECT_TRUE(tiles.ok()) << tiles.status();
  return tiles.ok() ? tiles->tiles.tiles : std::vector<client::MapTile>();
}

std::string DifferenceOf(const std::vector<client::MapTile>& a,
                         const std::vector<client::MapTile>& b) {
  if (a.size() != b.size()) return absl::StrCat(a.size(), " and ", b.size(), " tiles");
  for (std::size_t i = 0; i < a.size(); ++i) {
    const std::string tile = absl::StrCat("tile (", a[i].index.x, ", ", a[i].index.y, ")");
    if (a[i].index != b[i].index) return absl::StrCat(tile, " is not in both");
    if ((a[i].grid == nullptr) != (b[i].grid == nullptr)) return absl::StrCat(tile, " is absent");
    for (std::size_t l = 0; a[i].grid != nullptr && l < a[i].grid->layers.size(); ++l)
      if (a[i].grid->layers[l] != b[i].grid->layers[l])
        return absl::StrCat("layer ", NameOf(a[i].grid->layers[l].layer), " of ", tile);
  }
  return "";
}

}  // namespace gem::test
