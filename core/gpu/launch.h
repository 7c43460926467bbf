// Launch: the only place where kernels are started. Included by .cu files only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <utility>

#include "core/gpu/device.h"
#include "core/gpu/runtime.h"

namespace gem::gpu {

#if defined(__CUDACC__)

/// The cudaStream_t behind a stream, and what keeps the status of a launch with it.
void* NativeHandle(Stream& stream);
void NoteLaunch(Stream& stream);

/// Enqueues kernel(args...) over a grid of blocks. Parameters are copied now.
template <typename... Params, typename... Args>
void Launch(void (*kernel)(Params...), Dim grid, Dim block, std::size_t shared_bytes,
            Stream& stream, Args&&... args) {
  kernel<<<dim3(grid.x, grid.y), dim3(block.x, block.y), shared_bytes,
           static_cast<cudaStream_t>(NativeHandle(stream))>>>(
      static_cast<Params>(std::forward<Args>(args))...);
  NoteLaunch(stream);
}

#else

/// A parameter of a kernel as bytes, so that the emulation can look for pointers to the host in it.
struct ParameterBytes {
  const void* data;
  std::size_t size_bytes;
};
void EnqueueKernel(Dim grid, Dim block, std::size_t shared_bytes, Stream& stream,
                   std::initializer_list<ParameterBytes> parameters, std::function<void()> thread);

template <typename... Params, typename... Args>
void Launch(void (*kernel)(Params...), Dim grid, Dim block, std::size_t shared_bytes,
            Stream& stream, Args&&... args) {
  const auto enqueue = [&](Params... params) {
    EnqueueKernel(grid, block, shared_bytes, stream, {ParameterBytes{&params, sizeof(params)}...},
                  [=] { kernel(params...); });
  };
  enqueue(static_cast<Params>(std::forward<Args>(args))...);
}

#endif

/// Blocks of `block` that cover `count`; at least one.
constexpr std::uint32_t BlocksOver(std::uint32_t count, std::uint32_t block) {
  return count > block ? (count - 1) / block + 1 : 1;
}

}  // namespace gem::gpu
