// Names threads after what they do, for those who look at a running server: top -H, perf, gdb.
#pragma once

#include <pthread.h>

namespace gem {

/// Names the calling thread; at most 15 characters.
inline void NameThread(const char* name) { pthread_setname_np(pthread_self(), name); }

}  // namespace gem
