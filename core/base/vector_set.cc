#include "core/base/vector_set.h"

namespace gem {

bool IsSupported(VectorSet set) {
#if defined(__x86_64__)
  switch (set) {
    case VectorSet::kAvx512:
      return IsSupported(VectorSet::kAvx2) && __builtin_cpu_supports("avx512f") &&
             __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
             __builtin_cpu_supports("avx512vl");
    case VectorSet::kAvx2:
      return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") &&
             __builtin_cpu_supports("bmi2");
    case VectorSet::kBaseline:
      return true;
  }
#endif
  return set == VectorSet::kBaseline;
}

VectorSet WidestVectorSet() {
  static const VectorSet widest = IsSupported(VectorSet::kAvx512) ? VectorSet::kAvx512
                                  : IsSupported(VectorSet::kAvx2) ? VectorSet::kAvx2
                                                                  : VectorSet::kBaseline;
  return widest;
}

}  // namespace gem
