// MapClient: questions about the ground.
#include "client/calls/map_stubs.h"
#include "client/map_client.h"
#include "core/base/status_macros.h"
#include "proto/wire/map.h"
#include "proto/wire/terrain.h"

namespace gem::client {

absl::StatusOr<GroundHeights> MapClient::SampleHeights(const std::string& map,
                                                       const std::vector<Place>& points,
                                                       const std::optional<MapVersion>& at) const {
  v1::SampleHeightsRequest request;
  v1::SampleHeightsResponse response;
  request.set_map(map);
  wire::ToProto(points, &request);
  if (at) wire::ToProto(*at, request.mutable_at());
  GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->terrain, &v1::TerrainService::Stub::SampleHeights,
                                   options_.deadline_s, request, response));
  GEM_ASSIGN_OR_RETURN(std::vector<GroundSample> samples, wire::FromProto(response, points.size()));
  return GroundHeights{std::move(samples), wire::FromProto(response.version())};
}

absl::StatusOr<CheckedPath> MapClient::CheckPath(const std::string& map,
                                                 const PathQuestion& question,
                                                 const std::optional<MapVersion>& at) const {
  v1::CheckPathRequest request;
  v1::CheckPathResponse response;
  request.set_map(map);
  wire::ToProto(question, &request);
  if (at) wire::ToProto(*at, request.mutable_at());
  GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->terrain, &v1::TerrainService::Stub::CheckPath,
                                   options_.deadline_s, request, response));
  GEM_ASSIGN_OR_RETURN(PathCheck check, wire::FromProto(response));
  return CheckedPath{std::move(check), wire::FromProto(response.version())};
}

}  // namespace gem::client
