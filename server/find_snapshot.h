// How every service comes by the one version of a map that it answers from.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "core/global/map_snapshot.h"
#include "server/registry.h"

namespace gem {

/// The map's snapshot of version `at`, or its newest. INVALID_ARGUMENT for an id that is none and
/// for a revision that does not exist yet, NOT_FOUND for a map that does not exist;
/// FAILED_PRECONDITION with reason REVISION_EXPIRED for a version that is not kept any more.
absl::StatusOr<std::shared_ptr<const MapSnapshot>> FindSnapshot(
    const Registry& registry, const std::string& map, const std::optional<MapVersion>& at);
/// The same of a map that was found already.
absl::StatusOr<std::shared_ptr<const MapSnapshot>> FindSnapshot(
    const MapActor& map, const std::optional<MapVersion>& at);

}  // namespace gem
