// A source whose n-th scan has n points, taken at x = n.
#pragma once

#include "client/scan_source.h"

namespace gem::load {

class GrowingSource final : public ScanSource {
 public:
  explicit GrowingSource(std::size_t num_scans) : num_scans_(num_scans) {}
  std::string name() const override { return "growing"; }
  std::size_t num_scans() const override { return num_scans_; }
  Pose<Base, Sensor> T_B_S() const override { return {}; }
  NoiseModel noise() const override { return *MakeNoiseModel(LidarNoise{}); }
  absl::StatusOr<bool> Next(SourceScan& scan) override {
    if (next_ == num_scans_) return false;
    ++next_;
    scan.stamp_ns = static_cast<std::int64_t>(next_);
    scan.T_O_B = Pose<Odom, Base>::FromTranslation(static_cast<double>(next_), 0, 0);
    scan.points.assign(next_, {1, 2, 3, 0});
    return true;
  }

 private:
  const std::size_t num_scans_;
  std::size_t next_ = 0;
};

}  // namespace gem::load
