// gem.v1.TerrainService: questions about the ground and their answers <-> core/grid/terrain.h.
#pragma once

#include <vector>

#include "absl/status/statusor.h"
#include "core/grid/terrain.h"

namespace gem::v1 {
class CheckPathRequest;
class CheckPathResponse;
class SampleHeightsRequest;
class SampleHeightsResponse;
}  // namespace gem::v1

namespace gem::wire {

/// 1 to kGroundPoints_max points, finite and within 1e6 m.
absl::StatusOr<std::vector<Place>> PointsFromProto(const v1::SampleHeightsRequest& proto);
void ToProto(const std::vector<Place>& points, v1::SampleHeightsRequest* proto);

void ToProto(const std::vector<GroundSample>& samples, v1::SampleHeightsResponse* proto);
/// Refuses another number than num_points, states that are not known, and values that are not
/// finite.
absl::StatusOr<std::vector<GroundSample>> FromProto(const v1::SampleHeightsResponse& proto,
                                                    std::size_t num_points);

/// 1 to kPathCorners_max corners, finite and within 1e6 m, at most kPathLengthMax_m in all; a
/// footprint of at most kFootprintMax_m; a step that is not negative. How many samples and cells
/// that makes is judged where the cell size is known.
absl::StatusOr<PathQuestion> FromProto(const v1::CheckPathRequest& proto);
void ToProto(const PathQuestion& question, v1::CheckPathRequest* proto);

void ToProto(const PathCheck& check, v1::CheckPathResponse* proto);
/// Refuses an answer without samples or with more than kPathSamples_max, states that are not known,
/// values that are not finite, and an index beyond the samples.
absl::StatusOr<PathCheck> FromProto(const v1::CheckPathResponse& proto);

}  // namespace gem::wire
