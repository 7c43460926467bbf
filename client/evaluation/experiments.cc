#include "client/evaluation/calibration.h"
#include "client/evaluation/consistency.h"
#include "client/evaluation/cubes.h"
#include "client/evaluation/dynamics.h"
#include "client/evaluation/experiment.h"
#include "client/evaluation/timing.h"

namespace gem::evaluation {

const std::vector<Experiment>& Experiments() {
  static const auto* const kExperiments = new std::vector<Experiment>{
      {"cubes", "Table I: height and distance errors of six cubes", &RunCubes},
      {"timing", "Table II: time of the local mapper, stage by stage", &RunTiming},
      {"dynamics", "Figs. 10 and 13: what moves is forgotten, what stands is not", &RunDynamics},
      {"consistency", "Fig. 12, 14-16: streets driven twice, with and without deformation",
       &RunConsistency},
      {"calibration", "is the map as sure as it is right? (normalised errors)", &RunCalibration},
  };
  return *kExperiments;
}

}  // namespace gem::evaluation
