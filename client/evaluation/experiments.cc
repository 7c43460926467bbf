#include "client/evaluation/experiment.h"

#include "client/evaluation/cubes.h"
#include "client/evaluation/timing.h"

namespace gem::evaluation {

const std::vector<Experiment>& Experiments() {
  static const auto* const kExperiments = new std::vector<Experiment>{
      {"cubes", "Table I: height and distance errors of six cubes", &RunCubes},
      {"timing", "Table II: time of the local mapper, stage by stage", &RunTiming},
  };
  return *kExperiments;
}

}  // namespace gem::evaluation
