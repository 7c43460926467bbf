#include "server/import_reactor.h"

#include <utility>

#include "core/base/status_macros.h"
#include "proto/wire/refusal.h"
#include "server/map_listing.h"
#include "server/status_mapping.h"

namespace gem {
namespace {

/// Of the bytes of one message: what inflates them holds no more of the file.
constexpr std::size_t kDataBytes_max = std::size_t{4} << 20;

}  // namespace

ImportReactor::ImportReactor(const grpc::CallbackServerContext* context,
                             v1::ImportMapResponse* response, MapImport import, WorkerPool& pool,
                             MethodMetrics& metrics)
    : context_(context),
      response_(response),
      import_(std::move(import)),
      pool_(pool),
      metrics_(metrics) {
  metrics_.Begin();
  StartRead(&request_);
}

void ImportReactor::OnReadDone(bool ok) {
  if (ok) metrics_.CountReceived(request_.ByteSizeLong());
  const absl::Status queued = pool_.Submit([this, ok] { ok ? Take() : MakeMap(); });
  if (!queued.ok()) End(queued);
}

void ImportReactor::Take() {
  if (!has_begun_) {
    has_begun_ = true;
    const absl::StatusOr<std::shared_ptr<MapActor>> earlier =
        import_->Begin(request_.map(), request_.request_id());
    if (!earlier.ok()) return End(earlier.status());
    if (*earlier != nullptr) return EndWith(**earlier);
  } else if (!request_.map().empty() || !request_.request_id().empty()) {
    return End(wire::WithField(
        absl::InvalidArgumentError("map is set again, want it in the first message only"), "map"));
  }
  if (request_.data().size() >= kDataBytes_max)
    return End(wire::Refuse(wire::FieldPath("data"),
                            absl::StrCat(request_.data().size(), " bytes in a message"),
                            absl::StrCat("less than ", kDataBytes_max)));
  if (const absl::Status fed = import_->Feed(request_.data()); !fed.ok()) return End(fed);
  StartRead(&request_);
}

void ImportReactor::MakeMap() {
  if (context_->IsCancelled()) return End(absl::CancelledError("the client has gone"));
  if (!has_begun_)
    return End(wire::WithField(absl::InvalidArgumentError("map is unset, want a map id"), "map"));
  const absl::StatusOr<std::shared_ptr<MapActor>> map = import_->Finish(cancel_);
  if (!map.ok()) return End(map.status());
  EndWith(**map);
}

void ImportReactor::EndWith(const MapActor& map) {
  MapToProto(map, response_->mutable_map());
  metrics_.CountSent(response_->ByteSizeLong());
  End(absl::OkStatus());
}

void ImportReactor::End(const absl::Status& status) {
  // Before the client is told: it may come back at once.
  import_.reset();
  metrics_.End(CodeName(status),
               std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count());
  Finish(ToGrpc(status));
}

}  // namespace gem
