// Decoders of single messages, without a server or a client around them: fast, so that a fuzzer
// gets deep into them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gem::fuzz {

/// A serialised IngestRequest: decoded, judged, and fused if it is good.
void IngestRequest(const std::uint8_t* data, std::size_t size);
/// A serialised Tile, as a client decodes it.
void Tile(const std::uint8_t* data, std::size_t size);
/// A serialised LocalMap, as a client decodes it.
void LocalMap(const std::uint8_t* data, std::size_t size);

/// Small good messages to start from.
std::vector<std::string> IngestRequestSeeds();
std::vector<std::string> TileSeeds();
std::vector<std::string> LocalMapSeeds();

}  // namespace gem::fuzz
