#include "core/local/cpu/fuse_lanes.h"

namespace gem::cpu {
namespace {

constexpr std::size_t kLanes = HitLanes::kLanes;

// The scan's part of the cells, in the middle of the scan.
struct LaneScans {
  alignas(64) float highest_m[kLanes];
  alignas(64) float highest_m2[kLanes];
  alignas(64) std::int32_t highest[kLanes];  // which hit
  alignas(64) float scan_m[kLanes];
  alignas(64) float scan_m2[kLanes];
  alignas(64) std::int32_t has_scan[kLanes];
};

ScanFusion FusionAt(const LaneCells& cells, const LaneScans& scans, std::size_t lane) {
  ScanFusion fusion;
  fusion.prior.height = {cells.prior_m[lane], cells.prior_m2[lane]};
  fusion.prior.known = cells.known[lane] != 0;
  fusion.scan.height = {scans.scan_m[lane], scans.scan_m2[lane]};
  fusion.scan.known = scans.has_scan[lane] != 0;
  fusion.pose_m2 = cells.pose_m2[lane];
  return fusion;
}

void FindHighest(const float* heights, std::int32_t count_max, const LaneCells& cells,
                 LaneScans& scans) {
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    scans.highest_m[lane] = heights[lane];
    scans.highest_m2[lane] = heights[kLanes + lane];
    scans.highest[lane] = 0;
  }
  for (std::int32_t k = 1; k < count_max; ++k) {
    const float* hit = heights + static_cast<std::size_t>(k) * 2 * kLanes;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const bool higher = (k < cells.count[lane]) & (hit[lane] > scans.highest_m[lane]);
      scans.highest_m[lane] = higher ? hit[lane] : scans.highest_m[lane];
      scans.highest_m2[lane] = higher ? hit[kLanes + lane] : scans.highest_m2[lane];
      scans.highest[lane] = higher ? k : scans.highest[lane];
    }
  }
}

// Tests the highest hit of each cell; a cell that begins or restarts takes it.
void Begin(const FuseLimits& limits, LaneCells& cells, LaneScans& scans) {
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    scans.scan_m[lane] = scans.scan_m2[lane] = 0;
    scans.has_scan[lane] = 0;
  }
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const ScanFusion fusion = FusionAt(cells, scans, lane);
    const Height highest{scans.highest_m[lane], scans.highest_m2[lane]};
    const bool known = cells.known[lane] != 0;
    const bool passes = PassesGate(fusion, highest, limits);
    const bool above = highest.elevation_m > cells.prior_m[lane];
    const bool restarted = known & !passes & above;
    const bool begun = !known | restarted;
    cells.restarted[lane] = restarted ? 1 : 0;
    cells.inflated[lane] = (known & !passes & !above & (cells.is_free[lane] != 0)) ? 1 : 0;
    cells.begun[lane] = begun ? 1 : 0;
    cells.fused[lane] = begun ? 1 : 0;
    scans.scan_m[lane] = begun ? highest.elevation_m : 0.0f;
    scans.scan_m2[lane] = begun ? highest.variance_m2 : 0.0f;
    scans.has_scan[lane] = begun ? 1 : 0;
    // That hit is in the cell already: no other has its number.
    scans.highest[lane] = begun ? scans.highest[lane] : -1;
  }
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const bool begun = cells.begun[lane] != 0;
    cells.known[lane] = begun ? 0 : 1;
    cells.prior_m[lane] = begun ? 0.0f : cells.prior_m[lane];
    cells.prior_m2[lane] = begun ? 0.0f : cells.prior_m2[lane];
  }
}

void FuseHits(const float* heights, std::int32_t count_max, const FuseLimits& limits,
              LaneCells& cells, LaneScans& scans) {
  for (std::int32_t k = 0; k < count_max; ++k) {
    const float* hit = heights + static_cast<std::size_t>(k) * 2 * kLanes;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const ScanFusion fusion = FusionAt(cells, scans, lane);
      const Height z{hit[lane], hit[kLanes + lane]};
      const CellFusion scan = FuseHit(fusion.scan, {z, 0});
      const bool passes =
          (k < cells.count[lane]) & (k != scans.highest[lane]) & PassesGate(fusion, z, limits);
      scans.scan_m[lane] = passes ? scan.height.elevation_m : scans.scan_m[lane];
      scans.scan_m2[lane] = passes ? scan.height.variance_m2 : scans.scan_m2[lane];
      scans.has_scan[lane] = passes ? 1 : scans.has_scan[lane];
      cells.fused[lane] += passes ? 1 : 0;
    }
  }
}

void End(const FuseLimits& limits, LaneCells& cells, const LaneScans& scans) {
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    const CellFusion fused = FuseScanInto(FusionAt(cells, scans, lane));
    cells.elevation_m[lane] = fused.height.elevation_m;
    cells.variance_m2[lane] =
        SettleVariance(fused.height.variance_m2, cells.inflated[lane] != 0, limits);
  }
}

}  // namespace

void FuseLanes(VectorSet set, const float* heights, std::int32_t count_max,
               const FuseLimits& limits_in, LaneCells& cells) {
  RunVectorised(set, [&] {
    const FuseLimits limits = limits_in;
    LaneScans scans;
    FindHighest(heights, count_max, cells, scans);
    Begin(limits, cells, scans);
    FuseHits(heights, count_max, limits, cells, scans);
    End(limits, cells, scans);
  });
}

}  // namespace gem::cpu
