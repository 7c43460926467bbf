#include "server/worker_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>

#include "server/retry.h"

namespace gem {
namespace {

TEST(WorkerPool, RunsWhatItTook) {
  std::atomic<int> num_run{0};
  {
    WorkerPool pool(2, 100);
    for (int i = 0; i < 50; ++i) ASSERT_TRUE(pool.Submit([&] { ++num_run; }).ok());
  }
  EXPECT_EQ(num_run, 50);
}

TEST(WorkerPool, SaysWhenItIsFullAndWhenToComeBack) {
  std::promise<void> begun, go_on;  // outlive the pool, whose thread uses them
  WorkerPool pool(1, 1);
  ASSERT_TRUE(pool.Submit([&] {
                    begun.set_value();
                    go_on.get_future().wait();
                  })
                  .ok());
  begun.get_future().wait();                       // the thread is busy
  ASSERT_TRUE(pool.Submit([] {}).ok());            // one waits
  const absl::Status status = pool.Submit([] {});  // one too many
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(std::string(status.message()), "1 requests wait, want at most 1");
  EXPECT_EQ(RetryAfterSeconds(status), 0.1);
  go_on.set_value();
}

TEST(WorkerPool, TakesNothingOnceStopped) {
  WorkerPool pool(1, 1);
  pool.Stop();
  EXPECT_EQ(pool.Submit([] {}).code(), absl::StatusCode::kUnavailable);
}

}  // namespace
}  // namespace gem
