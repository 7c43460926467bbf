#include "client/evaluation/experiment.h"

namespace gem::evaluation {

const std::vector<Experiment>& Experiments() {
  static const auto* const kExperiments = new std::vector<Experiment>{};
  return *kExperiments;
}

}  // namespace gem::evaluation
