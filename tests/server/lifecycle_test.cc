// Start and end of the server.
#include <gmock/gmock.h>
#include <grpcpp/health_check_service_interface.h>

#include <chrono>

#include "tests/server/test_server.h"

namespace gem {
namespace {

TEST(Lifecycle, StopsInUnderTwoSecondsWithStreamsOpenAndSaysGoodbye) {
  TestServer server;
  TestStream idle(server.ingest(), TestOpen("r1", "s1"));
  TestStream busy(server.ingest(), TestOpen("r2", "s2"));
  for (std::uint64_t seq = 1; seq <= 20; ++seq) ASSERT_TRUE(busy.Send(FlatScan(seq, 0)));
  const auto start = std::chrono::steady_clock::now();
  server.server().Stop();
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(2));
  for (TestStream* stream : {&idle, &busy}) {
    const grpc::Status status = stream->Finish();
    EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE);
    EXPECT_EQ(status.error_message(), "the server is going away");
    EXPECT_TRUE(stream->drained());
  }
}

TEST(Lifecycle, StopsInUnderTwoSecondsWithAClientThatReadsNothing) {
  TestServer server;
  grpc::ClientContext context;
  context.set_deadline(TestDeadline());
  const auto stream = server.ingest().Ingest(&context);
  v1::IngestRequest request;
  *request.mutable_open() = TestOpen("r1", "s1");
  ASSERT_TRUE(stream->Write(request));
  for (std::uint64_t seq = 1; seq <= 50; ++seq) {
    *request.mutable_scan() = FlatScan(seq, 0);
    ASSERT_TRUE(stream->Write(request));
  }
  const auto start = std::chrono::steady_clock::now();
  server.server().Stop();
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(2));
  // Without this Finish() waits for messages that nobody reads.
  context.TryCancel();
  stream->Finish();
}

TEST(Lifecycle, ASecondServerIsToldThatThePortIsTaken) {
  TestServer server;
  ServerOptions options = TestOptions();
  options.listen = server.address();
  const auto second = Server::Start(options);
  ASSERT_FALSE(second.ok());
  EXPECT_EQ(second.status().code(), absl::StatusCode::kUnavailable);
  EXPECT_THAT(std::string(second.status().message()),
              testing::StartsWith("listen is " + server.address()));
  options = TestOptions();
  options.metrics_listen = server.server().metrics_address();
  const auto third = Server::Start(options);
  ASSERT_FALSE(third.ok());
  EXPECT_THAT(std::string(third.status().message()), testing::StartsWith("metrics_listen is "));
}

TEST(Lifecycle, WrongOptionsAreNamed) {
  ServerOptions options = TestOptions();
  options.listen = "nonsense";
  EXPECT_EQ(std::string(Server::Start(options).status().message()),
            "listen is \"nonsense\", want ADDR:PORT");
  options = TestOptions();
  options.map.cell_size_m = -1;
  EXPECT_THAT(std::string(Server::Start(options).status().message()),
              testing::StartsWith("map.cell_size_m is -1"));
}

}  // namespace
}  // namespace gem
