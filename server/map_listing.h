// What gem.v1.MapService answers about maps, sessions and submaps: page by page, from published
// snapshots. Reads only.
#pragma once

#include "absl/status/status.h"
#include "server/map_actor.h"
#include "server/registry.h"

namespace gem::v1 {
class GetMapRequest;
class GetMapResponse;
class ListMapsRequest;
class ListMapsResponse;
class ListSessionsRequest;
class ListSessionsResponse;
class ListSubmapsRequest;
class ListSubmapsResponse;
class Map;
}  // namespace gem::v1

namespace gem {

void MapToProto(const MapActor& actor, v1::Map* proto);

absl::Status GetMap(const Registry& registry, const v1::GetMapRequest& request,
                    v1::GetMapResponse* response);
absl::Status ListMaps(const Registry& registry, const v1::ListMapsRequest& request,
                      v1::ListMapsResponse* response);
absl::Status ListSubmaps(const Registry& registry, const v1::ListSubmapsRequest& request,
                         v1::ListSubmapsResponse* response);
absl::Status ListSessions(const Registry& registry, const v1::ListSessionsRequest& request,
                          v1::ListSessionsResponse* response);

}  // namespace gem
