#include "proto/wire/scan_codec.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstring>

#include "proto/wire/zigzag.h"

namespace gem::wire {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they lie");

/// One column of every point, from `at` on, to its planes.
template <typename T>
void EncodeColumn(const char* at, std::uint32_t stride, std::size_t num_points, char* planes) {
  T before = 0;
  for (std::size_t i = 0; i < num_points; ++i, at += stride) {
    T value;
    std::memcpy(&value, at, sizeof(T));
    const T code = Zigzag<T>(static_cast<T>(value - before));
    before = value;
    for (std::size_t byte = 0; byte < sizeof(T); ++byte)
      planes[byte * num_points + i] = static_cast<char>(code >> (8 * byte));
  }
}

template <typename T>
void DecodeColumn(const char* planes, std::uint32_t stride, std::size_t num_points, char* at) {
  T value = 0;
  for (std::size_t i = 0; i < num_points; ++i, at += stride) {
    T code = 0;
    for (std::size_t byte = 0; byte < sizeof(T); ++byte)
      code = static_cast<T>(code | T{static_cast<std::uint8_t>(planes[byte * num_points + i])}
                                       << (8 * byte));
    value = static_cast<T>(value + Unzigzag<T>(code));
    std::memcpy(at, &value, sizeof(T));
  }
}

}  // namespace

std::vector<PointColumn> ColumnsOf(std::span<const PointColumn> fields, std::uint32_t stride) {
  std::vector<bool> taken(stride);
  std::vector<PointColumn> columns;
  for (const PointColumn& field : fields) {
    const auto begin = taken.begin() + field.offset;
    const auto end = begin + field.width;
    if (std::find(begin, end, true) != end) continue;
    std::fill(begin, end, true);
    columns.push_back(field);
  }
  for (std::uint32_t offset = 0; offset < stride; ++offset)
    if (!taken[offset]) columns.push_back({offset, 1});
  std::sort(columns.begin(), columns.end(),
            [](const PointColumn& a, const PointColumn& b) { return a.offset < b.offset; });
  return columns;
}

std::string EncodeDeltas(absl::string_view points, std::uint32_t stride,
                         std::span<const PointColumn> columns) {
  const std::size_t num_points = points.size() / stride;
  std::string planes(points.size(), '\0');
  for (const PointColumn& column : columns) {
    const char* from = points.data() + column.offset;
    char* to = planes.data() + column.offset * num_points;
    if (column.width == 1) EncodeColumn<std::uint8_t>(from, stride, num_points, to);
    if (column.width == 2) EncodeColumn<std::uint16_t>(from, stride, num_points, to);
    if (column.width == 4) EncodeColumn<std::uint32_t>(from, stride, num_points, to);
  }
  return planes;
}

std::string DecodeDeltas(absl::string_view planes, std::uint32_t stride,
                         std::span<const PointColumn> columns) {
  const std::size_t num_points = planes.size() / stride;
  std::string points(planes.size(), '\0');
  for (const PointColumn& column : columns) {
    const char* from = planes.data() + column.offset * num_points;
    char* to = points.data() + column.offset;
    if (column.width == 1) DecodeColumn<std::uint8_t>(from, stride, num_points, to);
    if (column.width == 2) DecodeColumn<std::uint16_t>(from, stride, num_points, to);
    if (column.width == 4) DecodeColumn<std::uint32_t>(from, stride, num_points, to);
  }
  return points;
}

}  // namespace gem::wire
