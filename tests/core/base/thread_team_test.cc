#include "core/base/thread_team.h"

#include <gtest/gtest.h>

#include <vector>

namespace gem {
namespace {

TEST(ThreadTeam, CallsEachMemberOncePerRoundAndWaitsForAll) {
  for (const int size : {1, 2, 3}) {
    ThreadTeam team(size);
    ASSERT_EQ(team.size(), size);
    std::vector<int> calls(static_cast<std::size_t>(size), 0);
    for (int round = 1; round <= 1000; ++round) {
      team.Run([&](int i) { ++calls[static_cast<std::size_t>(i)]; });
      for (const int count : calls) ASSERT_EQ(count, round);
    }
  }
}

// A call that wakes the team is no round: nobody works on it, and none is missed.
TEST(ThreadTeam, WakingIsNotARound) {
  ThreadTeam team(3);
  std::vector<int> calls(3, 0);
  for (int round = 1; round <= 200; ++round) {
    for (int i = 0; i < round % 3; ++i) team.Wake();
    team.Run([&](int i) { ++calls[static_cast<std::size_t>(i)]; });
    for (const int count : calls) ASSERT_EQ(count, round);
  }
  team.Wake();
}

TEST(ThreadTeam, MayBeDismissedWithoutWork) { ThreadTeam team(4); }

TEST(Piece, PiecesCoverTheWholeOnce) {
  for (const std::size_t count : {0u, 1u, 7u, 100u}) {
    std::size_t next = 0;
    for (int i = 0; i < 3; ++i) {
      EXPECT_EQ(PieceOf(count, i, 3).begin, next);
      next = PieceOf(count, i, 3).end;
    }
    EXPECT_EQ(next, count);
  }
}

}  // namespace
}  // namespace gem
