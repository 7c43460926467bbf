// The CUDA sources, compiled as C++.
#include "core/gpu/radix_sort.cu"
#include "core/local/cuda/stages.cu"
