// The random numbers of the simulator: the same on every machine and with every standard library,
// which std::normal_distribution is not. Not for anything that must be hard to guess.
#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>

namespace gem {

/// SplitMix64 (Steele, Lea, Flood 2014). Streams of one seed are independent of each other, so that
/// scan 17 is the same whether or not scan 16 was made.
class Random {
 public:
  Random(std::uint64_t seed, std::uint64_t stream) : state_(seed) {
    state_ = Bits() ^ (stream * 0xD1342543DE82EF95u);
    state_ = Bits();
  }

  std::uint64_t Bits() {
    std::uint64_t z = (state_ += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
  }

  /// [0, 1).
  double Uniform() { return static_cast<double>(Bits() >> 11) * 0x1p-53; }

  /// Mean 0, sigma 1 (Box-Muller).
  double Gaussian() {
    if (has_spare_) {
      has_spare_ = false;
      return spare_;
    }
    // 1 - Uniform() is never zero, whose logarithm would be infinite.
    const double radius = std::sqrt(-2.0 * std::log(1.0 - Uniform()));
    const double angle_rad = 2.0 * std::numbers::pi * Uniform();
    spare_ = radius * std::sin(angle_rad);
    has_spare_ = true;
    return radius * std::cos(angle_rad);
  }

 private:
  std::uint64_t state_;
  double spare_ = 0;
  bool has_spare_ = false;
};

}  // namespace gem
