#include "client/local_map_subscriber.h"

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <utility>

#include "client/calls/decode_tile.h"
#include "client/calls/select_cells.h"
#include "client/calls/watch_stream.h"
#include "core/base/latest.h"
#include "core/base/status_macros.h"
#include "gem/v1/tile_service.grpc.pb.h"

namespace gem::client {

class LocalMapSubscriber::Impl {
 public:
  Impl(std::shared_ptr<const Connection> connection, SubscriberOptions options)
      : connection_(std::move(connection)),
        options_(std::move(options)),
        stub_(v1::TileService::NewStub(connection_->channel())),
        thread_(options_.retry, [this](Interrupt& interrupt) { return Attempt(interrupt); }) {}

  std::shared_ptr<const LocalMap> map() const { return newest_.Get(); }

  absl::StatusOr<std::shared_ptr<const LocalMap>> WaitForOther(
      const std::shared_ptr<const LocalMap>& than, double timeout_s) const {
    std::shared_ptr<const LocalMap> newest;
    GEM_RETURN_IF_ERROR(state_.WaitUntil(
        [&] {
          newest = map();
          return newest != nullptr && newest != than;
        },
        timeout_s));
    return newest;
  }

  SubscriberStats stats() const {
    return {state_.stats(), num_maps_.load(std::memory_order_relaxed),
            num_skipped_.load(std::memory_order_relaxed)};
  }

 private:
  RetryThread::Outcome Attempt(Interrupt& interrupt) {
    v1::WatchLocalMapRequest request;
    request.set_robot(options_.robot);
    SelectCells(options_.cells, request);
    request.set_min_interval_s(options_.min_interval_s);
    const RetryThread::Outcome outcome = RunStream<v1::WatchLocalMapResponse>(
        interrupt, connection_->address(), state_,
        [&](grpc::ClientContext* context) { return stub_->WatchLocalMap(context, request); },
        [this](const v1::WatchLocalMapResponse& response) { return Take(response); });
    state_.Break(outcome.status, outcome.final);
    return outcome;
  }

  absl::StatusOr<Taken> Take(const v1::WatchLocalMapResponse& response) {
    GEM_ASSIGN_OR_RETURN(LocalMap decoded, DecodeLocalMap(response.local_map(), options_.cells));
    const auto map = std::make_shared<const LocalMap>(std::move(decoded));
    num_maps_.fetch_add(1, std::memory_order_relaxed);
    num_skipped_.fetch_add(response.num_skipped(), std::memory_order_relaxed);
    newest_.Set(map);
    state_.Notify();
    if (options_.on_map) options_.on_map(map);
    return Taken::kComplete;
  }

  // Constant after construction.
  const std::shared_ptr<const Connection> connection_;
  const SubscriberOptions options_;
  const std::unique_ptr<v1::TileService::Stub> stub_;

  WatchState state_;
  std::atomic<std::uint64_t> num_maps_{0};
  std::atomic<std::uint64_t> num_skipped_{0};
  Latest<LocalMap> newest_;

  RetryThread thread_;
};

LocalMapSubscriber::LocalMapSubscriber(std::shared_ptr<const Connection> connection,
                                       SubscriberOptions options)
    : impl_(std::make_unique<Impl>(std::move(connection), std::move(options))) {}

LocalMapSubscriber::~LocalMapSubscriber() = default;

std::shared_ptr<const LocalMap> LocalMapSubscriber::map() const { return impl_->map(); }

absl::StatusOr<std::shared_ptr<const LocalMap>> LocalMapSubscriber::WaitForOther(
    const std::shared_ptr<const LocalMap>& than, double timeout_s) const {
  return impl_->WaitForOther(than, timeout_s);
}

SubscriberStats LocalMapSubscriber::stats() const { return impl_->stats(); }

}  // namespace gem::client
