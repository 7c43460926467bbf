// One stream to a reader: writes what its source says, one message at a time. The source works on
// the workers' threads; gRPC's threads only pass word on.
#pragma once

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/server_callback.h>

#include <chrono>
#include <memory>
#include <optional>

#include "absl/status/status.h"
#include "core/base/mutex.h"
#include "server/message_source.h"
#include "server/metrics.h"
#include "server/turn_scheduler.h"

namespace gem {

class ReaderStream final : public grpc::ServerWriteReactor<grpc::ByteBuffer>,
                           public TurnTaker,
                           public std::enable_shared_from_this<ReaderStream> {
 public:
  ReaderStream(TurnScheduler& scheduler, MethodMetrics& metrics)
      : scheduler_(scheduler), metrics_(metrics) {}

  /// Keeps itself alive from here until OnDone(). Wakes up with news of `news`.
  void Start(std::size_t request_bytes, std::unique_ptr<MessageSource> source, NewsSource news);
  /// Instead of Start(): the request is refused.
  void Refuse(std::size_t request_bytes, const absl::Status& status);

  // TurnTaker, on a worker.
  std::optional<Clock::time_point> TakeTurn(Clock::time_point now) override;
  void OnStop() override;
  std::optional<Clock::time_point> behind_since() const override;

  // grpc::ServerWriteReactor, on gRPC's threads.
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

 private:
  void Begin(std::size_t request_bytes);
  void EndLocked(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Finishes if it is to end and nothing is being written.
  void FinishIfDueLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Constant from Start() on.
  TurnScheduler& scheduler_;
  MethodMetrics& metrics_;
  const Clock::time_point start_ = Clock::now();
  std::unique_ptr<MessageSource> source_;  ///< worked by the turns; null if refused

  std::shared_ptr<ReaderStream> self_;  ///< from Start() to OnDone()

  Mutex mutex_;
  grpc::ByteBuffer message_ ABSL_GUARDED_BY(mutex_);         ///< the write in flight owns it
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(mutex_);  ///< finish with this
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace gem
