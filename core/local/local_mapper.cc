#include "core/local/local_mapper.h"

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/local/cpu_mapper.h"
#include "core/local/cuda/cuda_mapper.h"
#include "core/local/reference_mapper.h"

namespace gem {

absl::StatusOr<std::unique_ptr<LocalMapper>> MakeLocalMapper(LocalBackend backend,
                                                             const LocalMapOptions& options,
                                                             int threads) {
  GEM_RETURN_IF_ERROR(Validate(options));
  if (threads < 1 || threads > kLocalThreadsMax) {
    return absl::InvalidArgumentError(
        absl::StrCat("threads is ", threads, ", want [1, ", kLocalThreadsMax, "]"));
  }
  switch (backend) {
    case LocalBackend::kReference:
      return MakeReferenceMapper(options);
    case LocalBackend::kCpu:
      return MakeCpuMapper(options, threads);
    case LocalBackend::kCuda:
      return MakeCudaMapper(options);
    case LocalBackend::kAuto:
      return MakeLocalMapper(ChooseLocalBackend(backend).backend, options, threads);
  }
  return absl::InvalidArgumentError(
      absl::StrCat("local backend is ", static_cast<int>(backend), ", want one that exists"));
}

BackendChoice ChooseLocalBackend(LocalBackend wanted) {
  if (wanted != LocalBackend::kCuda && wanted != LocalBackend::kAuto) return {wanted, ""};
  const absl::Status status = CudaStatus();
  if (status.ok()) return {LocalBackend::kCuda, ""};
  return {LocalBackend::kCpu, std::string(status.message())};
}

absl::StatusOr<LocalBackend> ParseLocalBackend(absl::string_view name) {
  for (const LocalBackend backend :
       {LocalBackend::kReference, LocalBackend::kCpu, LocalBackend::kCuda, LocalBackend::kAuto}) {
    if (name == NameOf(backend)) return backend;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("local backend is \"", name, "\", want reference, cpu, cuda or auto"));
}

absl::string_view NameOf(LocalBackend backend) {
  switch (backend) {
    case LocalBackend::kReference:
      return "reference";
    case LocalBackend::kCpu:
      return "cpu";
    case LocalBackend::kCuda:
      return "cuda";
    case LocalBackend::kAuto:
      return "auto";
  }
  return "unknown";
}

}  // namespace gem
