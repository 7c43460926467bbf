// Files of maps: the reader, and the map that it makes of what it takes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gem::fuzz {

/// The first byte says whether the rest is a file, or its sections as they are before they are
/// compressed and get their checksum, which no fuzzer could guess: framed (framed_messages.h), each
/// with its type before it. What the reader takes becomes a map, which is written and read again.
void MapFile(const std::uint8_t* data, std::size_t size);

std::vector<std::string> MapFileSeeds();

}  // namespace gem::fuzz
