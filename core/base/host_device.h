// GEM_HOST_DEVICE marks the pure functions that the CPU and the CUDA mapper share.
#pragma once

#if defined(__CUDACC__)
#define GEM_HOST_DEVICE __host__ __device__
#else
#define GEM_HOST_DEVICE
#endif
