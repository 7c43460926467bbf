#include "client/load/growth.h"

#include <algorithm>

namespace gem::load {
namespace {

double MedianOf(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 == 1) return *middle;
  return (*middle + *std::max_element(values.begin(), middle)) / 2;
}

}  // namespace

Growth GrowthOf(const std::vector<double>& samples) {
  if (samples.size() < 2) return {};
  std::vector<double> slopes;
  slopes.reserve(samples.size() * (samples.size() - 1) / 2);
  for (std::size_t i = 0; i < samples.size(); ++i)
    for (std::size_t j = i + 1; j < samples.size(); ++j)
      slopes.push_back((samples[j] - samples[i]) / static_cast<double>(j - i));
  return {MedianOf(samples), *std::max_element(samples.begin(), samples.end()),
          MedianOf(std::move(slopes)) * static_cast<double>(samples.size() - 1)};
}

}  // namespace gem::load
