// Runs hot loops with the widest vectors that the machine has: the same lines, compiled once per
// set of instructions and chosen at run time, so that a shipped binary runs everywhere. No set
// changes a result: there are no fused multiply-adds and no approximations.
#pragma once

/// Before a loop whose iterations do not depend on each other, where the compiler cannot know it:
/// restrict does not survive inlining everywhere.
#if defined(__clang__)
#define GEM_INDEPENDENT _Pragma("clang loop vectorize(assume_safety)")
#else
#define GEM_INDEPENDENT _Pragma("GCC ivdep")
#endif

namespace gem {

enum class VectorSet {
  kBaseline,  ///< what the compiler may assume of every machine of the architecture
  kAvx2,
  kAvx512,
};

/// Whether this machine and its operating system have the set.
bool IsSupported(VectorSet set);

/// The widest that is supported.
VectorSet WidestVectorSet();

namespace vector_set_internal {

// flatten: all that the loop calls becomes part of it, or it would keep the baseline's vectors.
template <typename Loop>
__attribute__((flatten)) void RunBaseline(const Loop& loop) {
  loop();
}
#if defined(__x86_64__)
template <typename Loop>
__attribute__((flatten, target("avx2,bmi,bmi2,lzcnt,popcnt"))) void RunAvx2(const Loop& loop) {
  loop();
}
template <typename Loop>
__attribute__((flatten, target("avx512f,avx512bw,avx512dq,avx512vl,bmi,bmi2,lzcnt,popcnt"))) void
RunAvx512(const Loop& loop) {
  loop();
}
#endif

}  // namespace vector_set_internal

/// Calls loop(), compiled for the set, which must be supported. For loops of microseconds, not of
/// nanoseconds: the call is not inlined. What the loop calls must be inline and not recursive.
template <typename Loop>
void RunVectorised(VectorSet set, const Loop& loop) {
#if defined(__x86_64__)
  if (set == VectorSet::kAvx512) return vector_set_internal::RunAvx512(loop);
  if (set == VectorSet::kAvx2) return vector_set_internal::RunAvx2(loop);
#endif
  static_cast<void>(set);
  vector_set_internal::RunBaseline(loop);
}

}  // namespace gem
