// The coordinate frames of the system, as tags for Pose and Point. They are never instantiated.
//
//   Global  G  one per map, z up.
//   Odom    O  one per session; smooth, never corrected.
//   Base    B  the robot.
//   Sensor  S  what a scan's points are given in.
//   Submap  K  moves rigidly with one pose of the trajectory. The class Submap is its own tag.
#pragma once

namespace gem {

struct Global;
struct Odom;
struct Base;
struct Sensor;
class Submap;

}  // namespace gem
