// What readers of a map compare.
#pragma once

#include <cstdint>

namespace gem {

/// Compare within one epoch only: another epoch means that the map's history was lost or replaced.
struct MapVersion {
  std::uint64_t epoch = 0;
  std::uint64_t revision = 0;
  friend bool operator==(const MapVersion&, const MapVersion&) = default;
};

}  // namespace gem
