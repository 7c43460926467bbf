// Motion compensation: a sensor that moves while it sweeps measures every point from another place.
// Given the way it went, all points are carried to where it was at the scan's stamp.
#pragma once

#include <cstdint>
#include <span>

#include "core/geometry/pose.h"
#include "core/geometry/trajectory.h"
#include "core/sensor/scan.h"

namespace gem {

/// Points are measured at most so long before or after the stamp of their scan, seconds.
inline constexpr float kTimeOffsetMax_s = 1;

/// From the first to the last moment that a scan speaks of, its stamp included; nanoseconds.
struct TimeSpan {
  std::int64_t begin_ns = 0;
  std::int64_t end_ns = 0;
};

/// offsets_s: of the points, relative to stamp_ns; at most kTimeOffsetMax_s in magnitude. Up to a
/// microsecond short, so that the rounding of 0.1 s to float32 does not ask for a pose after 0.1 s.
TimeSpan SpanOf(std::int64_t stamp_ns, std::span<const float> offsets_s);

/// True if the trajectory says where the base was at every moment of the span.
bool Covers(const Trajectory<Odom, Base>& trajectory, const TimeSpan& span);

/// p_S(stamp) = T_S(stamp)_O * T_O_S(stamp + offset) * p_S(stamp + offset), for each point, in
/// place. Only the relative motion counts: a trajectory that is rigidly off does no harm. The
/// transform is worked out every millisecond and blended linearly in between: a sensor that turns
/// at w rad/s is off by (w * 1 ms)^2 / 8 of the range, 1e-5 of it at 9 rad/s. One offset a point;
/// Covers(trajectory, SpanOf(stamp_ns, offsets_s)).
void Deskew(const Trajectory<Odom, Base>& trajectory, std::int64_t stamp_ns,
            const Pose<Base, Sensor>& T_B_S, std::span<const float> offsets_s,
            std::span<ScanPoint> points);

}  // namespace gem
