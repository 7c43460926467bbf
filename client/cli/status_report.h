// A server's state as text: a table for people, JSON for programs.
#pragma once

#include <string>
#include <vector>

#include "client/map_types.h"

namespace gem::client {

std::string StatusTable(const ServerStatus& status, const std::vector<MapInfo>& maps);

/// One object: server_version, backend, uptime_s, maps[], sessions[], timings[].
std::string StatusJson(const ServerStatus& status, const std::vector<MapInfo>& maps);

}  // namespace gem::client
