// A drive with a town grown about it: what the robot would have scanned. The truth is set onto the
// town's ground, and odometry and SLAM keep their errors against it.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "client/evaluation/drive.h"
#include "client/simulation/lidar.h"
#include "client/simulation/world.h"
#include "core/sensor/scan.h"

namespace gem::evaluation {

struct TownDrive {
  Drive drive;  ///< on the town's ground
  std::unique_ptr<const World> town;
  /// How far the truth was lifted or lowered: recordings disagree with themselves about the height
  /// of a street that they pass twice. Metres.
  double lift_m_rms = 0;
  double lift_m_max = 0;
};

/// One street, one height. odometry * truth^-1 and corrected * truth^-1 stay what they are at every
/// scan.
TownDrive BuildTownDrive(Drive drive, std::uint64_t seed);

/// A LiDAR of 64 rings, and fewer azimuths than an HDL-64 has.
LidarOptions TownLidar(int azimuths);

/// The stretches [begin, end) of the drive in which rays are cast ahead, a batch at a time.
struct CastOptions {
  LidarOptions lidar;
  int threads = 2;
  std::uint64_t seed = 1;
  std::size_t begin = 0;
  std::size_t end = 0;  ///< 0: all
};

/// Casts the scans of a batch in parallel, then hands them over one by one, in order, on the
/// calling thread: nothing is cast while visit(scan, points) runs.
void CastScans(const TownDrive& drive, const CastOptions& options,
               const std::function<void(std::size_t, std::span<const ScanPoint>)>& visit);

}  // namespace gem::evaluation
