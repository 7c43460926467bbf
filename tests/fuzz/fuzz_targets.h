// What the fuzzers feed: bytes as they could come over the wire, all the way in. They end the
// process only if something of ours is wrong. The same functions run under GoogleTest with the
// seeds.
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

/// Small good messages to start from.
std::vector<std::string> IngestRequestSeeds();
std::vector<std::string> TileSeeds();

}  // namespace gem::fuzz
