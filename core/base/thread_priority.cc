#include "core/base/thread_priority.h"

#include <sys/resource.h>
#include <unistd.h>

namespace gem {

void RunBehindOthers() {
  // Linux keeps a niceness for each thread. Raising it is never refused.
  constexpr int kStep = 10;
  const auto thread = static_cast<id_t>(gettid());
  setpriority(PRIO_PROCESS, thread, getpriority(PRIO_PROCESS, thread) + kStep);
}

}  // namespace gem
