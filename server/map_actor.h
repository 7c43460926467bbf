// Owns the global mapper of one map and the one thread that runs it. Sessions and corrections leave
// word in its mailbox; readers take the published snapshot and hold no lock of the mapper.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "absl/container/btree_map.h"
#include "absl/container/btree_set.h"
#include "absl/container/flat_hash_map.h"
#include "absl/status/status.h"
#include "core/base/cancel_token.h"
#include "core/base/mutex.h"
#include "core/global/global_mapper.h"
#include "server/map_history.h"
#include "server/map_mailbox.h"
#include "server/metrics.h"
#include "server/request_book.h"

namespace gem {

struct MapActorOptions {
  double publish_hz = 2;
  int sessions_max = 10'000;
  int finished_submaps_waiting_max = 64;
  int corrections_waiting_max = 1000;  ///< and as many retractions
  int request_ids_max = 1000;
  int commit_restarts_max = 8;
  HistoryOptions history = {};
};

class MapActor {
 public:
  /// An empty map. options are valid.
  MapActor(std::string id, const GlobalMapOptions& options, std::uint64_t epoch,
           const MapActorOptions& limits, Metrics& metrics);
  /// A map that exists: nothing was told since its last Commit.
  MapActor(std::string id, std::unique_ptr<GlobalMapper> mapper, const MapActorOptions& limits,
           Metrics& metrics);
  ~MapActor();
  MapActor(const MapActor&) = delete;
  MapActor& operator=(const MapActor&) = delete;

  const std::string& id() const { return id_; }
  const GlobalMapOptions& options() const { return options_; }
  std::uint64_t epoch() const { return epoch_; }

  /// ALREADY_EXISTS if the id is taken, RESOURCE_EXHAUSTED at the limit.
  absl::Status AddSession(const std::string& session, const std::string& robot,
                          const Pose<Global, Odom>& T_G_O);

  /// Live data of a session that was added. Published at the publish rate; at once when the session
  /// ends. Blocks while too many finished submaps of the session wait. `published` may be null.
  void Update(const std::string& session, SessionUpdate update, PublishedCallback published);

  /// Replaces the session's correction and stops a rendering in hand. `done` gets the version that
  /// shows it, or NOT_FOUND, OUT_OF_RANGE, RESOURCE_EXHAUSTED, UNAVAILABLE.
  void Correct(const std::string& session, const std::string& request_id,
               CorrectedTrajectory correction, CorrectionCallback done);

  /// Hides what a session contributed, or shows it again: one revision. `done` gets the version
  /// that shows it, or NOT_FOUND, RESOURCE_EXHAUSTED, UNAVAILABLE.
  void Retract(const std::string& session, const std::string& request_id, bool restore,
               RetractionCallback done);

  /// What the next revision that is published is made of, everything that was told before this call
  /// included. `done` gets it, or NOT_FOUND, UNAVAILABLE. The caller limits how many wait.
  void TakeState(StateCallback done);

  /// The newest. Never null.
  std::shared_ptr<const MapSnapshot> snapshot() const { return history_->newest(); }
  /// What was published lately. Outlives the map for those who hold it.
  const std::shared_ptr<MapHistory>& history() const { return history_; }
  /// How far the published map is behind.
  struct Lag {
    Clock::time_point published;  ///< when the newest revision was
    /// Arrival of the oldest word of a session or a correction that no revision shows.
    std::optional<Clock::time_point> oldest_waiting;
    std::optional<Clock::time_point> oldest_correction;  ///< of those without an answer
    int num_corrections = 0;                             ///< without an answer
  };
  Lag lag() const;

  /// A session as it was added; what the map shows of it is in the snapshot.
  struct NewSession {
    std::string session;
    std::string robot;
    Pose<Global, Odom> T_G_O;
  };
  struct SessionPage {
    std::size_t first = 0;             ///< how many arrived before these
    std::vector<NewSession> sessions;  ///< in order of arrival
    bool is_last = false;
  };
  /// Up to `count` of the sessions that ever fed the map, those that arrived after the session
  /// `after`; empty: from the first one. Nothing if there is no such session.
  std::optional<SessionPage> SessionsAfter(const std::string& after, std::size_t count) const;
  /// Up to `count` of the sessions that arrived last.
  SessionPage NewestSessions(std::size_t count) const;

  /// OK while the map lives. UNAVAILABLE: the server goes away; NOT_FOUND: the map was deleted. All
  /// who wait are told so.
  absl::Status status() const;
  /// Ends the thread: the server goes away.
  void Stop();
  /// Ends the thread: the map is gone for good. What it held is freed, and who still has the map
  /// sees a last revision in which it is empty.
  void Delete();
  /// Waits for the thread after Stop() or Delete(). One caller only.
  void Join();

 private:
  /// Everything that waited when the thread looked.
  struct Batch {
    std::vector<NewSession> added;
    absl::btree_map<std::string, PendingSession> sessions;
    std::vector<RetractionWaiter> retractions;  ///< in order of arrival
    std::vector<StateCallback> states;
  };
  /// Applied to the mapper, but not published yet.
  struct Unpublished {
    std::vector<PublishedCallback> published;
    std::vector<std::pair<CorrectionWaiter, CorrectionCounts>> corrected;
    std::vector<std::pair<RetractionWaiter, RetractionCounts>> retracted;
    std::vector<StateCallback> states;
  };

  void Run();
  void End(const absl::Status& why);
  /// An answer that can be given at once: an earlier one, or why there will be none. Nothing: the
  /// request is to be taken.
  template <typename Result>
  std::optional<absl::StatusOr<Result>> AnswerAtOnceLocked(const RequestBook<Result>& book,
                                                           const char* what,
                                                           const std::string& session,
                                                           const std::string& request_id) const
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void NoteNewsLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  enum class Waited { kWork, kHistory, kStopped };
  /// Waits until there is work, or until `expiry`, when the history has something to forget.
  Waited WaitForWork(Batch& batch, std::optional<Clock::time_point> expiry);
  void Apply(Batch& batch);
  void Publish(std::shared_ptr<const MapSnapshot> snapshot, const CommitReport& report);
  /// These answer a waiter and everybody who repeated its request.
  void Answer(const CorrectionWaiter& waiter, const absl::StatusOr<CorrectionAnswer>& answer);
  void Answer(const RetractionWaiter& waiter, const absl::StatusOr<RetractionAnswer>& answer);
  void AbandonAll();
  /// Frees what a deleted map held.
  void Free();

  // Constant after construction.
  const std::string id_;
  const GlobalMapOptions options_;
  const std::uint64_t epoch_;
  const MapActorOptions limits_;
  Metrics& metrics_;

  // The thread's own.
  std::unique_ptr<GlobalMapper> mapper_;
  Unpublished unpublished_;
  Clock::time_point last_commit_;
  int restarts_ = 0;

  const std::shared_ptr<MapHistory> history_;  ///< never null; filled by the thread
  CancelToken cancel_;  ///< raised by Correct(), reset under the mutex when the thread looks
  CancelToken ending_;  ///< raised when the thread is to end

  mutable Mutex mutex_;
  CondVar changed_;   ///< there is work
  CondVar accepted_;  ///< finished submaps were taken
  std::vector<NewSession> added_ ABSL_GUARDED_BY(mutex_);
  absl::btree_map<std::string, PendingSession> pending_ ABSL_GUARDED_BY(mutex_);
  std::vector<NewSession> sessions_ ABSL_GUARDED_BY(mutex_);  ///< by order of arrival
  absl::flat_hash_map<std::string, std::size_t> known_ ABSL_GUARDED_BY(mutex_);  ///< their places
  std::vector<RetractionWaiter> retractions_ ABSL_GUARDED_BY(mutex_);
  std::vector<StateCallback> states_ ABSL_GUARDED_BY(mutex_);
  RequestBook<CorrectionAnswer> correction_book_ ABSL_GUARDED_BY(mutex_);
  RequestBook<RetractionAnswer> retraction_book_ ABSL_GUARDED_BY(mutex_);
  absl::btree_multiset<Clock::time_point> correction_arrivals_ ABSL_GUARDED_BY(mutex_);
  std::optional<Clock::time_point> news_since_ ABSL_GUARDED_BY(mutex_);   ///< waits for the thread
  std::optional<Clock::time_point> taken_since_ ABSL_GUARDED_BY(mutex_);  ///< not published yet
  Clock::time_point published_at_ ABSL_GUARDED_BY(mutex_) = Clock::now();
  bool urgent_ ABSL_GUARDED_BY(mutex_) = false;
  absl::Status status_ ABSL_GUARDED_BY(mutex_);  ///< of the map; not OK: the thread ends

  std::thread thread_;
};

}  // namespace gem
