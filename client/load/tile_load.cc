#include "client/load/tile_load.h"

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <thread>

#include "client/call_status.h"
#include "gem/v1/tile_service.pb.h"
#include "proto/wire/map.h"

namespace gem::load {
namespace {

using Clock = std::chrono::steady_clock;

constexpr char kMethod[] = "/gem.v1.TileService/BatchGetTiles";

Clock::duration Seconds(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

/// Requests that take turns: together they ask for every tile once.
std::vector<grpc::ByteBuffer> Requests(const ReadPlan& plan) {
  std::vector<grpc::ByteBuffer> requests;
  const auto step = static_cast<std::size_t>(plan.tiles_per_call);
  for (std::size_t begin = 0; begin < plan.tiles.size(); begin += step) {
    v1::BatchGetTilesRequest request;
    request.set_map(plan.map);
    // The last batch is filled up from the beginning, so that all are of one size.
    for (std::size_t i = begin; i < begin + step; ++i)
      wire::ToProto({0, plan.tiles[i % plan.tiles.size()]}, request.add_tiles());
    const grpc::Slice slice(request.SerializeAsString());
    requests.emplace_back(&slice, 1);
  }
  return requests;
}

/// One planner with a connection of its own.
class Reader {
 public:
  Reader(const client::ConnectionOptions& server, const ReadPlan& plan, int number)
      : connection_(server), stub_(connection_.channel()), plan_(plan), number_(number) {}

  absl::Status Run(const std::vector<grpc::ByteBuffer>& requests, Clock::time_point begin) {
    const Clock::time_point end = begin + Seconds(plan_.seconds);
    const bool paced = plan_.calls_hz > 0;
    const Clock::duration period =
        paced ? Seconds(plan_.num_readers / plan_.calls_hz) : Clock::duration(0);
    // Readers ask one after the other, not all at once.
    Clock::time_point due = begin + period * number_ / plan_.num_readers;
    for (std::size_t i = static_cast<std::size_t>(number_);; ++i) {
      if (paced) std::this_thread::sleep_until(due);
      const Clock::time_point from = paced ? due : Clock::now();
      if (from >= end) return absl::OkStatus();
      if (const absl::Status status = Call(requests[i % requests.size()]); !status.ok())
        return status;
      report_.latencies_s.push_back(std::chrono::duration<double>(Clock::now() - from).count());
      report_.num_tiles += static_cast<std::uint64_t>(plan_.tiles_per_call);
      due += period;
    }
  }

  const ReadReport& report() const { return report_; }

 private:
  absl::Status Call(const grpc::ByteBuffer& request) {
    grpc::ClientContext context;
    grpc::ByteBuffer response;
    grpc::Status status;
    const auto call = stub_.PrepareUnaryCall(&context, kMethod, request, &queue_);
    call->StartCall();
    call->Finish(&response, &status, nullptr);
    void* tag = nullptr;
    bool ok = false;
    queue_.Next(&tag, &ok);
    report_.num_bytes += response.Length();
    return client::ToStatus(status, connection_.address());
  }

  const client::Connection connection_;
  grpc::GenericStub stub_;
  grpc::CompletionQueue queue_;
  const ReadPlan& plan_;
  const int number_;
  ReadReport report_;
};

}  // namespace

absl::StatusOr<ReadReport> ReadTiles(const client::ConnectionOptions& server,
                                     const ReadPlan& plan) {
  if (plan.tiles.empty()) return absl::FailedPreconditionError("the map has no tiles to read");
  const std::vector<grpc::ByteBuffer> requests = Requests(plan);
  std::vector<std::unique_ptr<Reader>> readers;
  readers.reserve(static_cast<std::size_t>(plan.num_readers));
  for (int i = 0; i < plan.num_readers; ++i)
    readers.push_back(std::make_unique<Reader>(server, plan, i));
  std::vector<absl::Status> ends(readers.size());
  const Clock::time_point begin = Clock::now();
  std::vector<std::thread> threads;
  threads.reserve(readers.size());
  for (std::size_t i = 0; i < readers.size(); ++i)
    threads.emplace_back([&, i] { ends[i] = readers[i]->Run(requests, begin); });
  for (std::thread& thread : threads) thread.join();
  ReadReport report;
  report.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  for (std::size_t i = 0; i < readers.size(); ++i) {
    if (!ends[i].ok()) return ends[i];
    const ReadReport& part = readers[i]->report();
    report.num_tiles += part.num_tiles;
    report.num_bytes += part.num_bytes;
    report.latencies_s.insert(report.latencies_s.end(), part.latencies_s.begin(),
                              part.latencies_s.end());
  }
  return report;
}

}  // namespace gem::load
