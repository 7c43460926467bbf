// What SCAN_COMPRESSION_DELTA_ZSTD does to packed points before they are compressed: differences
// between a point and the one before it, zigzag, byte by byte in planes. Lossless on the bytes of
// any layout. Knows no protobuf and no zstd. ENCODINGS.md says it byte by byte.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"

namespace gem::wire {

/// Bytes of a point that are one little-endian number. width: 1, 2 or 4.
struct PointColumn {
  std::uint32_t offset = 0;
  std::uint32_t width = 0;
  friend bool operator==(const PointColumn&, const PointColumn&) = default;
};

/// Every byte of a point in exactly one column, by offset: the fields that share no byte with one
/// before them in the list, and columns of one byte for what they leave. Fields lie in the stride.
std::vector<PointColumn> ColumnsOf(std::span<const PointColumn> fields, std::uint32_t stride);

/// points: whole points of `stride` bytes each. As many bytes as went in.
std::string EncodeDeltas(absl::string_view points, std::uint32_t stride,
                         std::span<const PointColumn> columns);
/// Undoes EncodeDeltas(). Any bytes are points.
std::string DecodeDeltas(absl::string_view planes, std::uint32_t stride,
                         std::span<const PointColumn> columns);

}  // namespace gem::wire
