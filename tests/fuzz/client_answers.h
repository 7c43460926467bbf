// The client library, fed with whatever a server might answer: it must give an error or what it
// promises, never an accident.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gem::fuzz {

/// The first byte chooses what the client calls; then come the server's messages
/// (framed_messages.h), one for each call, or all for a stream.
void ClientAnswer(const std::uint8_t* data, std::size_t size);

std::vector<std::string> ClientAnswerSeeds();

}  // namespace gem::fuzz
