#include "client/ingest_client.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "absl/synchronization/notification.h"
#include "google/rpc/error_details.pb.h"
#include "proto/wire/scan.h"
#include "tests/client/fake_server.h"

namespace gem::client {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr std::uint64_t kScanBytes = 12;  // one point of three floats

SessionSetup YardSession() {
  SessionSetup setup;
  setup.map = "yard";
  setup.robot = "rover";
  setup.session = "monday";
  setup.sensors = {{"lidar", Pose<Base, Sensor>::FromTranslation(0, 0, 1.5),
                    MakeNoiseModel(LidarNoise{}).value()}};
  return setup;
}

/// Tries at once, gives up soon.
IngestOptions Impatient() {
  IngestOptions options;
  options.backoff_s_min = options.backoff_s_max = 0;
  options.tries_max = 3;
  return options;
}

class IngestClientTest : public ::testing::Test {
 protected:
  absl::StatusOr<std::unique_ptr<IngestClient>> Open(IngestOptions options = Impatient()) {
    return IngestClient::Open(server_.Connect(), YardSession(), std::move(options));
  }

  /// One point at (number, 0, 0); stamp and pose follow the number.
  static absl::Status Send(IngestClient& client, int number) {
    const std::vector<ScanPoint> points = {{static_cast<float>(number), 0, 0, 0}};
    return client.Send({number * 100, "lidar", Pose<Odom, Base>::FromTranslation(number, 0, 0),
                        std::nullopt, points});
  }
  static float FirstX(const v1::Scan& scan) {
    float x = 0;
    EXPECT_GE(scan.points().size(), sizeof(x));
    std::memcpy(&x, scan.points().data(), sizeof(x));
    return x;
  }

  /// Bytes of which nothing can be parsed: a submessage that breaks off in its first tag.
  static v1::IngestResponse Damaged(int field) {
    v1::IngestResponse response;
    response.GetReflection()->MutableUnknownFields(&response)->AddLengthDelimited(field, "\xff");
    return response;
  }

  FakeServer server_;
};

TEST_F(IngestClientTest, OpensNumbersTheScansAndClosesWithTheVersion) {
  v1::OpenSession open;
  std::vector<v1::Scan> scans;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    open = AnswerOpen(stream, 0);
    for (int i = 0; i < 3; ++i) scans.push_back(ReadScan(stream));
    return AnswerClose(stream, 42);
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  EXPECT_EQ((*client)->opened().cell_size_m, 0.25);
  EXPECT_EQ((*client)->opened().local_map_side_m, 8);
  for (int i = 1; i <= 3; ++i) ASSERT_TRUE(Send(**client, i).ok());
  const auto closed = (*client)->Close();
  ASSERT_TRUE(closed.ok()) << closed.status();
  EXPECT_EQ(closed->version, (MapVersion{5, 42}));

  EXPECT_EQ(open.map(), "yard");
  EXPECT_EQ(open.robot(), "rover");
  EXPECT_EQ(open.session(), "monday");
  ASSERT_EQ(open.sensors_size(), 1);
  EXPECT_EQ(open.sensors(0).base_from_sensor().z(), 1.5);
  ASSERT_EQ(scans.size(), 3u);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(scans[i].seq(), static_cast<std::uint64_t>(i + 1));
    EXPECT_EQ(scans[i].stamp_ns(), (i + 1) * 100);
    EXPECT_EQ(scans[i].odom_from_base().x(), i + 1);
    EXPECT_EQ(FirstX(scans[i]), i + 1);
  }
}

TEST_F(IngestClientTest, LeavesUnsetWhatTheServerShallDecide) {
  v1::OpenSession open;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    open = AnswerOpen(stream, 0);
    return AnswerClose(stream, 1);
  };
  SessionSetup setup = YardSession();
  setup.height_m_max = 2.5f;
  setup.submap_length_m = 5;
  auto client = IngestClient::Open(server_.Connect(), setup, Impatient());
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE((*client)->Close().ok());
  EXPECT_EQ(open.local_map().height_m_max(), 2.5f);
  EXPECT_FALSE(open.local_map().has_height_m_min());
  EXPECT_EQ(open.map_setup().submap_length_m(), 5);
  EXPECT_EQ(open.map_setup().cell_size_m(), 0);
}

TEST_F(IngestClientTest, SendsNoMoreThanItsCredit) {
  absl::Notification second_scan;
  absl::Notification checked;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0, kScanBytes);  // one scan
    EXPECT_EQ(ReadScan(stream).seq(), 1u);
    std::thread reader([&] {
      EXPECT_EQ(ReadScan(stream).seq(), 2u);
      second_scan.Notify();
    });
    // The second scan must not come by itself, however long we wait.
    EXPECT_FALSE(second_scan.WaitForNotificationWithTimeout(absl::Milliseconds(200)));
    checked.Notify();
    Acknowledge(stream, 1, 1, kScanBytes);
    reader.join();
    Acknowledge(stream, 2, 2, kScanBytes);
    EXPECT_EQ(ReadScan(stream).seq(), 3u);
    return AnswerClose(stream, 1);
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  for (int i = 1; i <= 3; ++i) ASSERT_TRUE(Send(**client, i).ok());
  EXPECT_TRUE((*client)->Close().ok());
  EXPECT_TRUE(checked.HasBeenNotified());
}

TEST_F(IngestClientTest, KeepsNoMoreScansThanItsBuffer) {
  absl::Notification third_sent;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0);
    ReadScan(stream);
    ReadScan(stream);
    // Two scans fill the buffer: Send() of the third waits until one is fused.
    EXPECT_FALSE(third_sent.WaitForNotificationWithTimeout(absl::Milliseconds(200)));
    Acknowledge(stream, 2, 1);
    ReadScan(stream);
    return AnswerClose(stream, 1);
  };
  IngestOptions options = Impatient();
  options.buffer_bytes_max = 2 * kScanBytes;
  auto client = Open(options);
  ASSERT_TRUE(client.ok()) << client.status();
  for (int i = 1; i <= 3; ++i) ASSERT_TRUE(Send(**client, i).ok());
  third_sent.Notify();
  EXPECT_TRUE((*client)->Close().ok());
}

TEST_F(IngestClientTest, SendsAgainAfterABrokenStreamWhatTheServerDoesNotHave) {
  std::vector<std::uint64_t> seqs;
  std::vector<float> xs;
  server_.ingest.on_ingest = [&](int number, ServerStream& stream) -> grpc::Status {
    if (number == 1) {
      AnswerOpen(stream, 0);
      for (int i = 0; i < 4; ++i) ReadScan(stream);
      Acknowledge(stream, 4, 1);
      return {grpc::StatusCode::UNAVAILABLE, "cable cut"};
    }
    EXPECT_EQ(AnswerOpen(stream, 2).session(), "monday");  // 3 and 4 were lost with the process
    for (int i = 0; i < 2; ++i) {
      const v1::Scan scan = ReadScan(stream);
      seqs.push_back(scan.seq());
      xs.push_back(FirstX(scan));
    }
    Acknowledge(stream, 4, 4);
    return AnswerClose(stream, 9);
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  for (int i = 1; i <= 4; ++i) ASSERT_TRUE(Send(**client, i).ok());
  ASSERT_TRUE((*client)->WaitUntilFused().ok());
  EXPECT_EQ((*client)->progress().num_reconnects, 1u);
  EXPECT_EQ((*client)->progress().fused_seq, 4u);
  const auto closed = (*client)->Close();
  ASSERT_TRUE(closed.ok()) << closed.status();
  EXPECT_EQ(closed->version.revision, 9u);
  EXPECT_THAT(seqs, ElementsAre(3, 4));
  EXPECT_THAT(xs, ElementsAre(3, 4));
}

TEST_F(IngestClientTest, KeepsWhatIsAcceptedButNotFused) {
  std::vector<std::uint64_t> seqs;
  server_.ingest.on_ingest = [&](int number, ServerStream& stream) -> grpc::Status {
    if (number == 1) {
      AnswerOpen(stream, 0);
      for (int i = 0; i < 2; ++i) ReadScan(stream);
      Acknowledge(stream, 2, 0);
      return {grpc::StatusCode::UNAVAILABLE, "cable cut"};
    }
    if (number == 2) {
      AnswerOpen(stream, 2);  // still has both ...
      return {grpc::StatusCode::UNAVAILABLE, "and now the process died"};
    }
    AnswerOpen(stream, 0);  // ... now it has none
    for (int i = 0; i < 2; ++i) seqs.push_back(ReadScan(stream).seq());
    Acknowledge(stream, 2, 2);
    return AnswerClose(stream, 1);
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  for (int i = 1; i <= 2; ++i) ASSERT_TRUE(Send(**client, i).ok());
  EXPECT_TRUE((*client)->Close().ok());
  EXPECT_THAT(seqs, ElementsAre(1, 2));
}

TEST_F(IngestClientTest, SaysSoWhenTheServerForgotTheSession) {
  server_.ingest.on_ingest = [&](int number, ServerStream& stream) -> grpc::Status {
    AnswerOpen(stream, 0);
    if (number == 1) {
      ReadScan(stream);
      Acknowledge(stream, 1, 1);
      return {grpc::StatusCode::UNAVAILABLE, "restarted"};
    }
    v1::IngestRequest request;
    stream.Read(&request);
    return grpc::Status::OK;
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE(Send(**client, 1).ok());
  const absl::Status status = (*client)->Close().status();
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_THAT(std::string(status.message()),
              HasSubstr("the server forgot the session: it wants scan 1, the oldest that is kept "
                        "is 2; open a new session"));
}

TEST_F(IngestClientTest, SaysSoWhenTheServerWasRestarted) {
  server_.ingest.on_ingest = [&](int number, ServerStream& stream) -> grpc::Status {
    v1::IngestRequest request;
    EXPECT_TRUE(stream.Read(&request));
    v1::IngestResponse response;
    response.mutable_opened()->set_epoch(static_cast<std::uint64_t>(number));
    response.mutable_opened()->set_credit_bytes(1 << 20);
    response.mutable_opened()->set_scan_bytes_max(1 << 20);
    stream.Write(response);
    if (number == 1) {
      ReadScan(stream);
      Acknowledge(stream, 1, 1);
      return {grpc::StatusCode::UNAVAILABLE, "restarted"};
    }
    stream.Read(&request);
    return grpc::Status::OK;
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE(Send(**client, 1).ok());
  const absl::Status status = (*client)->Close().status();
  EXPECT_TRUE(absl::IsDataLoss(status)) << status;
  EXPECT_THAT(std::string(status.message()),
              HasSubstr("the server was restarted and what it had fused is lost"));
}

TEST_F(IngestClientTest, NeverWaitsWhenItMayDropScans) {
  absl::Notification all_sent;
  std::vector<float> xs;
  v1::OpenSession open;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    open = AnswerOpen(stream, 0, kScanBytes);  // one scan
    EXPECT_EQ(ReadScan(stream).seq(), 1u);
    all_sent.WaitForNotification();
    Acknowledge(stream, 1, 1, 100 * kScanBytes);
    for (std::uint64_t seq = 2; seq <= 4; ++seq) {
      const v1::Scan scan = ReadScan(stream);
      EXPECT_EQ(scan.seq(), seq);
      xs.push_back(FirstX(scan));
    }
    Acknowledge(stream, 4, 4);
    return AnswerClose(stream, 1);
  };
  IngestOptions options = Impatient();
  options.overload = OverloadPolicy::kDropOldest;
  options.unsent_scans_max = 3;
  auto client = Open(options);
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE(Send(**client, 1).ok());
  // Only once it is on its way do the others not push it out.
  while ((*client)->progress().sent_seq < 1) std::this_thread::yield();
  for (int i = 2; i <= 20; ++i) ASSERT_TRUE(Send(**client, i).ok());
  EXPECT_EQ((*client)->progress().num_dropped, 16u);
  all_sent.Notify();
  ASSERT_TRUE((*client)->WaitUntilFused().ok());
  ASSERT_TRUE((*client)->Close().ok());
  EXPECT_THAT(xs, ElementsAre(18, 19, 20));
  EXPECT_EQ(open.overload(), v1::OVERLOAD_POLICY_DROP_OLDEST);
}

TEST_F(IngestClientTest, NamesTheOptionThatIsWrong) {
  const auto text = [](const std::function<void(IngestOptions&)>& spoil) {
    IngestOptions options;
    spoil(options);
    return std::string(Validate(options).message());
  };
  EXPECT_TRUE(Validate(IngestOptions()).ok());
  EXPECT_EQ(text([](IngestOptions& o) { o.tries_max = 0; }), "tries_max is 0, want [1, 1000]");
  EXPECT_EQ(text([](IngestOptions& o) { o.backoff_s_min = 6; }), "backoff_s_min is 6, want [0, 5]");
  EXPECT_EQ(text([](IngestOptions& o) { o.unsent_scans_max = 0; }),
            "unsent_scans_max is 0, want [1, 100000]");
  EXPECT_EQ(text([](IngestOptions& o) { o.buffer_bytes_max = 0; }),
            "buffer_bytes_max is 0, want [1, 1099511627776]");
  EXPECT_THAT(text([](IngestOptions& o) { o.open_timeout_s = std::nan(""); }),
              HasSubstr("open_timeout_s is nan"));
  IngestOptions wrong;
  wrong.tries_max = 0;
  EXPECT_TRUE(absl::IsInvalidArgument(Open(wrong).status()));
}

// What the user saw: a client that waited for ever, after bytes that are no answer, on a stream
// that the server keeps open.
TEST_F(IngestClientTest, LeavesAStreamWithADamagedAnswerAndTriesAnother) {
  absl::Notification done;
  server_.ingest.on_ingest = [&](int number, ServerStream& stream) {
    if (number == 1) {
      AnswerOpen(stream, 0);
      EXPECT_EQ(ReadScan(stream).seq(), 1u);
      stream.Write(Damaged(v1::IngestResponse::kAckFieldNumber));
      Acknowledge(stream, 1, 1);  // more, that the client does not read
      done.WaitForNotification();
      return grpc::Status::OK;
    }
    AnswerOpen(stream, 1);
    Acknowledge(stream, 1, 1);
    return AnswerClose(stream, 9);
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE(Send(**client, 1).ok());
  const auto closed = (*client)->Close();
  done.Notify();
  ASSERT_TRUE(closed.ok()) << closed.status();
  EXPECT_EQ(closed->version.revision, 9u);
  EXPECT_EQ((*client)->progress().num_reconnects, 1u);
}

TEST_F(IngestClientTest, SaysThatAServerIsNoneOfOurs) {
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    v1::IngestRequest request;
    EXPECT_TRUE(stream.Read(&request));
    stream.Write(Damaged(v1::IngestResponse::kOpenedFieldNumber));
    while (stream.Read(&request)) {
    }
    return grpc::Status::OK;
  };
  const auto client = Open();
  EXPECT_TRUE(absl::IsUnavailable(client.status()));
  EXPECT_THAT(std::string(client.status().message()),
              HasSubstr("its answer is damaged, or it is no GEM server"));
}

TEST_F(IngestClientTest, SaysWhichOpeningOfTheSessionItIs) {
  std::vector<v1::OpenSession> opens;
  server_.ingest.on_ingest = [&](int number, ServerStream& stream) -> grpc::Status {
    opens.push_back(AnswerOpen(stream, 0));
    if (number == 2) return AnswerClose(stream, 1);
    return {grpc::StatusCode::UNAVAILABLE, "cable cut"};
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE((*client)->Close().ok());
  ASSERT_EQ(opens.size(), 2u);
  EXPECT_NE(opens[0].opener(), 0u);
  EXPECT_EQ(opens[0].opener(), opens[1].opener());
  EXPECT_EQ(opens[0].attempt(), 1u);
  EXPECT_EQ(opens[1].attempt(), 2u);
}

TEST_F(IngestClientTest, GoesOnWithASessionOfAnEarlierProcess) {
  std::uint64_t seq = 0;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 7);
    seq = ReadScan(stream).seq();
    return AnswerClose(stream, 1);
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  EXPECT_EQ((*client)->opened().resume_after_seq, 7u);
  ASSERT_TRUE(Send(**client, 1).ok());
  ASSERT_TRUE((*client)->Close().ok());
  EXPECT_EQ(seq, 8u);
}

TEST_F(IngestClientTest, GivesUpAfterABoundedNumberOfStreams) {
  server_.ingest.on_ingest = [&](int, ServerStream& stream) -> grpc::Status {
    AnswerOpen(stream, 0);
    return {grpc::StatusCode::UNAVAILABLE, "out of order"};
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  const absl::Status status = (*client)->Close().status();
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("gave up after 3 streams"));
  EXPECT_THAT(std::string(status.message()), HasSubstr("out of order"));
  EXPECT_EQ(server_.ingest.num_streams, 3);
  // And stays so.
  EXPECT_EQ(Send(**client, 1).code(), absl::StatusCode::kFailedPrecondition);
}

TEST_F(IngestClientTest, CountsTriesAnewWhenAScanGotThrough) {
  // Four streams that each take one scan: more than three tries, but never in vain.
  server_.ingest.on_ingest = [&](int number, ServerStream& stream) -> grpc::Status {
    AnswerOpen(stream, static_cast<std::uint64_t>(number - 1));
    if (number == 5) return AnswerClose(stream, 1);
    EXPECT_EQ(ReadScan(stream).seq(), static_cast<std::uint64_t>(number));
    Acknowledge(stream, static_cast<std::uint64_t>(number), static_cast<std::uint64_t>(number));
    return {grpc::StatusCode::UNAVAILABLE, "flaky"};
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  for (int i = 1; i <= 4; ++i) ASSERT_TRUE(Send(**client, i).ok());
  EXPECT_TRUE((*client)->Close().ok());
  EXPECT_EQ(server_.ingest.num_streams, 5);
}

TEST_F(IngestClientTest, DoesNotTryAgainWhatCannotSucceedAndNamesTheField) {
  server_.ingest.on_ingest = [&](int, ServerStream& stream) -> grpc::Status {
    v1::IngestRequest request;
    stream.Read(&request);
    google::rpc::BadRequest bad;
    bad.add_field_violations()->set_field("open.robot");
    bad.mutable_field_violations(0)->set_description("is \"\", want 1 to 64 characters");
    google::rpc::Status details;
    details.add_details()->PackFrom(bad);
    return {grpc::StatusCode::INVALID_ARGUMENT, "the session cannot be opened",
            details.SerializeAsString()};
  };
  const absl::Status status = Open().status();
  EXPECT_TRUE(absl::IsInvalidArgument(status)) << status;
  EXPECT_THAT(std::string(status.message()),
              HasSubstr("the session cannot be opened; open.robot: is \"\", want 1 to 64"));
  EXPECT_EQ(server_.ingest.num_streams, 1);
}

TEST_F(IngestClientTest, DoesNotFightForASessionThatAnotherClientTookOver) {
  server_.ingest.on_ingest = [&](int, ServerStream& stream) -> grpc::Status {
    AnswerOpen(stream, 0);
    return {grpc::StatusCode::ABORTED, "another stream has resumed the session"};
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  EXPECT_TRUE(absl::IsAborted((*client)->Close().status()));
  EXPECT_EQ(server_.ingest.num_streams, 1);
}

TEST_F(IngestClientTest, ReportsWhatTheServerRefused) {
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0);
    ReadScan(stream);
    v1::IngestResponse response;
    v1::IngestAck& ack = *response.mutable_ack();
    ack.set_accepted_seq(1);
    ack.set_fused_seq(1);
    ack.add_problems()->set_seq(1);
    ack.mutable_problems(0)->set_reason(v1::PROBLEM_REASON_OUT_OF_ORDER);
    ack.mutable_problems(0)->set_message("scan.stamp_ns is 5, want more than 7");
    ack.set_problems_left_out(4);
    stream.Write(response);
    return AnswerClose(stream, 1);
  };
  std::vector<std::string> problems;
  IngestOptions options = Impatient();
  options.on_problem = [&](const IngestProblem& problem) {
    problems.push_back(absl::StrCat(problem.seq, " ", problem.reason, " ", problem.message));
  };
  auto client = Open(options);
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE(Send(**client, 1).ok());
  ASSERT_TRUE((*client)->Close().ok());
  EXPECT_EQ((*client)->progress().num_problems, 5u);
  client->reset();  // no callback comes after this
  EXPECT_THAT(problems, ElementsAre("1 out_of_order scan.stamp_ns is 5, want more than 7",
                                    "0 left_out 4 more problems"));
}

TEST_F(IngestClientTest, ClosesAgainWhenTheStreamBreaksBeforeTheAnswer) {
  server_.ingest.on_ingest = [&](int number, ServerStream& stream) -> grpc::Status {
    AnswerOpen(stream, 0);
    if (number == 2) return AnswerClose(stream, 3);
    v1::IngestRequest request;
    EXPECT_TRUE(stream.Read(&request));
    EXPECT_TRUE(request.has_close());
    return {grpc::StatusCode::UNAVAILABLE, "restarted"};
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  const auto closed = (*client)->Close();
  ASSERT_TRUE(closed.ok()) << closed.status();
  EXPECT_EQ(closed->version.revision, 3u);
}

TEST_F(IngestClientTest, HearsTheEndOfASessionWhoseCloseWasNotAnswered) {
  std::vector<bool> closing;
  server_.ingest.on_ingest = [&](int number, ServerStream& stream) -> grpc::Status {
    v1::IngestRequest request;
    v1::IngestResponse response;
    if (number == 1) {
      closing.push_back(AnswerOpen(stream, 0).closing());
      EXPECT_TRUE(stream.Read(&request));
      EXPECT_TRUE(request.has_close());
      return {grpc::StatusCode::UNAVAILABLE, "the radio"};
    }
    EXPECT_TRUE(stream.Read(&request));
    closing.push_back(request.open().closing());
    response.mutable_closed()->mutable_version()->set_revision(7);
    response.mutable_closed()->set_num_scans_not_deskewed(2);
    stream.Write(response);
    return grpc::Status::OK;
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  const auto closed = (*client)->Close();
  ASSERT_TRUE(closed.ok()) << closed.status();
  EXPECT_EQ(closed->version.revision, 7u);
  EXPECT_EQ(closed->num_scans_not_deskewed, 2u);
  EXPECT_THAT(closing, ElementsAre(false, true));
}

TEST_F(IngestClientTest, ComesBackAfterTheServerDrained) {
  server_.ingest.on_ingest = [&](int number, ServerStream& stream) -> grpc::Status {
    AnswerOpen(stream, 0);
    if (number == 2) return AnswerClose(stream, 3);
    v1::IngestResponse response;
    response.mutable_drain()->set_reconnect_after_s(0);
    stream.Write(response);
    return grpc::Status::OK;
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  EXPECT_TRUE((*client)->Close().ok());
  EXPECT_EQ(server_.ingest.num_streams, 2);
}

TEST_F(IngestClientTest, RefusesAScanThatTheServerWouldRefuse) {
  std::uint64_t seq = 0;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0, 1 << 20, kScanBytes);
    seq = ReadScan(stream).seq();
    return AnswerClose(stream, 1);
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  const std::vector<ScanPoint> two(2);
  const absl::Status too_large =
      (*client)->Send({1, "lidar", Pose<Odom, Base>(), std::nullopt, two});
  EXPECT_EQ(too_large.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(too_large.message()), HasSubstr("24 bytes of points, the server takes "
                                                          "at most 12"));
  const std::vector<ScanPoint> bad = {{0, std::numeric_limits<float>::quiet_NaN(), 0, 0}};
  const absl::Status not_finite =
      (*client)->Send({1, "lidar", Pose<Odom, Base>(), std::nullopt, bad});
  EXPECT_THAT(std::string(not_finite.message()), HasSubstr("points[0] is (0, nan, 0)"));
  // Neither took a number.
  ASSERT_TRUE(Send(**client, 1).ok());
  ASSERT_TRUE((*client)->Close().ok());
  EXPECT_EQ(seq, 1u);
}

TEST_F(IngestClientTest, SendsHalfOfTheBytesAsInt16) {
  v1::Scan near, far;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0);
    near = ReadScan(stream);
    far = ReadScan(stream);
    return AnswerClose(stream, 1);
  };
  IngestOptions options = Impatient();
  options.point_encoding = PointEncoding::kInt16;
  auto client = Open(options);
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE(Send(**client, 2).ok());
  ASSERT_TRUE(Send(**client, 100).ok());
  ASSERT_TRUE((*client)->Close().ok());
  EXPECT_EQ(near.point_stride(), 6u);
  EXPECT_EQ(near.fields(0).scale(), 1e-3);
  EXPECT_EQ(near.points().substr(0, 2), (std::string{'\xd0', '\x07'}));  // 2000 mm
  EXPECT_DOUBLE_EQ(far.fields(0).scale(), 100.0 / 32767);
  EXPECT_EQ(far.points().substr(0, 2), (std::string{'\xff', '\x7f'}));
}

TEST_F(IngestClientTest, SendsCompressedScansInTheStepThatWasAskedFor) {
  v1::Scan scan;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0);
    scan = ReadScan(stream);
    return AnswerClose(stream, 1);
  };
  IngestOptions options = Impatient();
  options.point_encoding = PointEncoding::kInt16;
  options.int16_step_m = 4e-3;
  options.compression = ScanCompression::kDeltaZstd;
  auto client = Open(options);
  ASSERT_TRUE(client.ok()) << client.status();
  const std::vector<ScanPoint> points(1000, {100, -100, 2, 0});
  ASSERT_TRUE((*client)->Send({17, "lidar", std::nullopt, std::nullopt, points}).ok());
  ASSERT_TRUE((*client)->Close().ok());
  EXPECT_EQ(scan.compression(), v1::SCAN_COMPRESSION_DELTA_ZSTD);
  EXPECT_EQ(scan.fields(0).scale(), 4e-3);
  EXPECT_LT(scan.points().size(), 100u);
  wire::DecodedScan decoded;
  ASSERT_TRUE(wire::FromProto(scan, {}, wire::FieldPath("scan"), decoded).ok());
  ASSERT_EQ(decoded.points.size(), 1000u);
  EXPECT_NEAR(decoded.points[999].y_m, -100, 1e-4);
}

TEST_F(IngestClientTest, BoundsAScanByItsSizeBeforeItIsCompressed) {
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0, /*credit_bytes=*/1 << 20, /*scan_bytes_max=*/1000);
    return AnswerClose(stream, 0);
  };
  IngestOptions options = Impatient();
  options.compression = ScanCompression::kDeltaZstd;
  auto client = Open(options);
  ASSERT_TRUE(client.ok()) << client.status();
  const std::vector<ScanPoint> points(100);
  EXPECT_THAT(
      std::string((*client)->Send({17, "lidar", std::nullopt, std::nullopt, points}).message()),
      HasSubstr("1200 bytes of points, the server takes at most 1000"));
  EXPECT_TRUE((*client)->Close().ok());
}

TEST_F(IngestClientTest, RefusesAStepThatIsNone) {
  for (const double step_m : {0.0, -1.0, 1.5, std::numeric_limits<double>::quiet_NaN()}) {
    IngestOptions options = Impatient();
    options.int16_step_m = step_m;
    const auto client = Open(options);
    EXPECT_TRUE(absl::IsInvalidArgument(client.status()));
    EXPECT_THAT(std::string(client.status().message()), HasSubstr("int16_step_m is "));
  }
}

TEST_F(IngestClientTest, SendsPosesBetweenScansInOrder) {
  std::vector<std::string> kinds;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0);
    for (int i = 0; i < 2; ++i) {
      v1::IngestRequest request;
      EXPECT_TRUE(stream.Read(&request));
      kinds.push_back(request.has_poses()
                          ? absl::StrCat("poses ", request.poses().poses(0).stamp_ns())
                          : absl::StrCat("scan, pose ", request.scan().has_odom_from_base()));
    }
    return AnswerClose(stream, 1);
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE((*client)->SendPoses({{17, Pose<Odom, Base>()}}).ok());
  const std::vector<ScanPoint> points(1);
  ASSERT_TRUE((*client)->Send({17, "lidar", std::nullopt, std::nullopt, points}).ok());
  ASSERT_TRUE((*client)->Close().ok());
  EXPECT_THAT(kinds, ElementsAre("poses 17", "scan, pose 0"));
}

TEST_F(IngestClientTest, PosesOvertakeScansThatWaitForCredit) {
  // What the user saw: the server held the credit for scans that waited for poses, and the poses
  // stood behind a scan that waited for the credit.
  std::vector<std::string> kinds;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0, kScanBytes);  // one scan
    for (int i = 0; i < 5; ++i) {
      v1::IngestRequest request;
      EXPECT_TRUE(stream.Read(&request));
      kinds.push_back(request.has_poses()
                          ? absl::StrCat("poses ", request.poses().poses(0).stamp_ns())
                          : absl::StrCat("scan ", request.scan().seq()));
      // The credit comes back only once the poses are there.
      if (kinds.size() == 3) Acknowledge(stream, 1, 1, 2 * kScanBytes);
    }
    return AnswerClose(stream, 1);
  };
  IngestOptions options = Impatient();
  options.unsent_scans_max = 2;  // the third waits until the first is on its way
  auto client = Open(options);
  ASSERT_TRUE(client.ok()) << client.status();
  for (int i = 1; i <= 3; ++i) ASSERT_TRUE(Send(**client, i).ok());
  for (const std::int64_t stamp_ns : {50, 150})
    ASSERT_TRUE((*client)->SendPoses({{stamp_ns, Pose<Odom, Base>()}}).ok());
  ASSERT_TRUE((*client)->Close().ok());
  EXPECT_THAT(kinds, ElementsAre("scan 1", "poses 50", "poses 150", "scan 2", "scan 3"));
}

TEST_F(IngestClientTest, SendsADepthImageAndCountsItsBytes) {
  const std::vector<std::uint16_t> depths = {1000, 2000, 3000, 4000, 5000, 6000};  // 12 bytes
  DepthImage image;
  image.width = 3;
  image.height = 2;
  image.fx_px = image.fy_px = 100;
  image.depth = std::as_bytes(std::span(depths));
  std::vector<v1::Scan> scans;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0, kScanBytes, kScanBytes);
    scans.push_back(ReadScan(stream));
    Acknowledge(stream, 1, 1, kScanBytes);
    scans.push_back(ReadScan(stream));
    return AnswerClose(stream, 1);
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  OutgoingScan scan{100, "camera", Pose<Odom, Base>(), std::nullopt, {}};
  scan.depth_image = image;
  ASSERT_TRUE((*client)->Send(scan).ok());
  scan.stamp_ns = 200;
  ASSERT_TRUE((*client)->Send(scan).ok());

  image.depth = image.depth.subspan(2);
  scan.depth_image = image;
  EXPECT_THAT(std::string((*client)->Send(scan).message()),
              HasSubstr("depth_image.depth is 10 bytes, want width * height * 2"));
  const std::vector<std::uint8_t> colors(18);
  image.depth = std::as_bytes(std::span(depths));
  image.rgb = std::as_bytes(std::span(colors));
  scan.depth_image = image;
  EXPECT_THAT(std::string((*client)->Send(scan).message()),
              HasSubstr("30 bytes of depths and colours, the server takes at most 12"));
  const std::vector<ScanPoint> points(1);
  scan.points = points;
  EXPECT_THAT(std::string((*client)->Send(scan).message()),
              HasSubstr("the scan has points and a depth image"));

  ASSERT_TRUE((*client)->Close().ok());
  ASSERT_EQ(scans.size(), 2u);
  EXPECT_EQ(scans[1].depth_image().width(), 3u);
  EXPECT_EQ(scans[1].depth_image().depth().substr(0, 2), (std::string{'\xe8', '\x03'}));
  EXPECT_EQ(scans[1].point_stride(), 0u);
}

TEST_F(IngestClientTest, SendsWhenEachPointWasMeasured) {
  std::vector<v1::Scan> scans;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0);
    scans.push_back(ReadScan(stream));
    return AnswerClose(stream, 1);
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  const std::vector<ScanPoint> points(2);
  std::vector<float> offsets_s = {-0.05f, 0.05f};
  OutgoingScan scan{100, "lidar", Pose<Odom, Base>(), std::nullopt, points};
  scan.time_offsets_s = offsets_s;
  ASSERT_TRUE((*client)->Send(scan).ok());
  offsets_s[1] = 1.5f;
  EXPECT_THAT(std::string((*client)->Send(scan).message()),
              HasSubstr("time_offsets_s[1] is 1.5, want at most 1 in magnitude"));
  scan.time_offsets_s = std::span<const float>(offsets_s).first(1);
  EXPECT_THAT(std::string((*client)->Send(scan).message()),
              HasSubstr("time_offsets_s has 1 values, want none or one for each of 2 points"));
  ASSERT_TRUE((*client)->Close().ok());
  ASSERT_EQ(scans.size(), 1u);
  EXPECT_EQ(scans[0].point_stride(), 16u);
  EXPECT_EQ(scans[0].fields(3).name(), "time_offset");
}

TEST_F(IngestClientTest, DoesNotWaitForeverForASilentServer) {
  absl::Notification over;
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0);
    over.WaitForNotification();
    return grpc::Status::OK;
  };
  IngestOptions options = Impatient();
  options.progress_timeout_s = 0.05;
  auto client = Open(options);
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE(Send(**client, 1).ok());
  const absl::Status status = (*client)->WaitUntilFused();
  EXPECT_TRUE(absl::IsDeadlineExceeded(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("scans to be fused"));
  over.Notify();
  server_.Stop();
}

TEST_F(IngestClientTest, DoesNotWaitForeverForASessionToOpen) {
  absl::Notification over;
  server_.ingest.on_ingest = [&](int, ServerStream&) {
    over.WaitForNotification();
    return grpc::Status::OK;
  };
  IngestOptions options = Impatient();
  options.open_timeout_s = 0.05;
  const absl::Status status = Open(options).status();
  EXPECT_TRUE(absl::IsDeadlineExceeded(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("did not open the session within 0.05 s"));
  over.Notify();
  server_.Stop();
}

TEST_F(IngestClientTest, BelievesNoAcknowledgementOfWhatItDidNotSend) {
  server_.ingest.on_ingest = [&](int, ServerStream& stream) {
    AnswerOpen(stream, 0);
    Acknowledge(stream, 1000, 1000);
    EXPECT_EQ(ReadScan(stream).seq(), 1u);
    Acknowledge(stream, 1000, 1000);
    return AnswerClose(stream, 1);
  };
  auto client = Open();
  ASSERT_TRUE(client.ok()) << client.status();
  ASSERT_TRUE(Send(**client, 1).ok());
  ASSERT_TRUE((*client)->WaitUntilFused().ok());
  EXPECT_EQ((*client)->progress().fused_seq, 1u);
  EXPECT_TRUE((*client)->Close().ok());
}

TEST(IngestClient, NamesTheAddressThatNobodyAnswers) {
  ConnectionOptions connection;
  connection.address = "127.0.0.1:1";
  const absl::Status status =
      IngestClient::Open(std::make_shared<const Connection>(connection), YardSession(), Impatient())
          .status();
  EXPECT_TRUE(absl::IsUnavailable(status)) << status;
  EXPECT_THAT(std::string(status.message()), HasSubstr("server 127.0.0.1:1"));
}

}  // namespace
}  // namespace gem::client
