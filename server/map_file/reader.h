// Reads a file of a map as it comes in, in pieces of any size, and holds one section of it at a
// time. What is wrong is refused with its place in the file. The layout is in MAP_FILE.md.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "server/map_file/assembly.h"
#include "server/map_file/format.h"
#include "server/map_file/limits.h"

namespace gem::map_file {

class Reader {
 public:
  explicit Reader(const Limits& limits) : limits_(limits), assembly_(limits) {}

  /// The next bytes of the file. INVALID_ARGUMENT "data at byte 16, section 0 (MAP): cell_size_m is
  /// -1, want ...", RESOURCE_EXHAUSTED beyond a limit; then nothing more may be fed.
  absl::Status Feed(absl::string_view bytes);

  /// The map, once the file is complete. Only once.
  absl::StatusOr<MapState> Finish();
  /// Bytes of memory that the map, as far as it has been read, leaves of the limit.
  std::uint64_t memory_bytes_left() const { return assembly_.memory_bytes_left(); }

 private:
  struct Header {
    SectionType type{};
    std::uint32_t stored_bytes = 0;
    std::uint32_t raw_bytes = 0;
    std::uint32_t checksum = 0;
    std::string checked;  ///< what of it the checksum covers
  };
  enum class Next : std::uint8_t { kFileHeader, kHeader, kSection, kNothing };

  std::size_t BytesWanted() const;
  absl::Status Take(absl::string_view bytes);
  absl::Status TakeFileHeader(absl::string_view bytes);
  absl::Status TakeHeader(absl::string_view bytes);
  absl::Status TakeSection(absl::string_view stored);
  /// With the place in the file before it.
  absl::Status At(const absl::Status& status) const;

  const Limits limits_;
  Assembly assembly_;
  Next next_ = Next::kFileHeader;
  std::string buffer_;        ///< what does not make up BytesWanted() yet
  std::uint64_t offset_ = 0;  ///< of the first byte of the section, or of what is read next
  std::uint64_t fed_bytes_ = 0;
  std::uint64_t section_ = 0;
  Header header_;
};

}  // namespace gem::map_file
