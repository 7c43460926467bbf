// GEM_CHECK: ends the process when an invariant of ours is broken.
// Not for anything that a robot, a file or an operator can cause: that is an absl::Status.
#pragma once

#include <cstdio>
#include <cstdlib>

namespace gem::internal {

[[noreturn]] inline void CheckFailed(const char* condition, const char* file, int line) {
  std::fprintf(stderr, "%s:%d: check failed: %s\n", file, line, condition);
  std::abort();
}

}  // namespace gem::internal

#define GEM_CHECK(condition)                                        \
  do {                                                              \
    if (!(condition)) [[unlikely]]                                  \
      ::gem::internal::CheckFailed(#condition, __FILE__, __LINE__); \
  } while (false)
