// The true heights of a town's road: of places so near to the way that nothing but ground lies
// there. What maps of the town are held against.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "client/evaluation/town_drive.h"

namespace gem::evaluation {

class RoadTruth {
 public:
  /// The town must outlive it.
  explicit RoadTruth(const TownDrive& town);

  /// Metres over z = 0 of G; nothing farther than 2 m from the way.
  std::optional<double> operator()(double x_m, double y_m) const;

 private:
  const TownDrive& town_;
  absl::flat_hash_map<std::uint64_t, std::vector<Eigen::Vector2d>> places_;  ///< by square
};

}  // namespace gem::evaluation
