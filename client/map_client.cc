#include "client/map_client.h"

#include <chrono>
#include <random>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/calls/map_stubs.h"
#include "core/base/status_macros.h"
#include "proto/wire/correction.h"
#include "proto/wire/map.h"
#include "proto/wire/pose.h"

namespace gem::client {
namespace {

constexpr std::uint32_t kPageSize = 1000;
/// A server that never ends its pages must not fill our memory.
constexpr int kPagesMax = 100'000;
constexpr auto kCorrectionPause = std::chrono::milliseconds(200);

absl::StatusOr<SubmapInfo> FromProto(const v1::Submap& proto, const wire::FieldPath& field) {
  auto T_G_K =
      wire::FromProto<Global, Submap>(proto.map_from_submap(), field.Child("map_from_submap"));
  if (!T_G_K.ok()) return T_G_K.status();
  return SubmapInfo{proto.id(),
                    proto.session(),
                    {proto.robots().begin(), proto.robots().end()},
                    *T_G_K,
                    proto.anchor_stamp_ns(),
                    proto.num_points(),
                    proto.first_stamp_ns(),
                    proto.last_stamp_ns(),
                    proto.finished(),
                    proto.has_extent()
                        ? std::optional(Region{proto.extent().x_min(), proto.extent().y_min(),
                                               proto.extent().x_max(), proto.extent().y_max()})
                        : std::nullopt,
                    {proto.sessions().begin(), proto.sessions().end()}};
}

template <typename Proto>
std::vector<TimingBucket> BucketsOf(const Proto& proto) {
  std::vector<TimingBucket> buckets;
  for (const v1::TimingBucket& bucket : proto.buckets())
    buckets.push_back({bucket.upper_s(), bucket.count()});
  return buckets;
}

ServerStatus FromProto(const v1::GetServerStatusResponse& proto) {
  ServerStatus status{proto.server_version(), proto.backend(), proto.uptime_s(), {}, {}};
  for (const v1::SessionStatus& s : proto.sessions())
    status.sessions.push_back({s.map(), s.robot(), s.session(), s.active(), s.connected(),
                               s.num_scans_fused(), s.num_scans_refused(), s.num_scans_dropped(),
                               s.queue_bytes(), s.fused_seq(), s.oldest_s()});
  for (const v1::StageTiming& t : proto.timings())
    status.timings.push_back(
        {t.mapper(), t.stage(), t.count(), t.total_s(), t.max_s(), BucketsOf(t)});
  for (const v1::CallStatus& c : proto.calls())
    status.calls.push_back({c.method(), c.num_started(), c.num_failed(), c.num_active(),
                            c.received_bytes(), c.sent_bytes(), c.total_s(), BucketsOf(c)});
  for (const v1::MapLag& l : proto.lags())
    status.lags.push_back(
        {l.map(), l.staleness_s(), l.version_age_s(), l.num_corrections_waiting()});
  const v1::ProcessStatus& process = proto.process();
  status.process = {process.resident_bytes(), process.cpu_s(), process.num_threads(),
                    process.num_open_files()};
  status.tiles = {proto.tiles().num_full(), proto.tiles().num_absent()};
  return status;
}

absl::Status NeverStillError(const std::string& map, int tries) {
  return absl::AbortedError(
      absl::StrCat("map ", map, " changed ", tries, " times while it was read"));
}

}  // namespace

MapInfo MapInfoOf(const v1::Map& proto) {
  return {proto.id(),
          proto.cell_size_m(),
          proto.submap_length_m(),
          proto.traversable_only(),
          wire::FromProto(proto.version()),
          proto.num_submaps(),
          proto.num_points(),
          proto.submap_bytes(),
          proto.num_tiles(),
          {proto.sessions().begin(), proto.sessions().end()},
          proto.num_sessions()};
}

MapClient::MapClient(std::shared_ptr<const Connection> connection, MapClientOptions options)
    : connection_(std::move(connection)),
      options_(options),
      stubs_(std::make_unique<Stubs>(*connection_)) {}

MapClient::~MapClient() = default;

absl::StatusOr<MapInfo> MapClient::GetMap(const std::string& map) const {
  v1::GetMapRequest request;
  v1::GetMapResponse response;
  request.set_map(map);
  GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->map, &v1::MapService::Stub::GetMap, options_.deadline_s,
                                   request, response));
  return MapInfoOf(response.map());
}

absl::StatusOr<std::vector<MapInfo>> MapClient::ListMaps() const {
  std::vector<MapInfo> maps;
  v1::ListMapsRequest request;
  request.set_page_size(kPageSize);
  for (int page = 0; page < kPagesMax; ++page) {
    v1::ListMapsResponse response;
    GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->map, &v1::MapService::Stub::ListMaps,
                                     options_.deadline_s, request, response));
    for (const v1::Map& map : response.maps()) maps.push_back(MapInfoOf(map));
    if (response.next_page_token().empty()) return maps;
    request.set_page_token(response.next_page_token());
  }
  return absl::InternalError(absl::StrCat("the list of maps has more than ", kPagesMax, " pages"));
}

absl::StatusOr<std::vector<SubmapInfo>> MapClient::ListSubmaps(const std::string& map) const {
  for (int tries = 0; tries < options_.consistent_tries_max; ++tries) {
    std::vector<SubmapInfo> submaps;
    std::optional<MapVersion> version;
    v1::ListSubmapsRequest request;
    request.set_map(map);
    request.set_page_size(kPageSize);
    for (int page = 0; page < kPagesMax; ++page) {
      v1::ListSubmapsResponse response;
      GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->map, &v1::MapService::Stub::ListSubmaps,
                                       options_.deadline_s, request, response));
      const MapVersion page_version = wire::FromProto(response.version());
      if (version.value_or(page_version) != page_version) break;
      version = page_version;
      for (const v1::Submap& proto : response.submaps()) {
        GEM_ASSIGN_OR_RETURN(SubmapInfo submap, FromProto(proto, wire::FieldPath("submaps")));
        submaps.push_back(std::move(submap));
      }
      if (response.next_page_token().empty()) return submaps;
      request.set_page_token(response.next_page_token());
    }
  }
  return NeverStillError(map, options_.consistent_tries_max);
}

absl::StatusOr<CorrectionResult> MapClient::CorrectTrajectory(const Correction& correction) const {
  v1::CorrectTrajectoryRequest request;
  wire::ToProto(
      {correction.map, correction.session,
       correction.request_id.empty() ? UniqueId() : correction.request_id, correction.poses},
      &request);
  absl::Status status;
  for (int tries = 0; tries < options_.correction_tries_max; ++tries) {
    if (tries > 0) std::this_thread::sleep_for(kCorrectionPause);
    v1::CorrectTrajectoryResponse response;
    status = stubs_->Call(*stubs_->ingest, &v1::IngestService::Stub::CorrectTrajectory,
                          options_.correction_deadline_s, request, response);
    if (status.ok())
      return CorrectionResult{wire::FromProto(response.version()), response.num_moved_submaps(),
                              response.num_touched_tiles(), response.num_poses_ahead(),
                              response.num_poses_ignored()};
    if (!absl::IsUnavailable(status)) break;
  }
  return status;
}

absl::StatusOr<ServerStatus> MapClient::GetServerStatus() const {
  const v1::GetServerStatusRequest request;
  v1::GetServerStatusResponse response;
  GEM_RETURN_IF_ERROR(stubs_->Call(*stubs_->map, &v1::MapService::Stub::GetServerStatus,
                                   options_.deadline_s, request, response));
  return FromProto(response);
}

std::string UniqueId() {
  std::random_device random;
  return absl::StrFormat("%08x%08x", random(), random());
}

}  // namespace gem::client
