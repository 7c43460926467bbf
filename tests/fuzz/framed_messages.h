// How several messages stand in one input of a fuzzer: each with its length in two bytes before it,
// low byte first; 0xffff, or more than there is, means the rest.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace gem::fuzz {

inline constexpr std::size_t kFramedMessagesMax = 32;

/// At least one, which may be empty. Views of `bytes`.
inline std::vector<std::string_view> FramedMessages(std::string_view bytes) {
  std::vector<std::string_view> messages;
  while (messages.size() < kFramedMessagesMax && bytes.size() >= 2) {
    const auto low = static_cast<unsigned char>(bytes[0]);
    const auto high = static_cast<unsigned char>(bytes[1]);
    bytes.remove_prefix(2);
    messages.push_back(bytes.substr(0, low | static_cast<std::size_t>(high) << 8));
    bytes.remove_prefix(messages.back().size());
  }
  if (messages.empty()) messages.emplace_back();
  return messages;
}

/// Messages shorter than 65535 bytes.
inline std::string Frame(const std::vector<std::string>& messages) {
  std::string bytes;
  for (const std::string& message : messages) {
    bytes += {static_cast<char>(message.size() & 0xff), static_cast<char>(message.size() >> 8)};
    bytes += message;
  }
  return bytes;
}

}  // namespace gem::fuzz
