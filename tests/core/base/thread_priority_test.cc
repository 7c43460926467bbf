#include "core/base/thread_priority.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <thread>

namespace gem {
namespace {

int Niceness() { return getpriority(PRIO_PROCESS, static_cast<id_t>(gettid())); }

// Scans must not wait for a map that is being rendered, nor for the threads that help to render it.
TEST(RunBehindOthers, IsForTheThreadAndThoseThatItStarts) {
  const int before = Niceness();
  int niceness = 0, of_started = 0;
  std::thread([&] {
    RunBehindOthers();
    niceness = Niceness();
    std::thread([&] { of_started = Niceness(); }).join();
  }).join();
  EXPECT_GT(niceness, before);
  EXPECT_EQ(of_started, niceness);
  EXPECT_EQ(Niceness(), before);
}

}  // namespace
}  // namespace gem
