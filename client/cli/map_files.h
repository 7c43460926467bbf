// Maps between a server and files, piece by piece: a map may be larger than memory.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "client/map_client.h"

namespace gem::client {

/// Writes the map beside `path` and renames it over `path` once it is complete. Returns its bytes.
absl::StatusOr<std::uint64_t> ExportMapFile(const MapClient& client, const std::string& map,
                                            const std::string& path);

/// Makes a map of the file.
absl::StatusOr<MapInfo> ImportMapFile(const MapClient& client, const std::string& map,
                                      const std::string& path, const std::string& request_id);

}  // namespace gem::client
