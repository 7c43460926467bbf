#include <cuda_runtime_api.h>

#include <array>
#include <memory>

#include "absl/strings/str_cat.h"
#include "core/gpu/runtime.h"

namespace gem::gpu {
namespace {

/// Ten times the least compute capability that kernels are built for.
constexpr int kCapabilityMin = 75;

absl::Status StatusOf(cudaError_t error, const char* call) {
  if (error == cudaSuccess) return absl::OkStatus();
  const std::string text = absl::StrCat(call, ": ", cudaGetErrorString(error));
  return error == cudaErrorMemoryAllocation ? absl::ResourceExhaustedError(text)
                                            : absl::UnavailableError(text);
}

}  // namespace

class Stream {
 public:
  ~Stream() {
    cudaStreamSynchronize(handle_);
    for (const cudaEvent_t mark : marks_)
      if (mark != nullptr) cudaEventDestroy(mark);
    if (handle_ != nullptr) cudaStreamDestroy(handle_);
  }

  absl::Status Create() {
    Note(cudaStreamCreateWithFlags(&handle_, cudaStreamNonBlocking), "cudaStreamCreate");
    for (cudaEvent_t& mark : marks_) Note(cudaEventCreate(&mark), "cudaEventCreate");
    return status_;
  }
  /// Keeps the first failure.
  void Note(cudaError_t error, const char* call) {
    if (status_.ok() && error != cudaSuccess) status_ = StatusOf(error, call);
  }

  cudaStream_t handle() const { return handle_; }
  cudaEvent_t mark(int mark) const { return marks_[static_cast<std::size_t>(mark)]; }
  const absl::Status& status() const { return status_; }

 private:
  cudaStream_t handle_ = nullptr;
  std::array<cudaEvent_t, kMarks> marks_{};
  absl::Status status_;
};

absl::Status DeviceStatus() {
  int count = 0;
  const cudaError_t error = cudaGetDeviceCount(&count);
  if (error != cudaSuccess) {
    cudaGetLastError();  // or a later call would tell of it
    return absl::UnavailableError(absl::StrCat("no CUDA device: ", cudaGetErrorString(error)));
  }
  if (count == 0) return absl::UnavailableError("no CUDA device: there is none");
  int major = 0, minor = 0;
  cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, 0);
  cudaDeviceGetAttribute(&minor, cudaDevAttrComputeCapabilityMinor, 0);
  if (10 * major + minor >= kCapabilityMin) return absl::OkStatus();
  return absl::UnavailableError(absl::StrCat("no CUDA device: this one has compute capability ",
                                             major, ".", minor, ", want 7.5 or more"));
}

absl::StatusOr<void*> Malloc(std::size_t size_bytes) {
  void* memory = nullptr;
  const absl::Status status = StatusOf(cudaMalloc(&memory, size_bytes), "cudaMalloc");
  if (!status.ok()) {
    cudaGetLastError();
    return status;
  }
  return memory;
}
void Free(void* device) { cudaFree(device); }

absl::StatusOr<void*> HostAlloc(std::size_t size_bytes) {
  void* memory = nullptr;
  const absl::Status status =
      StatusOf(cudaHostAlloc(&memory, size_bytes, cudaHostAllocDefault), "cudaHostAlloc");
  if (!status.ok()) {
    cudaGetLastError();
    return status;
  }
  return memory;
}
void HostFree(void* host) { cudaFreeHost(host); }

absl::StatusOr<Stream*> StreamCreate() {
  auto stream = std::make_unique<Stream>();
  const absl::Status status = stream->Create();
  if (!status.ok()) return status;
  return stream.release();
}
void StreamDestroy(Stream* stream) { delete stream; }

void MemcpyToDeviceAsync(void* device, const void* pinned, std::size_t size_bytes, Stream& stream) {
  stream.Note(cudaMemcpyAsync(device, pinned, size_bytes, cudaMemcpyHostToDevice, stream.handle()),
              "cudaMemcpyAsync to the device");
}
void MemcpyToHostAsync(void* pinned, const void* device, std::size_t size_bytes, Stream& stream) {
  stream.Note(cudaMemcpyAsync(pinned, device, size_bytes, cudaMemcpyDeviceToHost, stream.handle()),
              "cudaMemcpyAsync to the host");
}
void MemsetAsync(void* device, int byte, std::size_t size_bytes, Stream& stream) {
  stream.Note(cudaMemsetAsync(device, byte, size_bytes, stream.handle()), "cudaMemsetAsync");
}
void MarkAsync(int mark, Stream& stream) {
  stream.Note(cudaEventRecord(stream.mark(mark), stream.handle()), "cudaEventRecord");
}

absl::Status StreamSynchronize(Stream& stream) {
  stream.Note(cudaStreamSynchronize(stream.handle()), "cudaStreamSynchronize");
  return stream.status();
}

double ElapsedSeconds(int from, int to, const Stream& stream) {
  float elapsed_ms = 0;
  cudaEventElapsedTime(&elapsed_ms, stream.mark(from), stream.mark(to));
  return 1e-3 * static_cast<double>(elapsed_ms);
}

// For launch.h; declared there where nvcc compiles it.
void* NativeHandle(Stream& stream);
void NoteLaunch(Stream& stream);
void* NativeHandle(Stream& stream) { return stream.handle(); }
void NoteLaunch(Stream& stream) { stream.Note(cudaGetLastError(), "launch of a kernel"); }

}  // namespace gem::gpu
