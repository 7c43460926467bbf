#include "client/retry_thread.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>

#include "absl/synchronization/notification.h"
#include "client/watch_state.h"

namespace gem::client {
namespace {

using ::testing::HasSubstr;

TEST(RetryThread, TriesUntilNoFurtherTryCanHelp) {
  std::atomic<int> num_tries{0};
  absl::Notification ended;
  RetryThread thread({1e-4, 1e-3}, [&](Interrupt&) {
    const bool last = ++num_tries == 5;
    if (last) ended.Notify();
    return RetryThread::Outcome{absl::UnavailableError("away"), false, last};
  });
  ended.WaitForNotification();
  EXPECT_EQ(num_tries, 5);
}

// A mirror that is destroyed while its server is away must not wait for the pause.
TEST(RetryThread, EndsInTheMiddleOfAPause) {
  absl::Notification tried;
  const auto start = std::chrono::steady_clock::now();
  {
    RetryThread thread({3600, 3600}, [&](Interrupt&) {
      tried.Notify();
      return RetryThread::Outcome{};
    });
    tried.WaitForNotification();
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(60));
}

TEST(RetryThread, WakesATryThatBlocks) {
  absl::Notification armed, woken;
  {
    RetryThread thread({}, [&](Interrupt& interrupt) {
      EXPECT_TRUE(interrupt.Arm([&] { woken.Notify(); }));
      armed.Notify();
      woken.WaitForNotification();
      interrupt.Disarm();
      EXPECT_FALSE(interrupt.Arm([] {})) << "it is over: nothing new may begin";
      return RetryThread::Outcome{};
    });
    armed.WaitForNotification();
  }
  EXPECT_TRUE(woken.HasBeenNotified());
}

TEST(WatchState, CountsReconnectsAndSaysWhenItIsBehind) {
  WatchState state;
  EXPECT_GT(state.stats().lag_s, 0) << "nothing has come yet";
  state.Receive(100, true, true);
  EXPECT_TRUE(state.stats().connected);
  EXPECT_GT(state.stats().lag_s, 0) << "the rest of a change is due";
  state.Receive(50, false, false);
  EXPECT_EQ(state.stats().lag_s, 0);
  EXPECT_EQ(state.stats().received_bytes, 150u);
  state.Break(absl::UnavailableError("gone"), false);
  EXPECT_FALSE(state.stats().connected);
  EXPECT_GT(state.stats().lag_s, 0);
  EXPECT_EQ(state.stats().num_reconnects, 0u) << "nobody has answered again yet";
  state.Receive(1, true, false);
  EXPECT_EQ(state.stats().num_reconnects, 1u);
  EXPECT_EQ(state.stats().lag_s, 0);
}

TEST(WatchState, AWaitSaysWhyThereIsNothing) {
  WatchState state;
  const auto never = [] { return false; };
  absl::Status status = state.WaitUntil(never, 0);
  EXPECT_TRUE(absl::IsDeadlineExceeded(status));
  state.Break(absl::UnavailableError("server 1.2.3.4:5: refused"), false);
  status = state.WaitUntil(never, 0);
  EXPECT_TRUE(absl::IsDeadlineExceeded(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr("1.2.3.4:5: refused"));
  state.Receive(1, true, false);
  EXPECT_EQ(state.WaitUntil(never, 0).message(), "nothing new within 0 s") << "it is back";
  state.Break(absl::InvalidArgumentError("level is 9"), true);
  EXPECT_TRUE(absl::IsInvalidArgument(state.WaitUntil(never, 1e9))) << "it has ended";
  EXPECT_TRUE(state.WaitUntil([] { return true; }, 0).ok());
}

TEST(WatchState, WakesWhoWaits) {
  WatchState state;
  std::atomic<bool> there{false};
  std::thread waiter([&] { EXPECT_TRUE(state.WaitUntil([&] { return there.load(); }, 1e9).ok()); });
  there = true;
  state.Notify();
  waiter.join();
}

}  // namespace
}  // namespace gem::client
