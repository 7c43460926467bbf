#include "client/send_buffer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gem/v1/ingest_service.pb.h"

namespace gem::client {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::uint64_t kScanBytes = 100;

class SendBufferTest : public ::testing::Test {
 protected:
  explicit SendBufferTest(const SendBuffer::Limits& limits = {1000, 2}) : buffer_(limits) {}

  void AddScan(std::int64_t stamp_ns) {
    auto request = std::make_shared<v1::IngestRequest>();
    request->mutable_scan()->set_stamp_ns(stamp_ns);
    buffer_.AddScan(std::move(request), kScanBytes);
  }
  void AddPoses(std::int64_t stamp_ns) {
    auto request = std::make_shared<v1::IngestRequest>();
    request->mutable_poses()->add_poses()->set_stamp_ns(stamp_ns);
    buffer_.AddPoses(std::move(request), 10);
  }
  /// What is written with so much credit: "poses 5", "scan 1 at 7".
  std::vector<std::string> Write(std::uint64_t num_scans = 1000) {
    std::vector<std::string> written;
    auto credit_bytes = static_cast<std::int64_t>(num_scans * kScanBytes);
    while (const auto request = buffer_.TakeNext(credit_bytes)) {
      written.push_back(
          request->has_poses()
              ? absl::StrCat("poses ", request->poses().poses(0).stamp_ns())
              : absl::StrCat("scan ", request->scan().seq(), " at ", request->scan().stamp_ns()));
    }
    return written;
  }

  SendBuffer buffer_;
};

TEST_F(SendBufferTest, NumbersScansAndLetsPosesOvertakeThem) {
  AddScan(10);
  AddPoses(11);
  AddScan(20);
  AddPoses(21);
  EXPECT_THAT(Write(1), ElementsAre("poses 11", "poses 21", "scan 1 at 10"));
  AddPoses(22);
  EXPECT_THAT(Write(0), ElementsAre("poses 22"));
  EXPECT_THAT(Write(), ElementsAre("scan 2 at 20"));
  EXPECT_TRUE(buffer_.all_written());
  EXPECT_FALSE(buffer_.all_fused());
  buffer_.Acknowledge(2);
  EXPECT_TRUE(buffer_.all_fused());
}

TEST_F(SendBufferTest, SendsAgainWhatTheServerDoesNotHave) {
  for (const std::int64_t stamp_ns : {10, 20, 30}) {
    AddScan(stamp_ns);
    Write();
  }
  ASSERT_TRUE(buffer_.Resume(1).ok());
  EXPECT_EQ(buffer_.written_seq(), 1u);
  EXPECT_THAT(Write(), ElementsAre("scan 2 at 20", "scan 3 at 30"));
  // Scan 1 is accepted, but kept until it is fused.
  ASSERT_TRUE(buffer_.Resume(0).ok());
  EXPECT_THAT(Write(), ElementsAre("scan 1 at 10", "scan 2 at 20", "scan 3 at 30"));
}

TEST_F(SendBufferTest, PosesStayInOrderWhenAStreamBreaks) {
  // What the user saw: after a reconnect new poses overtook older ones that had to be sent again;
  // the server refused those, and put the scans on the way between them in the wrong place.
  for (const std::int64_t stamp_ns : {10, 20, 30}) {
    AddScan(stamp_ns);
    Write();
    AddPoses(stamp_ns + 5);
    Write();
  }
  AddScan(40);
  ASSERT_TRUE(buffer_.Resume(1).ok());
  AddPoses(45);
  EXPECT_THAT(Write(), ElementsAre("poses 15", "poses 25", "poses 35", "poses 45", "scan 2 at 20",
                                   "scan 3 at 30", "scan 4 at 40"));
}

TEST_F(SendBufferTest, KeepsPosesUntilTheScanAfterThemIsFused) {
  AddPoses(5);
  AddScan(10);
  Write();
  AddPoses(15);
  AddScan(20);
  Write();
  buffer_.Acknowledge(1);
  ASSERT_TRUE(buffer_.Resume(1).ok());
  EXPECT_THAT(Write(), ElementsAre("poses 15", "scan 2 at 20"));
  buffer_.Acknowledge(2);
  ASSERT_TRUE(buffer_.Resume(2).ok());
  EXPECT_THAT(Write(), IsEmpty());
}

class LargeSendBufferTest : public SendBufferTest {
 protected:
  LargeSendBufferTest() : SendBufferTest({1'000'000, 2}) {}
};

TEST_F(LargeSendBufferTest, KeepsAllPosesWhileScansAreOnTheirWay) {
  // What the user saw: a stream broke while fifty scans were on their way, and the scan after the
  // oldest of them lay beside the others in the map: its poses were no longer there to be repeated.
  for (std::int64_t i = 1; i <= 100; ++i) {
    AddScan(10 * i);
    Write();
    AddPoses(10 * i + 5);
    Write();
  }
  ASSERT_TRUE(buffer_.Resume(0).ok());
  EXPECT_EQ(Write(0).size(), 100u);
}

TEST_F(SendBufferTest, KeepsSomePosesOfARobotWithoutScans) {
  for (std::int64_t i = 1; i <= 1000; ++i) {
    ASSERT_TRUE(buffer_.HasRoomForPoses(10)) << i;
    AddPoses(i);
    Write();
  }
  ASSERT_TRUE(buffer_.Resume(0).ok());
  const std::vector<std::string> written = Write();
  EXPECT_EQ(written.size(), 65u);
  EXPECT_EQ(written.front(), "poses 936");
}

TEST_F(SendBufferTest, GoesOnAfterTheNumbersOfAnEarlierProcess) {
  buffer_.Begin(7);
  EXPECT_TRUE(buffer_.all_fused());
  AddScan(10);
  EXPECT_THAT(Write(), ElementsAre("scan 8 at 10"));
}

TEST_F(SendBufferTest, NamesWhatTheServerWantsAndWhatIsKept) {
  AddScan(10);
  AddScan(20);
  Write();
  buffer_.Acknowledge(1);
  const absl::Status forgotten = buffer_.Resume(0);
  EXPECT_TRUE(absl::IsDataLoss(forgotten)) << forgotten;
  EXPECT_EQ(forgotten.message(), "it wants scan 1, the oldest that is kept is 2");
  const absl::Status foreign = buffer_.Resume(3);
  EXPECT_TRUE(absl::IsFailedPrecondition(foreign)) << foreign;
  EXPECT_THAT(std::string(foreign.message()), HasSubstr("the server has scan 3, the newest sent"));
}

TEST_F(SendBufferTest, IsBoundedInBytesAndInNumber) {
  EXPECT_TRUE(buffer_.HasRoomForScan(5000));  // one always fits
  AddScan(10);
  EXPECT_FALSE(buffer_.HasRoomForScan(901));
  EXPECT_TRUE(buffer_.HasRoomForScan(900));
  AddScan(20);
  EXPECT_FALSE(buffer_.HasRoomForScan(1));  // two wait to be written
  Write();
  EXPECT_TRUE(buffer_.HasRoomForScan(800));
  EXPECT_FALSE(buffer_.HasRoomForScan(801));
  buffer_.Acknowledge(1);
  EXPECT_TRUE(buffer_.HasRoomForScan(900));
  for (std::int64_t stamp_ns = 1; stamp_ns <= 16; ++stamp_ns) {
    EXPECT_TRUE(buffer_.HasRoomForPoses(10));
    AddPoses(stamp_ns);
  }
  EXPECT_FALSE(buffer_.HasRoomForPoses(10));
}

class DroppingSendBufferTest : public SendBufferTest {
 protected:
  DroppingSendBufferTest() : SendBufferTest({1000, 3, /*drop_oldest=*/true}) {}
};

TEST_F(DroppingSendBufferTest, DropsTheOldestUnsentScansAndNumbersTheRestWithoutAGap) {
  AddScan(10);
  EXPECT_THAT(Write(1), ElementsAre("scan 1 at 10"));
  for (const std::int64_t stamp_ns : {20, 30, 40, 50, 60}) {
    EXPECT_TRUE(buffer_.HasRoomForScan(kScanBytes));
    AddScan(stamp_ns);
  }
  EXPECT_EQ(buffer_.num_dropped(), 2u);
  EXPECT_THAT(Write(), ElementsAre("scan 2 at 40", "scan 3 at 50", "scan 4 at 60"));
}

TEST_F(DroppingSendBufferTest, WhatTheServerHasNotAcceptedGivesWayToNewerScans) {
  for (const std::int64_t stamp_ns : {10, 20, 30}) {
    AddScan(stamp_ns);
    Write();
  }
  AddScan(40);
  ASSERT_TRUE(buffer_.Resume(1).ok());  // 20 and 30 are unsent again
  AddScan(50);
  EXPECT_EQ(buffer_.num_dropped(), 1u);
  EXPECT_THAT(Write(), ElementsAre("scan 2 at 30", "scan 3 at 40", "scan 4 at 50"));
  buffer_.Acknowledge(4);
  EXPECT_TRUE(buffer_.all_fused());
}

TEST_F(DroppingSendBufferTest, KeepsWhatIsOnItsWayAndTheNewestWhateverTheirSize) {
  for (std::int64_t i = 1; i <= 10; ++i) {
    AddScan(10 * i);
    Write();
  }
  AddScan(110);  // 1100 bytes: too much, but it is the newest
  EXPECT_EQ(buffer_.num_dropped(), 0u);
  AddScan(120);
  EXPECT_EQ(buffer_.num_dropped(), 1u);
  buffer_.Acknowledge(10);
  EXPECT_THAT(Write(), ElementsAre("scan 11 at 120"));
}

TEST_F(DroppingSendBufferTest, GathersPosesIntoFewBatches) {
  for (std::int64_t stamp_ns = 1; stamp_ns <= 5000; ++stamp_ns) AddPoses(stamp_ns);
  AddPoses(5000);  // repeated: not in one batch with what it repeats
  EXPECT_THAT(Write(), ElementsAre("poses 1", "poses 4097", "poses 5000"));
}

TEST_F(DroppingSendBufferTest, ForgetsPosesOfAServerThatFusesNothing) {
  AddScan(10);
  Write();
  for (std::int64_t stamp_ns = 1; stamp_ns <= 100; ++stamp_ns) {
    AddPoses(stamp_ns);
    Write();
  }
  ASSERT_TRUE(buffer_.Resume(0).ok());
  // Ten bytes each: 90 beside the scan's 100 are what 1000 hold. They are one batch now.
  EXPECT_THAT(Write(), ElementsAre("poses 11", "scan 1 at 10"));
}

class LongSilenceTest : public SendBufferTest {
 protected:
  LongSilenceTest() : SendBufferTest({1'000'000, 3, /*drop_oldest=*/true}) {}
};

TEST_F(LongSilenceTest, DropsScansWithTheirPoses) {
  // 16 batches of 4096 poses a millisecond apart, 65.536 s, are kept; then the first 4.096 s go.
  AddScan(3'000'000'000);
  AddScan(5'096'000'000);  // its sweep may reach back by a second
  AddScan(5'097'000'000);
  for (std::int64_t i = 1; i <= 16 * 4096; ++i) AddPoses(i * 1'000'000);
  EXPECT_EQ(buffer_.num_dropped(), 0u);
  AddPoses(std::int64_t{16 * 4096 + 1} * 1'000'000);
  EXPECT_EQ(buffer_.num_dropped(), 2u);
  const std::vector<std::string> written = Write();
  EXPECT_EQ(written.front(), "poses 4097000000");
  EXPECT_EQ(written.back(), "scan 1 at 5097000000");
}

TEST_F(SendBufferTest, BelievesNoAcknowledgementOfWhatWasNotWritten) {
  AddScan(10);
  buffer_.Acknowledge(1000);
  EXPECT_EQ(buffer_.fused_seq(), 0u);
  EXPECT_THAT(Write(), ElementsAre("scan 1 at 10"));
}

}  // namespace
}  // namespace gem::client
