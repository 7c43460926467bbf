#include "client/map_mirror.h"

#include <grpcpp/grpcpp.h>

#include <utility>

#include "absl/strings/str_cat.h"
#include "client/calls/decode_tile.h"
#include "client/calls/select_cells.h"
#include "client/calls/watch_stream.h"
#include "client/mirror_store.h"
#include "core/base/status_macros.h"
#include "gem/v1/tile_service.grpc.pb.h"
#include "proto/wire/map.h"

namespace gem::client {

class MapMirror::Impl {
 public:
  Impl(std::shared_ptr<const Connection> connection, MirrorOptions options)
      : connection_(std::move(connection)),
        options_(std::move(options)),
        stub_(v1::TileService::NewStub(connection_->channel())),
        store_(options_.tiles_max),
        thread_(options_.retry, [this](Interrupt& interrupt) { return Attempt(interrupt); }) {}

  std::shared_ptr<const MirroredMap> map() const { return store_.snapshot(); }

  absl::StatusOr<std::shared_ptr<const MirroredMap>> WaitForOther(
      const std::optional<MapVersion>& than, double timeout_s) const {
    std::shared_ptr<const MirroredMap> map;
    GEM_RETURN_IF_ERROR(state_.WaitUntil(
        [&] {
          map = store_.snapshot();
          return map != nullptr && than != std::optional(map->version);
        },
        timeout_s));
    return map;
  }

  MirrorStats stats() const {
    MirrorStats stats{state_.stats(), {}, {}, {}};
    MutexLock lock(mutex_);
    stats.num_versions = num_versions_;
    stats.num_versions_skipped = num_versions_skipped_;
    stats.num_resyncs = num_resyncs_;
    return stats;
  }

 private:
  RetryThread::Outcome Attempt(Interrupt& interrupt) {
    RetryThread::Outcome outcome;
    outcome.status = FetchGeometry(interrupt);
    if (outcome.status.ok()) {
      outcome = Watch(interrupt);
    } else {
      outcome.final = IsFinal(outcome.status);
    }
    // ABORTED is the store's: what is held is of no use to the server.
    start_over_ = absl::IsAborted(outcome.status);
    store_.DropParts();
    state_.Break(outcome.status, outcome.final);
    return outcome;
  }

  /// What the tiles do not say themselves. Again for every stream, as a server that was away may
  /// come back with another map of this name.
  absl::Status FetchGeometry(Interrupt& interrupt) {
    v1::GetTileMatrixRequest request;
    request.set_map(options_.map);
    request.set_level(static_cast<std::uint32_t>(options_.level));
    v1::GetTileMatrixResponse response;
    CallContext context(interrupt);
    GEM_RETURN_IF_ERROR(
        ToStatus(stub_->GetTileMatrix(context.get(), request, &response), connection_->address()));
    GEM_ASSIGN_OR_RETURN(const TileMatrix matrix, DecodeTileMatrix(response, options_.level));
    store_.SetGeometry(
        {options_.level, matrix.cell_size_m, matrix.traversability_free, matrix.version.epoch});
    return absl::OkStatus();
  }

  RetryThread::Outcome Watch(Interrupt& interrupt) {
    const v1::WatchTilesRequest request = Request();
    return RunStream<v1::WatchTilesResponse>(
        interrupt, connection_->address(), state_,
        [&](grpc::ClientContext* context) { return stub_->WatchTiles(context, request); },
        [this](const v1::WatchTilesResponse& response) { return Take(response); });
  }

  v1::WatchTilesRequest Request() const {
    v1::WatchTilesRequest request;
    request.set_map(options_.map);
    if (options_.region) RegionToProto(*options_.region, request.mutable_region());
    request.set_level(static_cast<std::uint32_t>(options_.level));
    SelectCells(options_.cells, request);
    if (const auto held = store_.held(); held && !start_over_)
      wire::ToProto(*held, request.mutable_resume_from());
    request.set_min_interval_s(options_.min_interval_s);
    request.set_bytes_per_s_max(options_.bytes_per_s_max);
    return request;
  }

  absl::StatusOr<Taken> Take(const v1::WatchTilesResponse& response) {
    GEM_ASSIGN_OR_RETURN(MirrorPart part, DecodePart(response, options_.level, options_.cells));
    const bool holds_one = store_.held().has_value();
    GEM_ASSIGN_OR_RETURN(const MirrorStore::Taken taken, store_.Take(std::move(part)));
    resets_ = resets_ || response.reset();
    if (taken == MirrorStore::Taken::kPart) return Taken::kPart;
    Count(taken == MirrorStore::Taken::kVersion, response.num_versions_skipped(),
          std::exchange(resets_, false) && holds_one);
    if (taken == MirrorStore::Taken::kVersion) {
      state_.Notify();
      if (options_.on_version) options_.on_version(store_.snapshot(), store_.changed());
    }
    return Taken::kComplete;
  }

  void Count(bool version, std::uint64_t num_versions_skipped, bool resync) {
    MutexLock lock(mutex_);
    num_versions_ += version ? 1 : 0;
    num_versions_skipped_ += num_versions_skipped;
    num_resyncs_ += resync ? 1 : 0;
  }

  // Constant after construction.
  const std::shared_ptr<const Connection> connection_;
  const MirrorOptions options_;
  const std::unique_ptr<v1::TileService::Stub> stub_;

  WatchState state_;
  mutable Mutex mutex_;
  std::uint64_t num_versions_ ABSL_GUARDED_BY(mutex_) = 0;
  std::uint64_t num_versions_skipped_ ABSL_GUARDED_BY(mutex_) = 0;
  std::uint64_t num_resyncs_ ABSL_GUARDED_BY(mutex_) = 0;

  // The thread's own, but for store_.snapshot().
  MirrorStore store_;
  bool start_over_ = false;  ///< the next stream begins from nothing
  bool resets_ = false;      ///< a part of the change had reset set

  RetryThread thread_;
};

MapMirror::MapMirror(std::shared_ptr<const Connection> connection, MirrorOptions options)
    : impl_(std::make_unique<Impl>(std::move(connection), std::move(options))) {}

MapMirror::~MapMirror() = default;

std::shared_ptr<const MirroredMap> MapMirror::map() const { return impl_->map(); }

absl::StatusOr<std::shared_ptr<const MirroredMap>> MapMirror::WaitForOther(
    const std::optional<MapVersion>& than, double timeout_s) const {
  return impl_->WaitForOther(than, timeout_s);
}

MirrorStats MapMirror::stats() const { return impl_->stats(); }

}  // namespace gem::client
