// What passes between a robot's stream and its session: scans and poses in, progress out. Neither
// side sees the other's class.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "core/grid/map_version.h"
#include "proto/wire/refusal.h"

namespace gem::v1 {
class PoseBatch;
class Scan;
}  // namespace gem::v1

namespace gem {

using Clock = std::chrono::steady_clock;

/// One of the two pointers is set, until the session's thread has decoded and judged the message.
struct IngestMessage {
  std::shared_ptr<const v1::Scan> scan;
  std::shared_ptr<const v1::PoseBatch> poses;
  std::uint64_t seq = 0;           ///< of the scan
  std::uint64_t credit_bytes = 0;  ///< wire::PayloadBytes of the scan
  std::uint64_t size_bytes = 0;    ///< what the message occupies while it waits
  Clock::time_point arrived;
};

/// A message that was refused. seq is 0 for poses.
struct IngestProblem {
  std::uint64_t seq = 0;
  wire::ProblemReason reason = wire::ProblemReason::kMalformed;
  std::string text;
  std::uint64_t expected_seq = 0;  ///< what seq should have been, if that is the problem
};

/// Which opening of a session a stream is, and what it wants. One of the same process that was made
/// earlier, but comes later, has no say.
struct IngestOpening {
  std::uint64_t opener = 0;  ///< the process; 0: not said
  std::uint32_t attempt = 0;
  bool drop_oldest = false;  ///< scans, when they come faster than they are fused
};

/// What a stream has to tell its robot since it last did.
struct IngestProgress {
  bool news = false;
  std::uint64_t accepted_seq = 0;
  std::uint64_t fused_seq = 0;
  std::uint64_t credit_bytes = 0;
  std::vector<IngestProblem> problems;
  std::uint64_t problems_left_out = 0;
};

/// How a session ended.
struct SessionEnd {
  MapVersion version;
  std::uint64_t num_scans_fused = 0;
  std::uint64_t num_scans_refused = 0;
  std::uint64_t num_scans_not_deskewed = 0;
  std::uint64_t num_scans_dropped = 0;
};

/// The stream, as its session sees it. Called from the session's and the map's threads; must not
/// block. A sink whose call is over ignores what it is told.
class IngestSink {
 public:
  virtual ~IngestSink() = default;
  /// There is progress to take, or room in the queue again.
  virtual void OnProgress() = 0;
  /// The session has ended and everything it sent is published, or will never be.
  virtual void OnEnded(const absl::StatusOr<SessionEnd>& end) = 0;
  /// Another stream has resumed the session.
  virtual void OnTakenOver() = 0;
};

}  // namespace gem
