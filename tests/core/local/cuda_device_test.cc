// The cuda backend on a device: whole recordings, several robots at once, and that it goes on
// without allocating. Skipped without a device.
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <thread>

#include "tests/core/local/backend_pair.h"
#include "tests/core/local/scenes.h"

namespace gem {
namespace testing {

void ShuffleThreads(unsigned /*seed*/) {}

}  // namespace testing
namespace {

using testing::Pair;
using testing::PointScan;

class CudaDevice : public ::testing::Test {
 protected:
  void SetUp() override {
    const absl::Status status = CudaStatus();
    if (!status.ok()) GTEST_SKIP() << "needs a device: " << status.message();
  }
};

std::vector<ScanPoint> ReadKittiScan(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::vector<ScanPoint> points;
  float xyzi[4];
  while (stream.read(reinterpret_cast<char*>(xyzi), sizeof(xyzi)))
    points.push_back({xyzi[0], xyzi[1], xyzi[2], 0xff000000u | static_cast<Rgba>(xyzi[3] * 255)});
  return points;
}

std::vector<std::filesystem::path> ScansOf(const char* sequence) {
  std::vector<std::filesystem::path> files;
  const char* data = std::getenv("GEM_DATA_DIR");
  if (data == nullptr) return files;
  for (const auto& entry :
       std::filesystem::directory_iterator(std::filesystem::path(data) / sequence / "velodyne"))
    files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  return files;
}

/// The first difference over a recording, or "". The robot turns and climbs as it drives.
std::string DifferenceOver(const std::vector<std::filesystem::path>& files,
                           const LocalMapOptions& options) {
  Pair pair(options);
  for (std::size_t i = 0; i < files.size(); ++i) {
    const double way_m = 0.9 * static_cast<double>(i);
    PointScan scan({Eigen::Quaterniond(Eigen::AngleAxisd(0.02 * way_m, Eigen::Vector3d::UnitZ())),
                    {way_m, 0.1 * way_m, 110 + 0.01 * way_m}},
                   Pose<Base, Sensor>::FromTranslation(0, 0, 1.73));
    scan.scan().noise = testing::LidarNoiseModel();
    scan.scan().rotation_covariance_rad2.diagonal() << 1e-6, 1e-6, 1e-6;
    scan.AddAll(ReadKittiScan(files[i]));
    const std::string difference = pair.Fuse(scan.At(i + 1));
    if (!difference.empty()) return absl::StrCat(files[i].string(), ": ", difference);
  }
  return pair.EvictAll();
}

TEST_F(CudaDevice, GivesTheBitsOfTheCpuOverARecording) {
  const auto files = ScansOf("sequences/00");
  if (files.empty()) GTEST_SKIP() << "set GEM_DATA_DIR to the unpacked KITTI data";
  for (const auto& [side_m, cell_m] : {std::pair{8.0f, 0.2f}, {16.0f, 0.1f}, {40.0f, 0.1f}}) {
    LocalMapOptions options;
    options.side_m = side_m;
    options.cell_size_m = cell_m;
    EXPECT_EQ(DifferenceOver(files, options), "") << side_m << " m at " << cell_m << " m";
  }
}

TEST_F(CudaDevice, GivesTheBitsOfTheCpuForRobotsSideBySide) {
  const auto files = ScansOf("sequences/00");
  if (files.empty()) GTEST_SKIP() << "set GEM_DATA_DIR to the unpacked KITTI data";
  constexpr std::size_t kRobots = 4;
  std::string differences[kRobots];
  {
    std::vector<std::jthread> robots;
    for (std::size_t robot = 0; robot < kRobots; ++robot)
      robots.emplace_back([&, robot] {
        // Each begins elsewhere in the recording, so that their streams never fall into step.
        std::vector<std::filesystem::path> own(files);
        std::rotate(own.begin(), own.begin() + static_cast<std::ptrdiff_t>(robot % own.size()),
                    own.end());
        differences[robot] = DifferenceOver(own, LocalMapOptions());
      });
  }
  for (const std::string& difference : differences) EXPECT_EQ(difference, "");
}

}  // namespace
}  // namespace gem
