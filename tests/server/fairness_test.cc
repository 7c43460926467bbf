// Who floods the server harms nobody else: robots over the wire, and readers beside corrections.
#include <gmock/gmock.h>

#include <future>
#include <thread>

#include "server/workers.h"
#include "tests/server/test_server.h"

namespace gem {
namespace {

/// Keeps all workers of a pool busy and its queue full, until it goes.
class HeldUp {
 public:
  HeldUp(WorkerPool& pool, int num_threads) {
    const std::shared_future<void> go_on = go_on_.get_future().share();
    std::vector<std::promise<void>> begun(static_cast<std::size_t>(num_threads));
    for (std::promise<void>& thread : begun)
      EXPECT_TRUE(pool.Submit([go_on, &thread] {
                        thread.set_value();
                        go_on.wait();
                      })
                      .ok());
    for (std::promise<void>& thread : begun) thread.get_future().wait();
    while (pool.Submit([] {}).ok()) {
    }
  }
  ~HeldUp() { go_on_.set_value(); }

 private:
  std::promise<void> go_on_;
};

grpc::Status ReadATile(TestServer& server) {
  v1::BatchGetTilesRequest request;
  v1::BatchGetTilesResponse response;
  request.set_map("site");
  request.add_tiles();
  request.add_layers(v1::LAYER_ELEVATION);
  return TestServer::Call(server.tiles(), &v1::TileService::Stub::BatchGetTiles, request, response);
}

grpc::Status Correct(TestServer& server, double z_m) {
  v1::CorrectTrajectoryRequest request;
  v1::CorrectTrajectoryResponse response;
  request.set_map("site");
  request.set_session("s1");
  v1::GlobalPose& pose = *request.add_poses();
  pose.set_stamp_ns(StampOf(1));
  pose.mutable_map_from_base()->set_z(z_m);
  pose.mutable_map_from_base()->set_qw(1);
  return TestServer::Call(server.ingest(), &v1::IngestService::Stub::CorrectTrajectory, request,
                          response);
}

TEST(Fairness, NoFloodOfReadsKeepsACorrectionOut) {
  ServerOptions options = TestOptions();
  options.worker_queue_max = 8;
  TestServer server(options);
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(robot.Send(FlatScan(1, 0)));
  ASSERT_TRUE(robot.ReadUntilFused(1));
  ASSERT_TRUE(ReadATile(server).ok());

  const HeldUp readers(server.server().workers().reads, options.worker_threads);
  for (int i = 1; i <= 20; ++i) {
    EXPECT_EQ(ReadATile(server).error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    const grpc::Status corrected = Correct(server, i);
    EXPECT_TRUE(corrected.ok()) << corrected.error_message();
  }
}

TEST(Fairness, NoFloodOfCorrectionsKeepsReadersOut) {
  TestServer server;
  TestStream robot(server.ingest(), TestOpen("r1", "s1"));
  const HeldUp corrections(server.server().workers().corrections, 1);
  EXPECT_EQ(Correct(server, 1).error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_TRUE(ReadATile(server).ok());
}

// Three robots send without looking at their credit, and read nothing.
TEST(Fairness, ARobotThatBehavesIsServedBesideThoseThatDoNot) {
  constexpr std::uint64_t kScans = 60;
  ServerOptions options = TestOptions();
  options.scan_bytes_max = 13'000;  // one scan has 12,288
  options.queue_bytes_max = 60'000;
  options.ingest_bytes_max = 60'000;
  TestServer server(options);
  std::vector<std::thread> floods;
  for (const std::string robot : {"r1", "r2", "r3"})
    floods.emplace_back([&server, robot] {
      TestStream stream(server.ingest(), TestOpen(robot, robot));
      for (std::uint64_t seq = 1; seq <= kScans; ++seq) EXPECT_TRUE(stream.Send(FlatScan(seq, 0)));
      EXPECT_TRUE(stream.ReadUntilFused(kScans));
      EXPECT_THAT(stream.problems(), testing::IsEmpty());
    });
  TestStream polite(server.ingest(), TestOpen("polite", "polite"));
  std::uint64_t sent_bytes = 0;
  for (std::uint64_t seq = 1; seq <= kScans; ++seq) {
    const v1::Scan scan = FlatScan(seq, 0);
    sent_bytes += scan.points().size();
    // Nothing of it waits, so that it may send a scan, whatever the others do.
    EXPECT_LE(sent_bytes, polite.opened().credit_bytes() + polite.credit_bytes());
    ASSERT_TRUE(polite.Send(scan));
    ASSERT_TRUE(polite.ReadUntilFused(seq));
  }
  for (std::thread& flood : floods) flood.join();
  EXPECT_THAT(polite.problems(), testing::IsEmpty());
  EXPECT_EQ(server.Metric("gem_queue_bytes"), 0);
}

}  // namespace
}  // namespace gem
