// Reads the contents of a section. The first thing that is wrong stays: later values are zero, so
// that whoever reads asks once, before it acts on what it has read. Nothing is allocated for values
// that are not there.
#pragma once

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"
#include "core/geometry/pose.h"
#include "server/map_file/byte_writer.h"

namespace gem::map_file {

/// Stamps as robots may send them, coordinates as poses of corrected robots may have them.
inline constexpr double kPoseCoordinate_m_max = 4e6;

class ByteReader {
 public:
  explicit ByteReader(absl::string_view bytes) : bytes_(bytes) {}

  /// INVALID_ARGUMENT "field is value, want limit".
  const absl::Status& status() const { return status_; }
  bool ok() const { return status_.ok(); }
  std::size_t remaining() const { return bytes_.size(); }

  /// Unless something was wrong before.
  void Refuse(absl::string_view field, absl::string_view value, absl::string_view want) {
    if (ok())
      status_ = absl::InvalidArgumentError(absl::StrCat(field, " is ", value, ", want ", want));
  }

  /// The same with a status that has its text already.
  void Fail(const absl::Status& status) {
    if (ok()) status_ = absl::InvalidArgumentError(status.message());
  }

  template <typename T>
  T Number(absl::string_view field) {
    if (!Has(field, 1, sizeof(T))) return T{};
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i) bits |= Byte(i) << (8 * i);
    bytes_.remove_prefix(sizeof(T));
    return std::bit_cast<T>(static_cast<BitsOf<T>>(bits));
  }
  /// A whole number in [min, max].
  template <typename T>
  T Within(absl::string_view field, T min, T max) {
    const T value = Number<T>(field);
    if (value >= min && value <= max) return value;
    // Unary plus: a byte is a number here.
    Refuse(field, absl::StrCat(+value), absl::StrCat(+min, " to ", +max));
    return min;
  }
  bool Flag(absl::string_view field) { return Within<std::uint8_t>(field, 0, 1) != 0; }
  std::int64_t Stamp(absl::string_view field);
  /// An id as requests have them.
  std::string Id(absl::string_view field);

  template <typename A, typename B>
  Pose<A, B> Transform(absl::string_view field) {
    double numbers[7];
    for (double& number : numbers) number = Number<double>(field);
    CheckTransform(field, numbers);
    return {Eigen::Quaterniond(numbers[3], numbers[0], numbers[1], numbers[2]),
            Eigen::Vector3d(numbers[4], numbers[5], numbers[6])};
  }

  /// n numbers in byte planes; as many as there are asked for, unless something is wrong.
  template <typename T>
  std::vector<T> Column(absl::string_view field, std::size_t n) {
    std::vector<T> values;
    if (!Has(field, n, sizeof(T))) return values;
    values.reserve(n);
    for (std::size_t i = 0; i < n; ++i) {
      std::uint64_t bits = 0;
      for (std::size_t plane = 0; plane < sizeof(T); ++plane)
        bits |= Byte(plane * n + i) << (8 * plane);
      values.push_back(std::bit_cast<T>(static_cast<BitsOf<T>>(bits)));
    }
    bytes_.remove_prefix(n * sizeof(T));
    return values;
  }
  /// The same, each in [min, max], which no NaN is.
  template <typename T>
  std::vector<T> ColumnWithin(absl::string_view field, std::size_t n, T min, T max) {
    std::vector<T> values = Column<T>(field, n);
    for (std::size_t i = 0; i < values.size(); ++i)
      if (!(values[i] >= min && values[i] <= max))
        Refuse(absl::StrCat(field, "[", i, "]"), absl::StrCat(+values[i]),
               absl::StrCat(+min, " to ", +max));
    return values;
  }
  std::vector<std::int64_t> Stamps(absl::string_view field, std::size_t n);

  /// Seven numbers: x, y, z, w of a unit quaternion, then a translation.
  void CheckTransform(absl::string_view field, const double (&numbers)[7]);
  /// Everything must have been read.
  void CheckEnd();

 private:
  std::uint64_t Byte(std::size_t at) const { return static_cast<unsigned char>(bytes_[at]); }
  bool Has(absl::string_view field, std::size_t n, std::size_t width) {
    if (ok() && n > bytes_.size() / width)
      Refuse(field, absl::StrCat("cut off after ", bytes_.size(), " bytes"),
             absl::StrCat(n, " times ", width));
    return ok();
  }

  absl::string_view bytes_;
  absl::Status status_;
};

}  // namespace gem::map_file
