// Where scans come from: a recorded dataset or the simulator. What streams them need not know
// which.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/geometry/pose.h"
#include "core/sensor/noise_model.h"
#include "core/sensor/scan.h"

namespace gem {

/// One scan of a source.
struct SourceScan {
  std::int64_t stamp_ns = 0;
  Pose<Odom, Base> T_O_B;  ///< odometry, which may drift
  std::optional<Pose<Global, Base>>
      T_G_B;                      ///< the corrected (simulator: true) pose, if the source knows it
  std::vector<ScanPoint> points;  ///< in S; finite
};

class ScanSource {
 public:
  virtual ~ScanSource() = default;

  /// For people: "kitti_00_keyframes", "block".
  virtual std::string name() const = 0;
  /// How many scans Next() will give.
  virtual std::size_t num_scans() const = 0;
  /// Where the sensor is mounted: T_B_S.
  virtual Pose<Base, Sensor> T_B_S() const = 0;
  virtual NoiseModel noise() const = 0;

  /// The next scan, in time order; nothing after the last. Buffers in `scan` are reused.
  /// An error names the file, and the line or the offset.
  virtual absl::StatusOr<bool> Next(SourceScan& scan) = 0;
};

}  // namespace gem
