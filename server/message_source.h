// What a stream to a reader says, one message after the other. The stream knows when it can send
// (reader_stream.h), the source what.
#pragma once

#include <optional>

#include "absl/status/status.h"
#include "proto/wire/spliced_message.h"
#include "server/ingest_message.h"

namespace gem {

class MessageSource {
 public:
  virtual ~MessageSource() = default;

  struct Next {
    std::optional<wire::SplicedMessage> message;  ///< to be sent now
    std::optional<absl::Status> end;              ///< or: the stream ends
    /// Or: there is nothing to say until then, or until there is news.
    std::optional<Clock::time_point> wake_at;
  };
  /// On a worker; never two at once.
  virtual Next TakeNext(Clock::time_point now) = 0;
  /// Since when the reader lacks something; nothing: it does not. Thread-safe.
  virtual std::optional<Clock::time_point> behind_since() const = 0;
};

}  // namespace gem
