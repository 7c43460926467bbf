// Whether something that is sampled grows: robust against bursts and against single samples.
#pragma once

#include <vector>

namespace gem::load {

struct Growth {
  double median = 0;
  double max = 0;
  /// Median slope of all pairs of samples (Theil and Sen) times the time that was sampled: what
  /// came on top. Bursts shorter than a third of it change nothing.
  double growth = 0;
};

/// Samples at equal distances in time. Zero of fewer than two.
Growth GrowthOf(const std::vector<double>& samples);

}  // namespace gem::load
