#include "client/evaluation/experiment.h"

#include "client/evaluation/cubes.h"

namespace gem::evaluation {

const std::vector<Experiment>& Experiments() {
  static const auto* const kExperiments = new std::vector<Experiment>{
      {"cubes", "Table I: height and distance errors of six cubes", &RunCubes},
  };
  return *kExperiments;
}

}  // namespace gem::evaluation
