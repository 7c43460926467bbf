// gem.v1.Position and gem.v1.Region <-> core/grid/region.h.
#pragma once

#include "absl/status/statusor.h"
#include "core/grid/region.h"
#include "proto/wire/field_path.h"

namespace gem::v1 {
class Position;
class Region;
}  // namespace gem::v1

namespace gem::wire {

/// Refuses what is not finite or farther out than magnitude_m_max.
absl::StatusOr<Place> FromProto(const v1::Position& proto, const FieldPath& field,
                                double magnitude_m_max = kCoordinateMax_m);
void ToProto(const Place& place, v1::Position* proto);

/// Refuses what is not finite, farther out than kCoordinateMax_m, or empty.
absl::StatusOr<Region> FromProto(const v1::Region& proto, const FieldPath& field);
void ToProto(const Region& region, v1::Region* proto);

}  // namespace gem::wire
