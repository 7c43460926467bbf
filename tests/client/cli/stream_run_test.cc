#include "client/cli/stream_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <mutex>

#include "tests/client/fake_server.h"

namespace gem::client {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// Scans of one point; corrected poses lie a metre to the north.
class ShortSource : public ScanSource {
 public:
  ShortSource(std::size_t num_scans, bool corrected)
      : num_scans_(num_scans), corrected_(corrected) {}

  std::string name() const override { return "short"; }
  std::size_t num_scans() const override { return num_scans_; }
  Pose<Base, Sensor> T_B_S() const override { return {}; }
  NoiseModel noise() const override { return MakeNoiseModel(LidarNoise{}).value(); }
  absl::StatusOr<bool> Next(SourceScan& scan) override {
    if (next_ == num_scans_) return false;
    ++next_;
    const auto x_m = static_cast<double>(next_);
    scan.stamp_ns = static_cast<std::int64_t>(next_) * 10;
    scan.T_O_B = Pose<Odom, Base>::FromTranslation(x_m, 0, 0);
    scan.T_G_B.reset();
    if (corrected_) scan.T_G_B = Pose<Global, Base>::FromTranslation(x_m, 1, 0);
    scan.points = {{1, 2, 3, 0}};
    return true;
  }

 private:
  const std::size_t num_scans_;
  const bool corrected_;
  std::size_t next_ = 0;
};

/// Writes down what reaches the server, in order.
class StreamRunTest : public ::testing::Test {
 protected:
  StreamRunTest() {
    flags_.server = server_.address();
    flags_.session = "monday";
    server_.ingest.on_ingest = [this](int, ServerStream& stream) -> grpc::Status {
      AnswerOpen(stream, resume_after_seq_);
      v1::IngestRequest request;
      while (stream.Read(&request)) {
        if (request.has_close()) {
          Note("close");
          v1::IngestResponse response;
          response.mutable_closed()->set_num_scans_refused(num_refused_);
          stream.Write(response);
          return grpc::Status::OK;
        }
        Note(absl::StrCat("scan ", request.scan().seq(), " at ", request.scan().stamp_ns()));
        Acknowledge(stream, request.scan().seq(), request.scan().seq(), 12);
      }
      return grpc::Status::OK;
    };
    server_.ingest.on_correct = [this](const auto& request, auto&) {
      EXPECT_EQ(request.session(), "monday");
      const auto& last = request.poses(request.poses_size() - 1);
      EXPECT_EQ(last.map_from_base().y(), 1);
      Note(absl::StrCat("correct ", request.poses_size(), " poses to ", last.stamp_ns()));
      return grpc::Status::OK;
    };
  }

  absl::Status Stream(std::size_t num_scans, bool corrected = true) {
    ShortSource source(num_scans, corrected);
    return StreamToServer(source, flags_);
  }
  void Note(const std::string& event) {
    const std::lock_guard lock(mutex_);
    events_.push_back(event);
  }

  StreamFlags flags_;
  std::uint64_t resume_after_seq_ = 0;
  std::uint64_t num_refused_ = 0;
  std::mutex mutex_;
  std::vector<std::string> events_;
  FakeServer server_;  // stops before what its handlers use goes away
};

TEST_F(StreamRunTest, SendsEveryScanAndCloses) {
  ASSERT_TRUE(Stream(2).ok());
  EXPECT_THAT(events_, ElementsAre("scan 1 at 10", "scan 2 at 20", "close"));
}

TEST_F(StreamRunTest, CorrectsAtTheEndAfterTheLastScanAndBeforeClosing) {
  flags_.correct_at = "end";
  ASSERT_TRUE(Stream(2).ok());
  EXPECT_THAT(events_,
              ElementsAre("scan 1 at 10", "scan 2 at 20", "correct 2 poses to 20", "close"));
}

TEST_F(StreamRunTest, CorrectsAllScansSoFarAfterTheScansOfThePlan) {
  flags_.correct_at = "3,1";
  ASSERT_TRUE(Stream(4).ok());
  EXPECT_THAT(events_,
              ElementsAre("scan 1 at 10", "correct 1 poses to 10", "scan 2 at 20", "scan 3 at 30",
                          "correct 3 poses to 30", "scan 4 at 40", "close"));
}

TEST_F(StreamRunTest, CorrectsAfterEveryScan) {
  flags_.correct_at = "every";
  ASSERT_TRUE(Stream(2).ok());
  EXPECT_THAT(events_, ElementsAre("scan 1 at 10", "correct 1 poses to 10", "scan 2 at 20",
                                   "correct 2 poses to 20", "close"));
}

TEST_F(StreamRunTest, SkipsWhatAnEarlierRunDeliveredButCorrectsItAll) {
  resume_after_seq_ = 2;
  flags_.correct_at = "end";
  ASSERT_TRUE(Stream(3).ok());
  EXPECT_THAT(events_, ElementsAre("scan 3 at 30", "correct 3 poses to 30", "close"));
}

TEST_F(StreamRunTest, NeedsCorrectedPosesToCorrect) {
  flags_.correct_at = "end";
  EXPECT_THAT(std::string(Stream(1, false).message()), HasSubstr("give --corrected FILE"));
}

TEST_F(StreamRunTest, FailsIfTheServerRefusedAScan) {
  num_refused_ = 1;
  const absl::Status status = Stream(1);
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("refused 1 scans"));
}

TEST(StreamFlags, ReadWhenToCorrect) {
  EXPECT_FALSE(ParseCorrectAt("", 5).value().any());
  const CorrectionPlan plan = ParseCorrectAt("4,2,end", 5).value();
  EXPECT_TRUE(plan.at_end);
  EXPECT_TRUE(plan.IsDueAfter(2));
  EXPECT_FALSE(plan.IsDueAfter(3));
  EXPECT_TRUE(plan.IsDueAfter(4));
  EXPECT_TRUE(ParseCorrectAt("every", 5).value().IsDueAfter(3));
  EXPECT_THAT(std::string(ParseCorrectAt("6", 5).status().message()),
              HasSubstr("--correct_at 6: there are 5 scans only"));
  for (const char* bad : {"0", "-1", "x", "1,,2", "1;2"})
    EXPECT_THAT(std::string(ParseCorrectAt(bad, 5).status().message()),
                HasSubstr("want N[,N...], every or end"))
        << bad;
}

TEST(StreamFlags, ReadTheRate) {
  EXPECT_FALSE(ParseRate("max").value().has_value());
  EXPECT_EQ(ParseRate("12.5").value(), 12.5);
  for (const char* bad : {"0", "-3", "nan", "fast"})
    EXPECT_THAT(std::string(ParseRate(bad).status().message()), HasSubstr("--rate is")) << bad;
}

TEST(StreamFlags, ReadHowPointsTravel) {
  IngestOptions options;
  ASSERT_TRUE(ParseEncoding("int16", options).ok());
  EXPECT_EQ(options.point_encoding, PointEncoding::kInt16);
  EXPECT_EQ(options.int16_step_m, 1e-3);
  EXPECT_EQ(options.compression, ScanCompression::kNone);
  ASSERT_TRUE(ParseEncoding("compact", options).ok());
  EXPECT_EQ(options.point_encoding, PointEncoding::kInt16);
  EXPECT_EQ(options.int16_step_m, 4e-3);
  EXPECT_EQ(options.compression, ScanCompression::kDeltaZstd);
  EXPECT_THAT(std::string(ParseEncoding("zip", options).message()),
              HasSubstr("--encoding is \"zip\", want float32, int16 or compact"));
}

TEST(StreamFlags, ReadWhatGivesWay) {
  EXPECT_EQ(ParseOverload("block").value(), OverloadPolicy::kBlock);
  EXPECT_EQ(ParseOverload("drop_oldest").value(), OverloadPolicy::kDropOldest);
  EXPECT_THAT(std::string(ParseOverload("both").status().message()),
              HasSubstr("--overload is \"both\", want block or drop_oldest"));
}

TEST(StreamFlags, TellTheServerWhereTheRobotsBodyIs) {
  StreamFlags flags;
  EXPECT_FALSE(SetupOf(flags).body.has_value());
  flags.body = {-1, -2, -3, 4, 5, 6};
  EXPECT_EQ(SetupOf(flags).body->min, Eigen::Vector3f(-1, -2, -3));
  EXPECT_EQ(SetupOf(flags).body->max, Eigen::Vector3f(4, 5, 6));
}

TEST(StreamFlags, MakeANewSessionUnlessOneIsNamed) {
  StreamFlags flags;
  EXPECT_NE(SetupOf(flags).session, SetupOf(flags).session);
  flags.session = "monday";
  EXPECT_EQ(SetupOf(flags).session, "monday");
}

}  // namespace
}  // namespace gem::client
