// Everything that a map is made of, as it was published: what is written into a file and read back.
// Immutable parts are shared with the mapper. Knows no format.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/pose.h"
#include "core/global/correction.h"
#include "core/global/global_map_options.h"
#include "core/global/submap.h"
#include "core/grid/map_version.h"
#include "core/local/local_map.h"

namespace gem {

/// A session, with what it had in hand.
struct SessionState {
  std::string session;
  std::string robot;
  SessionTrajectory::State trajectory;
  bool ended = false;
  bool retracted = false;
  SubmapId active_id{};                       ///< of active
  std::shared_ptr<const Submap> active;       ///< the submap that grew; null: there was none
  std::shared_ptr<const LocalMap> local_map;  ///< null: there was none
};

/// A finished submap. One of seen and hidden is not null.
struct FinishedSubmapState {
  SubmapId id{};
  std::shared_ptr<const Submap> seen;    ///< null: nothing of it
  std::shared_ptr<const Submap> hidden;  ///< what a retraction hides; null: nothing of it
  /// T_G_K at which it was hidden as a whole; unset if the map has changed since.
  std::optional<Pose<Global, Submap>> left_T_G_K;
};

struct MapState {
  GlobalMapOptions options;
  MapVersion version;
  std::uint64_t last_submap_id = 0;          ///< ids of later ones are larger
  std::vector<SessionState> sessions;        ///< by order of arrival
  std::vector<FinishedSubmapState> submaps;  ///< by id
};

}  // namespace gem
