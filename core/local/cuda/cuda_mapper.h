// The paper's GPU mapper: the steps of the cpu backend as kernels over a map that stays on the
// device. Gives the same bits as the cpu backend. Without CUDA in the build, no_cuda.cc says so.
#pragma once

#include <memory>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "core/local/local_mapper.h"

namespace gem {

/// OK if MakeCudaMapper has a device to work with; else UNAVAILABLE with the reason.
absl::Status CudaStatus();

/// The options are valid. UNAVAILABLE without a device, RESOURCE_EXHAUSTED without memory.
/// A mapper whose device fails later, or has no room for a larger scan, says so on standard error
/// and goes on with an empty map on the cpu backend.
absl::StatusOr<std::unique_ptr<LocalMapper>> MakeCudaMapper(const LocalMapOptions& options);

}  // namespace gem
