#include "client/evaluation/dynamics.h"

#include "absl/strings/str_format.h"
#include "client/evaluation/crowd.h"
#include "client/evaluation/cyclist.h"
#include "client/evaluation/pedestrian.h"
#include "core/base/status_macros.h"

namespace gem::evaluation {
namespace {

// What the figures mean, to the cell.
constexpr char kMethod[] =
    "The paper shows pictures and no numbers, so none stand beside ours.\n\n"
    "**Cyclist** (Fig. 10). 80 scans of kitti_raw_0001 in a local map of 40x40 m, 0.2 m. His swept "
    "path is 0.5 m to either side of the track of his body, read off the recording. A cell of it "
    "whose centre is on the path is an obstacle if it is not free, and trail if it is more than "
    "0.35 m high, where the ground is 0 to 0.15 m, and does not belong to the bollard that stands "
    "there. The control is the same mapper whose rays must pass 100 standard deviations (1 m or "
    "more) below a cell to clear it.\n\n"
    "**Crowd** (Fig. 10, simulated). 30 people (0.6 m wide, 1.7 m high, 0.8 to 1.6 m/s) walk among "
    "cubes, posts and walls while a robot with a 64-ring LiDAR drives 20 m through them in 20 s; "
    "local map of 16x16 m, true poses, every map after a scan is looked at. A cell is high if it "
    "is more than 0.25 m over the ground. A *walked* cell holds no standing thing within 0.1 m and "
    "was high while a walker was within 0.1 m of it, or after. It is *in sight* if no walker or "
    "thing is on the straight line from the sensor to any of 25 places in it, and 2.5 cells "
    "beyond, at 0.25 m height; it is *revealed* if it was in sight at least once after the last "
    "walker left. It keeps a trail if it was high without a walker when the map last held it. A "
    "*standing* cell is one whose middle a thing covers (the simulator's true height there) and "
    "that has been high; it is lost if it is low or unknown in any later map. A ground cell is one "
    "that neither thing nor walker ever touched and that was known and low; it is lost if it is "
    "high or unknown later. A thing is lost if no cell that it covers is high in a later map that "
    "holds it whole.\n\n"
    "**Pedestrian** (Fig. 13, simulated). A robot drives 60 m past somebody who stands there, and "
    "again 400 s later, when he is gone; the odometry of the second pass is 0.7 m out, 0.5 m of it "
    "in height, until SLAM corrects it and submaps are merged. High cells of the published map, "
    "more than 0.8 m over the ground, are counted within 0.7 m of where he stood, and of a pillar "
    "that stays.";

}  // namespace

absl::StatusOr<Report> RunDynamics(const Settings& settings) {
  Report report{.name = "dynamics", .title = "Figs. 10 and 13: things that move"};
  report.method = kMethod;
  if (settings.scale < 1)
    report.method += absl::StrFormat(" Run at %g of the full size.", settings.scale);
  settings.progress("cyclist", 0);
  GEM_RETURN_IF_ERROR(AddCyclist(settings, report));
  settings.progress("crowd", 0.3);
  GEM_RETURN_IF_ERROR(AddCrowd(settings, report));
  settings.progress("pedestrian", 0.9);
  GEM_RETURN_IF_ERROR(AddPedestrian(settings, report));
  return report;
}

}  // namespace gem::evaluation
