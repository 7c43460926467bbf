// Maps, sessions and submaps as text and as JSON.
#pragma once

#include <string>
#include <vector>

#include "client/map_types.h"

namespace gem::client {

std::string MapJson(const MapInfo& map);
/// A line each, under a heading.
std::string MapsTable(const std::vector<MapInfo>& maps);

std::string SessionsJson(const std::string& map, const std::vector<SessionInfo>& sessions);
std::string SessionsTable(const std::vector<SessionInfo>& sessions);

std::string SubmapsJson(const std::string& map, const std::vector<SubmapInfo>& submaps);
std::string SubmapsTable(const std::vector<SubmapInfo>& submaps);

/// "epoch":1,"revision":2
std::string VersionJson(const MapVersion& version);

}  // namespace gem::client
