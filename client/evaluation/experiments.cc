#include "client/evaluation/consistency.h"
#include "client/evaluation/constant_time.h"
#include "client/evaluation/experiment.h"
#include "client/evaluation/memory.h"

namespace gem::evaluation {

const std::vector<Experiment>& Experiments() {
  static const auto* const kExperiments = new std::vector<Experiment>{
      {"constant_time", "Fig. 6-8: time a scan and a correction over a long drive",
       RunConstantTime},
      {"consistency", "Fig. 12, 14-16: streets driven twice, with and without deformation",
       RunConsistency},
      {"memory", "Fig. 17, 18: stored points over a drive that comes back", RunMemory},
  };
  return *kExperiments;
}

}  // namespace gem::evaluation
