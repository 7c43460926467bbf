// What readers and the server say to each other, without either around it: requests as the server
// judges them, answers as the client library takes them, and what a mirror makes of a stream.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gem::fuzz {

/// The first byte chooses the request of TileService or TerrainService that the others are.
void ReaderRequest(const std::uint8_t* data, std::size_t size);
/// The first byte chooses the answer that the others are.
void ReaderAnswer(const std::uint8_t* data, std::size_t size);
/// The parts of a watch, one behind the other (framed_messages.h).
void Mirror(const std::uint8_t* data, std::size_t size);

std::vector<std::string> ReaderRequestSeeds();
std::vector<std::string> ReaderAnswerSeeds();
std::vector<std::string> MirrorSeeds();

}  // namespace gem::fuzz
