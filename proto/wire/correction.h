// gem.v1.CorrectTrajectoryRequest <-> the corrected trajectory of one session.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "core/global/correction.h"

namespace gem::v1 {
class CorrectTrajectoryRequest;
}  // namespace gem::v1

namespace gem::wire {

inline constexpr int kPosesOfCorrection_max = 1'000'000;

struct CorrectionRequest {
  std::string map;
  std::string session;
  std::string request_id;  ///< may be empty
  CorrectedTrajectory poses;
};

/// 1 to poses_max poses with strictly increasing stamps.
absl::StatusOr<CorrectionRequest> FromProto(const v1::CorrectTrajectoryRequest& proto,
                                            int poses_max = kPosesOfCorrection_max);
void ToProto(const CorrectionRequest& request, v1::CorrectTrajectoryRequest* proto);

}  // namespace gem::wire
