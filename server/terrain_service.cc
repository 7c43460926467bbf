#include "server/terrain_service.h"

#include <memory>
#include <optional>
#include <vector>

#include "core/base/status_macros.h"
#include "core/global/path_check.h"
#include "core/global/terrain_reader.h"
#include "proto/wire/map.h"
#include "proto/wire/refusal.h"
#include "proto/wire/terrain.h"
#include "server/find_snapshot.h"

namespace gem {
namespace {

using Snapshot = std::shared_ptr<const MapSnapshot>;

template <typename Request>
absl::StatusOr<Snapshot> SnapshotFor(const Registry& registry, const Request& request) {
  return FindSnapshot(
      registry, request.map(),
      request.has_at() ? std::optional(wire::FromProto(request.at())) : std::nullopt);
}

/// Core's text begins with the field that it refuses.
absl::Status WithFieldOfText(const absl::Status& status) {
  if (!absl::IsInvalidArgument(status)) return status;
  const absl::string_view text = status.message();
  return wire::WithField(status, text.substr(0, text.find(' ')));
}

absl::Status AnswerHeights(const Registry& registry, const v1::SampleHeightsRequest& request,
                           Abandoned abandoned, v1::SampleHeightsResponse* response) {
  GEM_ASSIGN_OR_RETURN(const std::vector<Place> points, wire::PointsFromProto(request));
  GEM_ASSIGN_OR_RETURN(const Snapshot map, SnapshotFor(registry, request));
  GEM_ASSIGN_OR_RETURN(const std::vector<GroundSample> samples,
                       gem::SampleHeights(*map, points, abandoned));
  wire::ToProto(samples, response);
  wire::ToProto(map->version, response->mutable_version());
  return absl::OkStatus();
}

absl::Status AnswerPath(const Registry& registry, const v1::CheckPathRequest& request,
                        Abandoned abandoned, v1::CheckPathResponse* response) {
  GEM_ASSIGN_OR_RETURN(const PathQuestion question, wire::FromProto(request));
  GEM_ASSIGN_OR_RETURN(const Snapshot map, SnapshotFor(registry, request));
  const absl::StatusOr<PathCheck> check = gem::CheckPath(*map, question, abandoned);
  if (!check.ok()) return WithFieldOfText(check.status());
  wire::ToProto(*check, response);
  wire::ToProto(map->version, response->mutable_version());
  return absl::OkStatus();
}

}  // namespace

TerrainService::TerrainService(Registry& registry, Metrics& metrics, CallGuard& guard)
    : registry_(registry),
      guard_(guard),
      sample_heights_(metrics.AddMethod("SampleHeights")),
      check_path_(metrics.AddMethod("CheckPath")) {}

grpc::ServerUnaryReactor* TerrainService::SampleHeights(grpc::CallbackServerContext* context,
                                                        const v1::SampleHeightsRequest* request,
                                                        v1::SampleHeightsResponse* response) {
  return guard_.RunAsync(
      context, {request, response}, sample_heights_, [=, this](GuardedCall* call) {
        call->Complete(AnswerHeights(
            registry_, *request, [call] { return call->abandoned(); }, response));
      });
}

grpc::ServerUnaryReactor* TerrainService::CheckPath(grpc::CallbackServerContext* context,
                                                    const v1::CheckPathRequest* request,
                                                    v1::CheckPathResponse* response) {
  return guard_.RunAsync(context, {request, response}, check_path_, [=, this](GuardedCall* call) {
    call->Complete(AnswerPath(
        registry_, *request, [call] { return call->abandoned(); }, response));
  });
}

}  // namespace gem
