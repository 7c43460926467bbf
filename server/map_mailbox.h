// What waits for one map: live data and corrections, coalesced per session. Not thread-safe: the
// map actor guards it.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/global/global_mapper.h"
#include "server/ingest_message.h"
#include "server/request_book.h"

namespace gem {

/// What a correction did, once it is published.
struct CorrectionAnswer {
  MapVersion version;
  std::uint32_t num_moved_submaps = 0;
  std::uint32_t num_touched_tiles = 0;
  std::uint32_t num_poses_ahead = 0;
  std::uint32_t num_poses_ignored = 0;
};
/// What a retraction or a restoration did, once it is published.
struct RetractionAnswer {
  MapVersion version;
  RetractionCounts counts;
  std::uint32_t num_touched_tiles = 0;
};
/// Called from the map's thread; must not block.
using StateCallback = std::function<void(absl::StatusOr<std::shared_ptr<const MapState>>)>;
using CorrectionCallback = RequestBook<CorrectionAnswer>::Callback;
using RetractionCallback = RequestBook<RetractionAnswer>::Callback;
using PublishedCallback = std::function<void(const absl::StatusOr<MapVersion>&)>;

/// A caller that waits for its correction.
struct CorrectionWaiter {
  std::string session;
  std::string request_id;  ///< may be empty
  Clock::time_point arrived;
  CorrectionCallback done;
};

/// A caller that waits for a session to be retracted, or restored.
struct RetractionWaiter {
  std::string session;
  std::string request_id;  ///< may be empty
  bool restore = false;
  RetractionCallback done;
};

/// What one session has sent since the map last looked.
struct PendingSession {
  SessionUpdate update;  ///< coalesced: finished submaps and odometry add up, live parts replace
  bool has_update = false;
  std::vector<PublishedCallback> published;
  std::optional<CorrectedTrajectory> correction;  ///< the newest
  std::vector<CorrectionWaiter> waiters;          ///< for it, or for one that it overtook
};

/// Adds `update` to what waits.
void Coalesce(PendingSession& pending, SessionUpdate update);

}  // namespace gem
