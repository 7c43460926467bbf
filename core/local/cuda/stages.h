// The numbered steps of the local mapper on the device (paper Algorithm 1): each enqueues its
// kernels and returns. Pointers are device memory; stages.cu holds the kernels.
#pragma once

#include "core/gpu/radix_sort.h"
#include "core/gpu/runtime.h"
#include "core/local/cuda/device_map.h"
#include "core/local/local_map_options.h"
#include "core/local/measure.h"

namespace gem::cuda {

/// Writes the known cells of `leaving` to `evicted` in their order and forgets them. offsets: room
/// for leaving.count() numbers. leaving.count() >= 1. Counts kEvicted.
void EnqueueEvict(const DeviceLayers& layers, const DeviceWindow& window,
                  const LeavingPlaces& leaving, std::uint32_t* offsets, EvictedCell* evicted,
                  std::uint32_t* counters, gpu::Stream& stream);

/// Adds to the variance of every known cell.
void EnqueueGrow(const DeviceLayers& layers, std::uint32_t num_cells, float growth_m2,
                 const FuseLimits& limits, gpu::Stream& stream);

/// Eqs. (1)-(4) for every point, the rays' slopes, and the fates.
void EnqueueMeasure(const ScanFrame& frame, const DeviceRays& rays, const DeviceScan& scan,
                    gpu::Stream& stream);

/// What fusing and clearing need to know.
struct FuseTask {
  std::int64_t stamp_ns;
  ScanFrame frame;
  FuseLimits limits;
  float traversability_free;
};
// Without gaps: the emulation looks for pointers of the host in what kernels are given.
static_assert(sizeof(FuseTask) ==
              sizeof(std::int64_t) + sizeof(ScanFrame) + sizeof(FuseLimits) + sizeof(float));

/// Finds the runs of the sorted keys, then eqs. (5)-(6) for every cell.
void EnqueueFuse(const DeviceLayers& layers, const DeviceWindow& window, const FuseTask& task,
                 const DeviceScan& scan, gpu::Stream& stream);

/// Eq. (7) for the known cells around changed ones. Heights are summed relative to reference_m, in
/// O: the sensor's, as in every backend.
void EnqueueAnnotate(const DeviceLayers& layers, const DeviceWindow& window,
                     const LocalMapOptions& options, float reference_m, const std::uint8_t* changed,
                     gpu::Stream& stream);

/// Section IV-C: completes the rays' table, clears, and fuses what a cleared cell's own points say.
void EnqueueClear(const DeviceLayers& layers, const DeviceWindow& window,
                  const LocalMapOptions& options, const FuseTask& task, const DeviceRays& rays,
                  const DeviceScan& scan, gpu::Stream& stream);

}  // namespace gem::cuda
