// A simulated world: ground, solids that stand and walkers that move, in G. Answers what a ray hits
// and how high the world truly is; knows nothing of sensors and robots.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "client/simulation/height_field.h"
#include "client/simulation/solid.h"

namespace gem {

enum class HitKind { kGround, kBox, kCylinder, kWalker };

struct Hit {
  double range_m = 0;
  HitKind kind = HitKind::kGround;
  std::size_t index = 0;  ///< in boxes(), cylinders() or walkers(); 0 for the ground
};

/// Filled once, then immutable and free to be shared by threads.
class World {
 public:
  explicit World(std::unique_ptr<const HeightField> ground) : ground_(std::move(ground)) {}

  void Add(const Box& box) { boxes_.push_back(box); }
  void Add(const Cylinder& cylinder) { cylinders_.push_back(cylinder); }
  void Add(Walker walker) { walkers_.push_back(std::move(walker)); }

  const HeightField& ground() const { return *ground_; }
  const std::vector<Box>& boxes() const { return boxes_; }
  const std::vector<Cylinder>& cylinders() const { return cylinders_; }
  const std::vector<Walker>& walkers() const { return walkers_; }

  /// Top of the highest standing solid over the place, or the ground; walkers do not count. What an
  /// elevation map should say.
  std::optional<double> TrueHeightAt(double x_m, double y_m) const;

  /// The walker's body at a time. He stands at z = 0 where there is no ground.
  Cylinder WalkerAt(std::size_t walker, double time_s) const;

  /// First thing that the ray hits, asking every solid: slow, and the oracle of RayCaster.
  std::optional<Hit> Cast(const Ray& ray, double range_m_max, double time_s) const;

 private:
  std::unique_ptr<const HeightField> ground_;
  std::vector<Box> boxes_;
  std::vector<Cylinder> cylinders_;
  std::vector<Walker> walkers_;
};

}  // namespace gem
