#include "server/find_snapshot.h"

#include "core/base/status_macros.h"
#include "proto/wire/scalar.h"

namespace gem {

absl::StatusOr<std::shared_ptr<const MapSnapshot>> FindSnapshot(
    const Registry& registry, const std::string& map, const std::optional<MapVersion>& at) {
  GEM_RETURN_IF_ERROR(wire::CheckId(map, wire::FieldPath("map")));
  const absl::StatusOr<std::shared_ptr<MapActor>> actor = registry.FindMap(map);
  if (!actor.ok()) return actor.status();
  return FindSnapshot(**actor, at);
}

absl::StatusOr<std::shared_ptr<const MapSnapshot>> FindSnapshot(
    const MapActor& map, const std::optional<MapVersion>& at) {
  if (!at.has_value()) return map.snapshot();
  return map.history()->At(*at, Clock::now());
}

}  // namespace gem
