#include "core/local/cuda/cuda_mapper.h"

namespace gem {

absl::Status CudaStatus() { return absl::UnavailableError("built without CUDA"); }

absl::StatusOr<std::unique_ptr<LocalMapper>> MakeCudaMapper(const LocalMapOptions& /*options*/) {
  return CudaStatus();
}

}  // namespace gem
