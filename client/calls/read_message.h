// Reads from a stream, and tells its end from bytes that are no message. Private to the library.
#pragma once

#include <cstdint>
#include <random>

namespace gem::client {

enum class Got : std::uint8_t {
  kMessage,
  kEnd,
  /// Bytes that are no message. The stream goes on: Finish() would wait for the end of it for ever,
  /// so that the call must be cancelled first.
  kDamage,
};

/// reader.Read(), which says no in both cases.
template <typename Reader, typename Message>
Got ReadMessage(Reader& reader, Message& message) {
  // Parsing clears a message before it fails; at the end of a stream nothing is parsed. Nobody
  // outside knows the mark.
  static const std::uint64_t mark = std::random_device()();
  constexpr int kMarkField = 1;
  message.Clear();
  message.GetReflection()->MutableUnknownFields(&message)->AddFixed64(kMarkField, mark);
  if (reader.Read(&message)) return Got::kMessage;
  const auto& left = message.GetReflection()->GetUnknownFields(message);
  const bool untouched = left.field_count() == 1 && left.field(0).number() == kMarkField &&
                         left.field(0).type() == left.field(0).TYPE_FIXED64 &&
                         left.field(0).fixed64() == mark;
  return untouched ? Got::kEnd : Got::kDamage;
}

}  // namespace gem::client
