#include "server/map_listing.h"

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "absl/container/flat_hash_map.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/base/status_macros.h"
#include "gem/v1/map_service.pb.h"
#include "proto/wire/map.h"
#include "proto/wire/pose.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"

namespace gem {
namespace {

constexpr std::uint32_t kPageSizeDefault = 100;
constexpr std::uint32_t kPageSizeMax = 1000;
constexpr std::size_t kSessionsOfMap_max = 100;

absl::StatusOr<std::size_t> PageSize(std::uint32_t page_size) {
  if (page_size > kPageSizeMax)
    return wire::Refuse(wire::FieldPath("page_size"), absl::StrCat(page_size),
                        absl::StrCat("at most ", kPageSizeMax));
  return page_size == 0 ? kPageSizeDefault : page_size;
}

absl::Status RefusePageToken() {
  // Not repeated: it is the caller's and may be long.
  return wire::Refuse(wire::FieldPath("page_token"), "not one of this server's",
                      "next_page_token of the page before");
}

/// What hangs on a session's trajectory.
struct Share {
  std::uint64_t num_submaps = 0;
  std::uint64_t num_points = 0;
};

absl::flat_hash_map<absl::string_view, Share> SharesOf(const MapSnapshot& map) {
  absl::flat_hash_map<absl::string_view, Share> shares;
  for (const SubmapInfo& submap : map.submaps) {
    Share& share = shares[submap.origin.session];
    ++share.num_submaps;
    share.num_points += submap.num_cells;
  }
  return shares;
}

}  // namespace

void MapToProto(const MapActor& actor, v1::Map* proto) {
  const std::shared_ptr<const MapSnapshot> map = actor.snapshot();
  proto->set_id(actor.id());
  proto->set_cell_size_m(map->options.cell_size_m);
  proto->set_submap_length_m(map->options.submap_length_m);
  proto->set_traversable_only(map->options.traversable_only);
  wire::ToProto(map->version, proto->mutable_version());
  proto->set_num_submaps(map->submaps.size());
  proto->set_num_points(map->num_points);
  proto->set_submap_bytes(map->submap_bytes);
  proto->set_num_tiles(map->tiles.size());
  MapActor::SessionPage newest = actor.NewestSessions(kSessionsOfMap_max);
  proto->set_num_sessions(newest.first + newest.sessions.size());
  for (MapActor::NewSession& session : newest.sessions)
    proto->add_sessions(std::move(session.session));
}

absl::Status GetMap(const Registry& registry, const v1::GetMapRequest& request,
                    v1::GetMapResponse* response) {
  GEM_RETURN_IF_ERROR(wire::CheckId(request.map(), wire::FieldPath("map")));
  const absl::StatusOr<std::shared_ptr<MapActor>> map = registry.FindMap(request.map());
  if (!map.ok()) return map.status();
  MapToProto(**map, response->mutable_map());
  return absl::OkStatus();
}

absl::Status ListMaps(const Registry& registry, const v1::ListMapsRequest& request,
                      v1::ListMapsResponse* response) {
  GEM_ASSIGN_OR_RETURN(const std::size_t page_size, PageSize(request.page_size()));
  const std::string& after = request.page_token();
  if (!after.empty() && !wire::CheckId(after, wire::FieldPath("page_token")).ok())
    return RefusePageToken();
  // The token is the last id of the page before: maps that come and go in between shift nothing.
  for (const std::shared_ptr<MapActor>& map : registry.Maps()) {
    if (!after.empty() && map->id() <= after) continue;
    if (static_cast<std::size_t>(response->maps_size()) == page_size) {
      response->set_next_page_token(response->maps(response->maps_size() - 1).id());
      break;
    }
    MapToProto(*map, response->add_maps());
  }
  return absl::OkStatus();
}

absl::Status ListSubmaps(const Registry& registry, const v1::ListSubmapsRequest& request,
                         v1::ListSubmapsResponse* response) {
  GEM_RETURN_IF_ERROR(wire::CheckId(request.map(), wire::FieldPath("map")));
  GEM_ASSIGN_OR_RETURN(const std::size_t page_size, PageSize(request.page_size()));
  std::uint64_t after = 0;
  const bool first_page = request.page_token().empty();
  if (!first_page && !absl::SimpleAtoi(request.page_token(), &after)) return RefusePageToken();
  const absl::StatusOr<std::shared_ptr<MapActor>> map = registry.FindMap(request.map());
  if (!map.ok()) return map.status();
  const std::shared_ptr<const MapSnapshot> snapshot = (*map)->snapshot();
  for (const SubmapInfo& submap : snapshot->submaps) {
    if (!first_page && static_cast<std::uint64_t>(submap.origin.id) <= after) continue;
    if (static_cast<std::size_t>(response->submaps_size()) == page_size) {
      response->set_next_page_token(
          absl::StrCat(response->submaps(response->submaps_size() - 1).id()));
      break;
    }
    wire::ToProto(submap, snapshot->options.cell_size_m, response->add_submaps());
  }
  wire::ToProto(snapshot->version, response->mutable_version());
  return absl::OkStatus();
}

absl::Status ListSessions(const Registry& registry, const v1::ListSessionsRequest& request,
                          v1::ListSessionsResponse* response) {
  GEM_RETURN_IF_ERROR(wire::CheckId(request.map(), wire::FieldPath("map")));
  GEM_ASSIGN_OR_RETURN(const std::size_t page_size, PageSize(request.page_size()));
  const absl::StatusOr<std::shared_ptr<MapActor>> map = registry.FindMap(request.map());
  if (!map.ok()) return map.status();
  const auto page = (*map)->SessionsAfter(request.page_token(), page_size);
  if (!page.has_value()) return RefusePageToken();
  const std::shared_ptr<const MapSnapshot> snapshot = (*map)->snapshot();
  const auto shares = SharesOf(*snapshot);
  for (std::size_t i = 0; i < page->sessions.size(); ++i) {
    const MapActor::NewSession& session = page->sessions[i];
    v1::Session* proto = response->add_sessions();
    proto->set_id(session.session);
    proto->set_robot(session.robot);
    // Both are in order of arrival; one that has just come is not published yet.
    const bool is_published = page->first + i < snapshot->sessions.size();
    const SessionInfo* info = is_published ? &snapshot->sessions[page->first + i] : nullptr;
    proto->set_active(info == nullptr || !info->ended);
    proto->set_retracted(info != nullptr && info->retracted);
    wire::ToProto(info == nullptr ? session.T_G_O : info->T_G_O, proto->mutable_map_from_odom());
    const auto share = shares.find(session.session);
    if (share == shares.end()) continue;
    proto->set_num_submaps(share->second.num_submaps);
    proto->set_num_points(share->second.num_points);
  }
  if (!page->is_last) response->set_next_page_token(page->sessions.back().session);
  return absl::OkStatus();
}

}  // namespace gem
