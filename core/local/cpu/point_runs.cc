#include "core/local/cpu/point_runs.h"

#include <algorithm>

namespace gem::cpu {
namespace {

// Points from one look to the next.
constexpr std::size_t kStep = 512;
// A run has hardly more points, so that threads can share what is left at the end.
constexpr std::size_t kRunMax = 1024;

std::uint32_t OwnerOf(float azimuth, std::span<const AzimuthSector> sectors) {
  const auto azimuth_bin = static_cast<std::int32_t>(azimuth);
  for (std::uint32_t i = 0; i + 1 < sectors.size(); ++i)
    if (sectors[i].Holds(azimuth_bin)) return i;
  return static_cast<std::uint32_t>(sectors.size()) - 1;
}

// How far on the way from one direction to another, the short way round, the sector of the first
// one ends. In [0, 1].
float ShareWithin(const AzimuthSector& sector, float from, float to, const RayBins& bins) {
  const auto turn = static_cast<float>(bins.azimuth);
  float change = to - from;
  if (change > 0.5f * turn) change -= turn;
  if (change < -0.5f * turn) change += turn;
  const float left =
      change > 0 ? static_cast<float>(sector.end) - from : from - static_cast<float>(sector.begin);
  return std::clamp(left / std::max(std::fabs(change), 1.0f), 0.0f, 1.0f);
}

}  // namespace

void PointRuns::Plan(VectorSet set, const ScanFrame& frame, const Scan& scan, const RayBins& bins,
                     std::span<const AzimuthSector> sectors) {
  runs_.clear();
  if (sectors.size() == 1) {
    const auto num_points = static_cast<std::uint32_t>(scan.num_points());
    if (num_points != 0) runs_.push_back({0, num_points, 0});
  } else {
    Look(set, frame, scan, bins);
    Cut(scan.num_points(), bins, sectors);
  }
  Deal();
}

void PointRuns::Look(VectorSet set, const ScanFrame& frame_in, const Scan& scan,
                     const RayBins& bins_in) {
  const std::size_t num_looks = (scan.num_points() + kStep - 1) / kStep;
  for (std::vector<float>* values : {&x_m_, &y_m_, &azimuth_}) values->resize(num_looks);
  RunVectorised(set, [&] {
    const ScanFrame frame = frame_in;
    const RayBins bins = bins_in;
    float *x_m = x_m_.data(), *y_m = y_m_.data(), *azimuth = azimuth_.data();
    for (std::size_t i = 0; i < num_looks; ++i) {
      const Offset offset = OffsetOf(frame, scan.PointAt(i * kStep));
      x_m[i] = offset.x_m;
      y_m[i] = offset.y_m;
    }
    GEM_INDEPENDENT
    for (std::size_t i = 0; i < num_looks; ++i) azimuth[i] = AzimuthOf(x_m[i], y_m[i], bins);
  });
}

void PointRuns::Cut(std::size_t num_points, const RayBins& bins,
                    std::span<const AzimuthSector> sectors) {
  if (num_points == 0) return;
  PointRun run{0, 0, OwnerOf(azimuth_[0], sectors)};
  const auto end_at = [&](std::size_t end, std::uint32_t next_owner) {
    run.end = static_cast<std::uint32_t>(end);
    if (run.begin < run.end) runs_.push_back(run);
    run = {run.end, 0, next_owner};
  };
  for (std::size_t i = 1; i < azimuth_.size(); ++i) {
    const std::uint32_t owner = OwnerOf(azimuth_[i], sectors);
    if (owner != run.owner) {
      const float share = ShareWithin(sectors[run.owner], azimuth_[i - 1], azimuth_[i], bins);
      const auto within = static_cast<std::size_t>(share * static_cast<float>(kStep));
      end_at((i - 1) * kStep + within, owner);
    } else if (i * kStep >= run.begin + kRunMax) {
      end_at(i * kStep, owner);
    }
  }
  end_at(num_points, 0);
}

void PointRuns::Deal() {
  order_.resize(runs_.size());
  std::size_t count = 0;
  for (std::uint32_t owner = 0; owner < shelves_.size(); ++owner) {
    shelves_[owner].next.store(count, std::memory_order_relaxed);
    for (std::uint32_t run = 0; run < runs_.size(); ++run)
      if (runs_[run].owner == owner) order_[count++] = run;
    shelves_[owner].end = count;
  }
}

}  // namespace gem::cpu
