#include "proto/wire/spliced_message.h"

#include <google/protobuf/io/coded_stream.h>

#include <array>
#include <utility>

#include "absl/strings/str_cat.h"

namespace gem::wire {
namespace {

using google::protobuf::io::CodedOutputStream;

/// Wire type of fields that begin with their length.
constexpr std::uint32_t kLengthDelimited = 2;
/// Two varints of at most 32 and 64 bits.
constexpr std::size_t kHeaderBytes_max = 15;

}  // namespace

void SplicedMessage::Append(absl::string_view fields) {
  if (fields.empty()) return;
  absl::StrAppend(&Own(), fields);
  size_bytes_ += fields.size();
}

void SplicedMessage::AppendShared(int field_number, std::shared_ptr<const std::string> content) {
  AppendHeader(field_number, content->size());
  size_bytes_ += content->size();
  parts_.push_back({{}, std::move(content)});
}

void SplicedMessage::AppendField(int field_number, absl::string_view content) {
  AppendHeader(field_number, content.size());
  Append(content);
}

void SplicedMessage::AppendMessage(int field_number, SplicedMessage content) {
  AppendHeader(field_number, content.size_bytes());
  size_bytes_ += content.size_bytes();
  for (Part& part : content.parts_) parts_.push_back(std::move(part));
}

std::string SplicedMessage::Flattened() const {
  std::string bytes;
  bytes.reserve(size_bytes_);
  for (const Part& part : parts_) absl::StrAppend(&bytes, part.bytes());
  return bytes;
}

std::string& SplicedMessage::Own() {
  if (parts_.empty() || parts_.back().shared != nullptr) parts_.emplace_back();
  return parts_.back().own;
}

void SplicedMessage::AppendHeader(int field_number, std::size_t content_bytes) {
  std::array<std::uint8_t, kHeaderBytes_max> header;
  std::uint8_t* end = CodedOutputStream::WriteTagToArray(
      static_cast<std::uint32_t>(field_number) << 3 | kLengthDelimited, header.data());
  end = CodedOutputStream::WriteVarint64ToArray(content_bytes, end);
  Append({reinterpret_cast<const char*>(header.data()),
          static_cast<std::size_t>(end - header.data())});
}

}  // namespace gem::wire
