// A robot that loads a server: sends the scans of a tape when they are due, within its credit, and
// notes when each was acknowledged as fused. Not a client to learn from: that is IngestClient; this
// one knows neither resuming nor encoding, so that its own work is small beside the server's.
#pragma once

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/client_callback.h>

#include <chrono>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "client/connection.h"
#include "client/load/scan_tape.h"
#include "core/base/mutex.h"

namespace gem::load {

using Clock = std::chrono::steady_clock;

struct RobotReport {
  std::uint64_t num_fused = 0;
  std::uint64_t num_refused = 0;
  std::vector<double> latencies_s;  ///< from when a scan was due to its acknowledgement
};

class RobotLoad final : private grpc::ClientBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer> {
 public:
  /// The tape outlives it. Opens the session at once.
  RobotLoad(const client::Connection& connection, const ScanTape& tape,
            const client::SessionSetup& setup);
  /// Breaks the stream if it has not ended.
  ~RobotLoad() override;

  absl::Status WaitUntilOpened();
  /// The next scan is due now; it is sent as soon as there is credit.
  void Due();
  /// Scans are due all the time until then.
  void FloodUntil(Clock::time_point end);
  /// Until all that was due is acknowledged; then closes the session.
  absl::Status Close();

  std::uint64_t num_done() const;
  RobotReport report() const;

 private:
  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnDone(const grpc::Status& status) override;

  bool HasDueLocked() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void WriteNextLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void NoteAckLocked(std::uint64_t fused_seq, std::uint64_t num_refused, std::uint64_t credit_bytes)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const ScanTape& tape_;
  grpc::GenericStub stub_;
  grpc::ClientContext context_;
  grpc::ByteBuffer received_;  ///< the read in flight owns it
  grpc::ByteBuffer sent_;      ///< the write in flight owns it

  mutable Mutex mutex_;
  CondVar changed_;
  std::deque<Clock::time_point> due_ ABSL_GUARDED_BY(mutex_);         ///< not sent yet
  std::deque<Clock::time_point> on_the_way_ ABSL_GUARDED_BY(mutex_);  ///< when they were due
  Clock::time_point flood_end_ ABSL_GUARDED_BY(mutex_);
  std::uint64_t sent_seq_ ABSL_GUARDED_BY(mutex_) = 0;
  std::uint64_t done_seq_ ABSL_GUARDED_BY(mutex_) = 0;
  std::uint64_t credit_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
  bool opened_ ABSL_GUARDED_BY(mutex_) = false;
  bool writing_ ABSL_GUARDED_BY(mutex_) = true;    ///< the opening message
  bool read_all_ ABSL_GUARDED_BY(mutex_) = false;  ///< nothing may be written any more
  bool closing_ ABSL_GUARDED_BY(mutex_) = false;
  bool close_sent_ ABSL_GUARDED_BY(mutex_) = false;
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(mutex_);
  RobotReport report_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace gem::load
