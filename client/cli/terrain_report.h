// Answers about the ground as text for people and JSON for programs.
#pragma once

#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "client/map_types.h"

namespace gem::client {

/// "free", "obstacle", "height_only" or "unknown".
absl::string_view NameOf(GroundState state);

/// "1.5,-2" as it is typed. INVALID_ARGUMENT names the option.
absl::StatusOr<Place> ParsePlace(absl::string_view option, const std::string& text);

/// A line each.
std::string HeightsTable(const std::vector<Place>& points, const GroundHeights& heights);
std::string HeightsJson(const std::vector<Place>& points, const GroundHeights& heights);

/// Whether it is free, how far, and the worst cell; the samples are in the JSON only.
std::string PathText(const CheckedPath& path);
std::string PathJson(const CheckedPath& path);

}  // namespace gem::client
