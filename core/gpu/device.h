// What a kernel may use of the device: its place in the grid, the barrier, shared memory, one
// shuffle, two atomics. Kernels are ordinary functions over these, so the same sources compile with
// nvcc, and as C++ for the tests, where tests/emulation defines what is only declared here.
#pragma once

#include <cstdint>

#if defined(__CUDACC__)
#define GEM_KERNEL static __global__ void
#define GEM_DEVICE __device__
#else
#define GEM_KERNEL static void
#define GEM_DEVICE
#endif

namespace gem::gpu {

/// Extent of a grid or a block, or a place in it.
struct Dim {
  std::uint32_t x = 1;
  std::uint32_t y = 1;
};

/// Lanes of a warp. Blocks whose kernels shuffle have a multiple of it.
inline constexpr std::uint32_t kWarpLanes = 32;

/// Of the running thread.
GEM_DEVICE Dim ThreadIndex();
GEM_DEVICE Dim BlockIndex();
GEM_DEVICE Dim BlockDim();
GEM_DEVICE Dim GridDim();

/// Every thread of the block must come here, also those without work.
GEM_DEVICE void SyncThreads();

/// The dynamic shared memory of the block; its content is undefined when the block begins. 16-byte
/// aligned.
GEM_DEVICE void* SharedBytes();

/// The value of the lane `delta` below, or the own value where there is none. All lanes take part.
GEM_DEVICE std::uint32_t ShuffleUp(std::uint32_t value, std::uint32_t delta);

/// On global or shared memory; both return the value from before.
GEM_DEVICE std::uint32_t AtomicAdd(std::uint32_t* to, std::uint32_t value);
GEM_DEVICE std::uint32_t AtomicMin(std::uint32_t* to, std::uint32_t value);

#if defined(__CUDACC__)
extern __shared__ __align__(16) unsigned char gem_shared_bytes[];

GEM_DEVICE inline Dim ThreadIndex() { return {threadIdx.x, threadIdx.y}; }
GEM_DEVICE inline Dim BlockIndex() { return {blockIdx.x, blockIdx.y}; }
GEM_DEVICE inline Dim BlockDim() { return {blockDim.x, blockDim.y}; }
GEM_DEVICE inline Dim GridDim() { return {gridDim.x, gridDim.y}; }
GEM_DEVICE inline void SyncThreads() { __syncthreads(); }
GEM_DEVICE inline void* SharedBytes() { return gem_shared_bytes; }
GEM_DEVICE inline std::uint32_t ShuffleUp(std::uint32_t value, std::uint32_t delta) {
  return __shfl_up_sync(0xffffffffu, value, delta);
}
GEM_DEVICE inline std::uint32_t AtomicAdd(std::uint32_t* to, std::uint32_t value) {
  return atomicAdd(to, value);
}
GEM_DEVICE inline std::uint32_t AtomicMin(std::uint32_t* to, std::uint32_t value) {
  return atomicMin(to, value);
}
#endif

/// Place of the running thread in a grid and blocks of one dimension.
GEM_DEVICE inline std::uint32_t GlobalIndex() {
  return BlockIndex().x * BlockDim().x + ThreadIndex().x;
}

}  // namespace gem::gpu
