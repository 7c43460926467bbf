// A serialised message that shares parts with other messages: what is encoded once goes out many
// times without being parsed or copied.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace gem::wire {

class SplicedMessage {
 public:
  /// One of the two is used.
  struct Part {
    std::string own;
    std::shared_ptr<const std::string> shared;
    absl::string_view bytes() const { return shared == nullptr ? own : *shared; }
  };

  /// Appends fields that are serialised already, tags included.
  void Append(absl::string_view fields);
  /// Appends a field of type bytes, string or message with this content.
  void AppendShared(int field_number, std::shared_ptr<const std::string> content);
  /// The same for contents that are not shared, or only in part.
  void AppendField(int field_number, absl::string_view content);
  void AppendMessage(int field_number, SplicedMessage content);

  const std::vector<Part>& parts() const { return parts_; }
  std::size_t size_bytes() const { return size_bytes_; }
  /// In one piece: for tests.
  std::string Flattened() const;

 private:
  /// The part that may be written to: small ones are put together.
  std::string& Own();
  void AppendHeader(int field_number, std::size_t content_bytes);

  std::vector<Part> parts_;
  std::size_t size_bytes_ = 0;
};

}  // namespace gem::wire
