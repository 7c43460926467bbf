#include "server/map_file/reader.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "proto/wire/refusal.h"
#include "proto/wire/zstd_frame.h"
#include "server/map_file/byte_reader.h"
#include "server/map_file/checksum.h"

namespace gem::map_file {

absl::Status Reader::Feed(absl::string_view bytes) {
  fed_bytes_ += bytes.size();
  if (fed_bytes_ > limits_.file_bytes_max)
    return wire::WithField(
        absl::ResourceExhaustedError(absl::StrCat("data is longer than ", limits_.file_bytes_max,
                                                  " bytes, want at most import_bytes_max")),
        "data");
  while (!bytes.empty()) {
    if (next_ == Next::kNothing)
      return At(absl::InvalidArgumentError(
          absl::StrCat("the end is ", bytes.size(), " bytes later, want none behind END")));
    const std::size_t wanted = BytesWanted();
    if (buffer_.empty() && bytes.size() >= wanted) {
      GEM_RETURN_IF_ERROR(Take(bytes.substr(0, wanted)));
      bytes.remove_prefix(wanted);
      continue;
    }
    const std::size_t taken = std::min(bytes.size(), wanted - buffer_.size());
    buffer_.append(bytes.data(), taken);
    bytes.remove_prefix(taken);
    if (buffer_.size() < wanted) continue;
    const std::string whole = std::exchange(buffer_, {});
    GEM_RETURN_IF_ERROR(Take(whole));
  }
  return absl::OkStatus();
}

absl::StatusOr<MapState> Reader::Finish() {
  if (next_ != Next::kNothing)
    return At(absl::InvalidArgumentError(
        absl::StrCat("the file is cut off after ", fed_bytes_, " bytes, want END")));
  absl::StatusOr<MapState> state = assembly_.Finish();
  if (!state.ok()) return At(state.status());
  return state;
}

std::size_t Reader::BytesWanted() const {
  switch (next_) {
    case Next::kFileHeader:
      return kFileHeaderBytes;
    case Next::kHeader:
      return kSectionHeaderBytes;
    case Next::kSection:
      return header_.stored_bytes;
    case Next::kNothing:
      break;
  }
  return 0;
}

absl::Status Reader::Take(absl::string_view bytes) {
  absl::Status status;
  switch (next_) {
    case Next::kFileHeader:
      status = TakeFileHeader(bytes);
      break;
    case Next::kHeader:
      status = TakeHeader(bytes);
      break;
    case Next::kSection:
      status = TakeSection(bytes);
      break;
    case Next::kNothing:
      break;
  }
  return status.ok() ? status : At(status);
}

absl::Status Reader::TakeFileHeader(absl::string_view bytes) {
  ByteReader reader(bytes.substr(kMagic.size()));
  if (bytes.substr(0, kMagic.size()) != kMagic) reader.Refuse("magic", "something else", "GEMMAP");
  reader.Within("format_version", kFormatVersion, kFormatVersion);
  reader.Within<std::uint32_t>("zero", 0, 0);
  GEM_RETURN_IF_ERROR(reader.status());
  offset_ = kFileHeaderBytes;
  next_ = Next::kHeader;
  return absl::OkStatus();
}

absl::Status Reader::TakeHeader(absl::string_view bytes) {
  ByteReader reader(bytes);
  header_.type =
      static_cast<SectionType>(reader.Within<std::uint32_t>("type", 1, kNumSectionTypes - 1));
  // zstd makes nothing longer by more than a 256th and a little.
  header_.stored_bytes = reader.Within<std::uint32_t>(
      "stored_bytes", 1, static_cast<std::uint32_t>(kRawBytes_max + kRawBytes_max / 128));
  header_.raw_bytes =
      reader.Within<std::uint32_t>("raw_bytes", 1, static_cast<std::uint32_t>(kRawBytes_max));
  header_.checksum = reader.Number<std::uint32_t>("checksum");
  GEM_RETURN_IF_ERROR(reader.status());
  header_.checked = std::string(bytes.substr(0, kSectionHeaderBytes - sizeof(std::uint32_t)));
  next_ = Next::kSection;
  return absl::OkStatus();
}

absl::Status Reader::TakeSection(absl::string_view stored) {
  const std::uint32_t checksum = Checksum(header_.checked, stored);
  if (checksum != header_.checksum)
    return absl::InvalidArgumentError(
        absl::StrCat("checksum is ", header_.checksum, ", want ", checksum));
  const absl::StatusOr<std::string> raw =
      wire::Inflated(stored, header_.raw_bytes, wire::FieldPath("the section"));
  if (!raw.ok()) return raw.status();
  GEM_RETURN_IF_ERROR(assembly_.Take(header_.type, *raw));
  offset_ += kSectionHeaderBytes + stored.size();
  ++section_;
  next_ = header_.type == SectionType::kEnd ? Next::kNothing : Next::kHeader;
  return absl::OkStatus();
}

absl::Status Reader::At(const absl::Status& status) const {
  const std::string name =
      next_ == Next::kSection ? absl::StrCat(" (", NameOf(header_.type), ")") : std::string();
  return wire::WithField(
      absl::Status(status.code(), absl::StrCat("data at byte ", offset_, ", section ", section_,
                                               name, ": ", status.message())),
      "data");
}

}  // namespace gem::map_file
