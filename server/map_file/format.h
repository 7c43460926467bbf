// What a map file consists of: the numbers of MAP_FILE.md that its writer and its reader share.
#pragma once

#include <cstddef>
#include <cstdint>

#include "absl/strings/string_view.h"

namespace gem::map_file {

/// CR LF: a transfer as text would be noticed here.
inline constexpr absl::string_view kMagic = "GEMMAP\r\n";
inline constexpr std::uint32_t kFormatVersion = 1;
/// Magic, format version, zero.
inline constexpr std::size_t kFileHeaderBytes = 16;
/// Type, stored bytes, raw bytes, CRC-32 of these three and of the stored bytes.
inline constexpr std::size_t kSectionHeaderBytes = 16;

/// A section never holds more before it is compressed.
inline constexpr std::size_t kRawBytes_max = std::size_t{4} << 20;
/// What a writer fills: a list goes on in the next section. Only a set of more contributors than
/// fit makes a section longer.
inline constexpr std::size_t kRawBytes_aim = std::size_t{512} << 10;

enum class SectionType : std::uint32_t {
  kMap = 1,
  kSession = 2,
  kOdometry = 3,
  kCorrections = 4,
  kSubmap = 5,
  kSources = 6,
  kCells = 7,
  kLocalMap = 8,
  kLocalCells = 9,
  kEnd = 10,
};
inline constexpr std::uint32_t kNumSectionTypes = 11;  ///< with 0, which is not used

/// "SESSION"; the type must be one of them.
inline absl::string_view NameOf(SectionType type) {
  constexpr absl::string_view kNames[kNumSectionTypes] = {
      "",        "MAP",   "SESSION",   "ODOMETRY",    "CORRECTIONS", "SUBMAP",
      "SOURCES", "CELLS", "LOCAL_MAP", "LOCAL_CELLS", "END"};
  return kNames[static_cast<std::uint32_t>(type)];
}

/// What a submap is to the map.
enum class SubmapRole : std::uint8_t {
  kGrowing = 0,  ///< of a session
  kSeen = 1,     ///< finished
  kHidden = 2,   ///< finished, what retractions hide of it
};

// Bits of SESSION.flags.
inline constexpr std::uint8_t kSessionEnded = 1;
inline constexpr std::uint8_t kSessionRetracted = 2;
inline constexpr std::uint8_t kSessionHasSubmap = 4;
inline constexpr std::uint8_t kSessionHasLocalMap = 8;

/// Bytes that a pose takes in ODOMETRY and CORRECTIONS.
inline constexpr std::size_t kPoseBytes = 64;
/// Bytes that a group of cells and a cell take in CELLS, with a source.
inline constexpr std::size_t kGroupBytes = 40;
inline constexpr std::size_t kCellBytes = 43;
inline constexpr std::size_t kCellBytes_min = 41;  ///< without a source
/// Bytes that a cell takes in LOCAL_CELLS.
inline constexpr std::size_t kLocalCellBytes = 33;

}  // namespace gem::map_file
