#include "client/evaluation/any_slam.h"
#include "client/evaluation/calibration.h"
#include "client/evaluation/consistency.h"
#include "client/evaluation/constant_time.h"
#include "client/evaluation/cubes.h"
#include "client/evaluation/dynamics.h"
#include "client/evaluation/experiment.h"
#include "client/evaluation/memory.h"
#include "client/evaluation/timing.h"

namespace gem::evaluation {

const std::vector<Experiment>& Experiments() {
  static const auto* const kExperiments = new std::vector<Experiment>{
      {"cubes", "Table I: height and distance errors of six cubes", &RunCubes},
      {"timing", "Table II: time of the local mapper, stage by stage", &RunTiming},
      {"constant_time", "Fig. 6-8: time a scan and a correction over a long drive",
       &RunConstantTime},
      {"dynamics", "Figs. 10 and 13: what moves is forgotten, what stands is not", &RunDynamics},
      {"consistency", "Fig. 12, 14-16: streets driven twice, with and without deformation",
       &RunConsistency},
      {"memory", "Fig. 17, 18: stored points over a drive that comes back", &RunMemory},
      {"any_slam", "one server, unchanged, under three SLAM systems", &RunAnySlam},
      {"calibration", "is the map as sure as it is right? (normalised errors)", &RunCalibration},
  };
  return *kExperiments;
}

}  // namespace gem::evaluation
