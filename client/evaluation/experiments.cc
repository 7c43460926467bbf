#include "client/evaluation/calibration.h"
#include "client/evaluation/experiment.h"

namespace gem::evaluation {

const std::vector<Experiment>& Experiments() {
  static const auto* const kExperiments = new std::vector<Experiment>{
      {"calibration", "is the map as sure as it is right? (normalised errors)", RunCalibration},
  };
  return *kExperiments;
}

}  // namespace gem::evaluation
