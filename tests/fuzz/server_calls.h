// Every RPC of a running server, fed with bytes as they could come over the wire: what it answers
// must be an answer or a refusal, never an accident. New RPCs are found by reflection.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gem::fuzz {

/// The first byte chooses the RPC; then come its messages (framed_messages.h). An RPC that takes
/// one message takes the first.
void ServerCall(const std::uint8_t* data, std::size_t size);

/// A good request of every RPC, and a session's life.
std::vector<std::string> ServerCallSeeds();

}  // namespace gem::fuzz
