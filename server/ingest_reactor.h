// One Ingest stream: turns messages into mailbox entries and progress into answers. Never blocks
// and never works; one read and one write are outstanding at most.
#pragma once

#include <grpcpp/support/server_callback.h>

#include <chrono>
#include <memory>
#include <optional>

#include "absl/container/flat_hash_set.h"
#include "absl/status/status.h"
#include "core/base/mutex.h"
#include "gem/v1/ingest_service.pb.h"
#include "server/ingest_message.h"
#include "server/metrics.h"
#include "server/options.h"
#include "server/registry.h"

namespace gem {

class IngestReactor;

/// The streams that are open, so that they can be told when the server goes away.
class IngestStreams {
 public:
  /// False: the server is going away.
  bool Add(const std::shared_ptr<IngestReactor>& stream);
  void Remove(const std::shared_ptr<IngestReactor>& stream);
  /// Ends all streams; none can be added any more.
  void DrainAll();

 private:
  Mutex mutex_;
  absl::flat_hash_set<std::shared_ptr<IngestReactor>> streams_ ABSL_GUARDED_BY(mutex_);
  bool draining_ ABSL_GUARDED_BY(mutex_) = false;
};

class IngestReactor final : public grpc::ServerBidiReactor<v1::IngestRequest, v1::IngestResponse>,
                            public IngestSink,
                            public std::enable_shared_from_this<IngestReactor> {
 public:
  IngestReactor(Registry& registry, const ServerOptions& options, MethodMetrics& metrics,
                IngestStreams& streams)
      : registry_(registry), options_(options), metrics_(metrics), streams_(streams) {}

  /// Keeps itself alive from here until OnDone().
  void Start();
  /// Says goodbye and ends with UNAVAILABLE.
  void Drain();

  // grpc::ServerBidiReactor, on gRPC's threads.
  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

  // IngestSink, on the session's and the map's threads.
  void OnProgress() override;
  void OnEnded(const absl::StatusOr<SessionEnd>& end) override;
  void OnTakenOver() override;

 private:
  // These return the stream that was taken over, if any.
  absl::StatusOr<std::shared_ptr<IngestSink>> Open(const v1::OpenSession& open);
  absl::StatusOr<std::shared_ptr<IngestSink>> OpenSession(const wire::SessionSetup& setup,
                                                          IngestOpening opening);
  /// For a robot that comes back to hear the answer to its close; `refused` if there is none.
  absl::StatusOr<std::shared_ptr<IngestSink>> AwaitEnd(const wire::SessionSetup& setup,
                                                       IngestOpening opening,
                                                       const absl::Status& refused);
  void TakeMessageLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void EnqueueLocked(IngestMessage message) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void ReadOnLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void EndLocked(const absl::Status& status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Writes what is next, or finishes if nothing is left to say.
  void AdvanceLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  bool NextResponseLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Constant after construction.
  Registry& registry_;
  const ServerOptions& options_;
  MethodMetrics& metrics_;
  IngestStreams& streams_;
  const Clock::time_point start_ = Clock::now();

  std::shared_ptr<IngestReactor> self_;  ///< from Start() to OnDone()
  v1::IngestRequest request_;            ///< the read in flight owns it, then OnReadDone()

  Mutex mutex_;
  v1::IngestResponse response_ ABSL_GUARDED_BY(mutex_);  ///< the write in flight owns it
  std::shared_ptr<SessionActor> session_ ABSL_GUARDED_BY(mutex_);
  std::optional<v1::SessionOpened> opened_ ABSL_GUARDED_BY(mutex_);  ///< still to be said
  std::optional<v1::SessionClosed> closed_ ABSL_GUARDED_BY(mutex_);  ///< still to be said
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(mutex_);          ///< finish with this
  bool drain_ ABSL_GUARDED_BY(mutex_) = false;                       ///< still to be said
  bool reading_ ABSL_GUARDED_BY(mutex_) = false;
  bool half_closed_ ABSL_GUARDED_BY(mutex_) = false;
  bool closing_ ABSL_GUARDED_BY(mutex_) = false;  ///< nothing is read any more
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool cancelled_ ABSL_GUARDED_BY(mutex_) = false;
  bool finished_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace gem
