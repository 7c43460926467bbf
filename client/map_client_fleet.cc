// What fleet backends do: maps that are made, deleted, exported and imported; sessions that are
// listed, retracted and restored.
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/calls/map_stubs.h"
#include "core/base/status_macros.h"
#include "proto/wire/map.h"
#include "proto/wire/pose.h"

namespace gem::client {
namespace {

constexpr std::uint32_t kPageSize = 1000;
/// A server that never ends its pages must not fill our memory.
constexpr int kPagesMax = 10'000;
constexpr auto kPause = std::chrono::milliseconds(200);
/// Of a file in one message.
constexpr std::size_t kDataBytes = std::size_t{512} << 10;

std::string OrUnique(const std::string& request_id) {
  return request_id.empty() ? UniqueId() : request_id;
}

/// Again, if the server was not reached.
template <typename Call>
absl::Status Repeated(int tries_max, const Call& call) {
  absl::Status status;
  for (int tries = 0; tries < tries_max; ++tries) {
    if (tries > 0) std::this_thread::sleep_for(kPause);
    status = call();
    if (!absl::IsUnavailable(status)) break;
  }
  return status;
}

}  // namespace

absl::StatusOr<MapInfo> MapClient::CreateMap(const NewMap& map,
                                             const std::string& request_id) const {
  v1::CreateMapRequest request;
  v1::CreateMapResponse response;
  request.set_map(map.map);
  request.set_request_id(OrUnique(request_id));
  v1::MapSetup& setup = *request.mutable_setup();
  if (map.cell_size_m) setup.set_cell_size_m(*map.cell_size_m);
  if (map.submap_length_m) setup.set_submap_length_m(*map.submap_length_m);
  setup.set_traversable_only(map.traversable_only);
  GEM_RETURN_IF_ERROR(Repeated(options_.correction_tries_max, [&] {
    return stubs_->Call(*stubs_->map, &v1::MapService::Stub::CreateMap, options_.deadline_s,
                        request, response);
  }));
  return MapInfoOf(response.map());
}

absl::Status MapClient::DeleteMap(const std::string& map, bool force,
                                  const std::string& request_id) const {
  v1::DeleteMapRequest request;
  request.set_map(map);
  request.set_force(force);
  request.set_request_id(OrUnique(request_id));
  return Repeated(options_.correction_tries_max, [&] {
    v1::DeleteMapResponse response;
    return stubs_->Call(*stubs_->map, &v1::MapService::Stub::DeleteMap, options_.deadline_s,
                        request, response);
  });
}

absl::StatusOr<std::vector<SessionInfo>> MapClient::ListSessions(const std::string& map) const {
  std::vector<SessionInfo> sessions;
  v1::ListSessionsRequest request;
  request.set_map(map);
  request.set_page_size(kPageSize);
  for (int page = 0; page < kPagesMax; ++page) {
    v1::ListSessionsResponse response;
    GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->map, &v1::MapService::Stub::ListSessions,
                                     options_.deadline_s, request, response));
    for (const v1::Session& proto : response.sessions()) {
      auto T_G_O = wire::FromProto<Global, Odom>(proto.map_from_odom(),
                                                 wire::FieldPath("sessions.map_from_odom"));
      if (!T_G_O.ok()) return T_G_O.status();
      sessions.push_back({proto.id(), proto.robot(), proto.active(), proto.retracted(), *T_G_O,
                          proto.num_submaps(), proto.num_points()});
    }
    if (response.next_page_token().empty()) return sessions;
    request.set_page_token(response.next_page_token());
  }
  return absl::InternalError(
      absl::StrCat("the list of sessions has more than ", kPagesMax, " pages"));
}

absl::StatusOr<RetractionResult> MapClient::RetractSession(const std::string& map,
                                                           const std::string& session, bool restore,
                                                           const std::string& request_id) const {
  v1::RetractSessionRequest request;
  v1::RetractSessionResponse response;
  request.set_map(map);
  request.set_session(session);
  request.set_restore(restore);
  request.set_request_id(OrUnique(request_id));
  GEM_RETURN_IF_ERROR(Repeated(options_.correction_tries_max, [&] {
    return stubs_->Call(*stubs_->map, &v1::MapService::Stub::RetractSession,
                        options_.correction_deadline_s, request, response);
  }));
  return RetractionResult{wire::FromProto(response.version()), response.num_submaps(),
                          response.num_merged_points(), response.num_touched_tiles()};
}

absl::Status MapClient::ExportMap(
    const std::string& map, const std::function<absl::Status(absl::string_view)>& write) const {
  grpc::ClientContext context;
  Stubs::SetDeadline(context, options_.transfer_deadline_s);
  v1::ExportMapRequest request;
  request.set_map(map);
  const auto stream = stubs_->map->ExportMap(&context, request);
  absl::Status written;
  v1::ExportMapResponse response;
  while (written.ok() && stream->Read(&response)) written = write(response.data());
  if (!written.ok()) context.TryCancel();
  const absl::Status ended = ToStatus(stream->Finish(), stubs_->address);
  return written.ok() ? ended : written;
}

absl::StatusOr<MapInfo> MapClient::ImportMap(
    const std::string& map, const std::function<absl::StatusOr<std::string>(std::size_t)>& read,
    const std::string& request_id) const {
  grpc::ClientContext context;
  Stubs::SetDeadline(context, options_.transfer_deadline_s);
  v1::ImportMapResponse response;
  const auto stream = stubs_->map->ImportMap(&context, &response);
  v1::ImportMapRequest request;
  request.set_map(map);
  request.set_request_id(OrUnique(request_id));
  absl::Status unread;
  while (true) {
    absl::StatusOr<std::string> data = read(kDataBytes);
    if (!data.ok()) {
      unread = data.status();
      context.TryCancel();
      break;
    }
    if (data->empty()) break;
    request.set_data(*std::move(data));
    // The server has refused it, or knows it already.
    if (!stream->Write(request)) break;
    request.Clear();
  }
  stream->WritesDone();
  const absl::Status ended = ToStatus(stream->Finish(), stubs_->address);
  if (!unread.ok()) return unread;
  if (!ended.ok()) return ended;
  return MapInfoOf(response.map());
}

}  // namespace gem::client
