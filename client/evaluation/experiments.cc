#include "client/evaluation/consistency.h"
#include "client/evaluation/experiment.h"

namespace gem::evaluation {

const std::vector<Experiment>& Experiments() {
  static const auto* const kExperiments = new std::vector<Experiment>{
      {"consistency", "Fig. 12, 14-16: streets driven twice, with and without deformation",
       RunConsistency},
  };
  return *kExperiments;
}

}  // namespace gem::evaluation
