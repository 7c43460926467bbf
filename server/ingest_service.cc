#include "server/ingest_service.h"

#include <memory>
#include <utility>

#include "proto/wire/correction.h"
#include "proto/wire/map.h"

namespace gem {

IngestService::IngestService(Registry& registry, const ServerOptions& options, Metrics& metrics,
                             CallGuard& guard)
    : registry_(registry),
      options_(options),
      guard_(guard),
      ingest_(metrics.AddMethod("Ingest")),
      correct_trajectory_(metrics.AddMethod("CorrectTrajectory")) {}

grpc::ServerBidiReactor<v1::IngestRequest, v1::IngestResponse>* IngestService::Ingest(
    grpc::CallbackServerContext* /*context*/) {
  const auto reactor = std::make_shared<IngestReactor>(registry_, options_, ingest_, streams_);
  reactor->Start();
  return reactor.get();  // keeps itself alive
}

grpc::ServerUnaryReactor* IngestService::CorrectTrajectory(
    grpc::CallbackServerContext* context, const v1::CorrectTrajectoryRequest* request,
    v1::CorrectTrajectoryResponse* response) {
  return guard_.RunAsync(
      context, {request, response}, correct_trajectory_, [=, this](GuardedCall* call) {
        absl::StatusOr<wire::CorrectionRequest> correction = wire::FromProto(*request);
        if (!correction.ok()) return call->Complete(correction.status());
        const absl::StatusOr<std::shared_ptr<MapActor>> map = registry_.FindMap(correction->map);
        if (!map.ok()) return call->Complete(map.status());
        (*map)->Correct(correction->session, correction->request_id, std::move(correction->poses),
                        [call, response](const absl::StatusOr<CorrectionAnswer>& answer) {
                          if (!answer.ok()) return call->Complete(answer.status());
                          wire::ToProto(answer->version, response->mutable_version());
                          response->set_num_moved_submaps(answer->num_moved_submaps);
                          response->set_num_touched_tiles(answer->num_touched_tiles);
                          response->set_num_poses_ahead(answer->num_poses_ahead);
                          response->set_num_poses_ignored(answer->num_poses_ignored);
                          call->Complete(absl::OkStatus());
                        });
      });
}

}  // namespace gem
