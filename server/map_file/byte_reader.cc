#include "server/map_file/byte_reader.h"

#include "proto/wire/scalar.h"

namespace gem::map_file {
namespace {

// What was normalised once is that near to 1; it is not normalised again, or its bits would change.
constexpr double kQuaternionNormTolerance = 1e-6;

}  // namespace

std::int64_t ByteReader::Stamp(absl::string_view field) {
  return Within<std::int64_t>(field, 0, wire::kStamp_nsMax);
}

std::vector<std::int64_t> ByteReader::Stamps(absl::string_view field, std::size_t n) {
  return ColumnWithin<std::int64_t>(field, n, 0, wire::kStamp_nsMax);
}

std::string ByteReader::Id(absl::string_view field) {
  const auto size = Number<std::uint8_t>(field);
  if (!Has(field, size, 1)) return {};
  std::string id(bytes_.substr(0, size));
  bytes_.remove_prefix(size);
  const std::string name(field);
  if (const absl::Status valid = wire::CheckId(id, wire::FieldPath(name.c_str())); !valid.ok())
    Fail(valid);
  return id;
}

void ByteReader::CheckTransform(absl::string_view field, const double (&numbers)[7]) {
  const double norm = Eigen::Vector4d(numbers[0], numbers[1], numbers[2], numbers[3]).norm();
  if (!(std::abs(norm - 1) <= kQuaternionNormTolerance))
    Refuse(field, absl::StrCat("a quaternion of norm ", norm), "a norm of 1");
  for (int i = 4; i < 7; ++i)
    if (!(std::abs(numbers[i]) <= kPoseCoordinate_m_max))
      Refuse(field, absl::StrCat("a coordinate of ", numbers[i]),
             absl::StrCat("at most ", kPoseCoordinate_m_max, " in magnitude"));
}

void ByteReader::CheckEnd() {
  if (!bytes_.empty()) Refuse("its end", absl::StrCat(bytes_.size(), " bytes later"), "none");
}

}  // namespace gem::map_file
