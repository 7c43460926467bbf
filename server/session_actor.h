// One session: a mailbox, a thread, a mapper. It outlives its streams: a robot that vanishes loses
// nothing and resumes where it was.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <thread>

#include "core/base/mutex.h"
#include "server/local_map_feed.h"
#include "server/map_actor.h"
#include "server/metrics.h"
#include "server/session_mailbox.h"
#include "server/session_mapper.h"

namespace gem {

struct SessionActorOptions {
  std::uint64_t queue_bytes_max = 64u << 20;
  double publish_hz = 2;
  double local_publish_hz = 10;
  double session_idle_s_max = 600;
  double pose_wait_s_max = 0.2;
  int waiting_scans_max = 100;
  double overload_age_s_max = 0.2;
};

class SessionActor {
 public:
  /// The map knows the session. config is valid. budget: of all sessions, outlives this one.
  SessionActor(SessionConfig config, std::shared_ptr<MapActor> map,
               std::shared_ptr<LocalMapFeed> feed, const SessionActorOptions& options,
               IngestBudget& budget, Metrics& metrics);
  ~SessionActor();
  SessionActor(const SessionActor&) = delete;
  SessionActor& operator=(const SessionActor&) = delete;

  const SessionConfig& config() const { return config_; }
  const std::shared_ptr<MapActor>& map() const { return map_; }
  SessionMailbox& mailbox() { return *mailbox_; }
  /// mailbox().Enqueue(), with what it refused or dropped counted; false: do not read on before
  /// OnProgress().
  bool Enqueue(const IngestSink* sink, IngestMessage message);
  const SessionMailbox& mailbox() const { return *mailbox_; }

  /// Where the session's local maps go; of its robot. The last one stays when the session ends.
  const std::shared_ptr<LocalMapFeed>& feed() const { return feed_; }

  /// False once the session has ended.
  bool active() const { return active_.load(std::memory_order_acquire); }
  std::uint64_t num_scans_fused() const { return num_fused_.load(std::memory_order_relaxed); }
  std::uint64_t num_scans_refused() const { return num_refused_.load(std::memory_order_relaxed); }
  std::uint64_t num_scans_dropped() const { return num_dropped_.load(std::memory_order_relaxed); }

  /// True until everything that the session sent is published.
  bool feeds_map() const { return !mailbox_->has_end(); }

  /// Ends the thread without ending the session: the server goes away.
  void Stop();
  /// Ends the thread and the session's stream: its map has been deleted.
  void Abandon(const absl::Status& why);
  /// Waits for the thread after Stop() or Abandon(). One caller only.
  void Join();

 private:
  void Run();
  void CountDropped(std::uint64_t num_dropped);
  void TakePoses(SessionMapper& mapper, const std::vector<IngestMessage>& batches);
  /// Decodes the scan and puts it in line.
  void TakeScan(SessionMapper& mapper, IngestMessage message);
  /// Fuses or refuses from the front of the line until a scan has to wait for poses. Nothing waits
  /// any longer if the session ends.
  void ServeLine(SessionMapper& mapper, bool ending);
  /// False: the front has to wait.
  bool ServeFront(SessionMapper& mapper, bool ending);
  void FinishFront(SessionMapper& mapper, const absl::Status& status);
  /// Why the front must not wait any longer; empty if it may.
  std::string WhyGiveUp(bool ending) const;
  void Fuse(SessionMapper& mapper, SessionMapper::HeldScan& held, Clock::time_point arrived);
  void PublishWhatIsDue(SessionMapper& mapper);
  void PublishLocalMap(const SessionMapper& mapper);
  void End(SessionMapper& mapper);
  void TellStream() const;
  Clock::time_point NextDeadline() const;

  // Constant after construction.
  const SessionConfig config_;
  const std::shared_ptr<MapActor> map_;
  const std::shared_ptr<LocalMapFeed> feed_;
  const std::uint64_t feed_ticket_;
  const SessionActorOptions options_;
  Metrics& metrics_;
  /// Shared: what a finished call or a publication still refers to.
  const std::shared_ptr<SessionMailbox> mailbox_;

  /// A scan that is done when those before it are.
  struct InLine {
    IngestMessage message;         ///< decoded: its scan is gone
    absl::Status status;           ///< why it is refused, if that is known already
    SessionMapper::HeldScan held;  ///< if it is not
    std::uint64_t size_bytes = 0;  ///< what it occupies, or counts for in the mailbox
    Clock::time_point since;
  };

  // The thread's own.
  std::deque<InLine> line_;
  std::uint64_t line_bytes_ = 0;
  std::uint64_t num_not_deskewed_ = 0;
  Clock::time_point last_local_publish_;
  Clock::time_point last_publish_;
  std::shared_ptr<const LocalMap> local_map_;  ///< the last copy; null before the first scan
  bool local_map_is_old_ = false;
  bool map_is_old_ = false;

  std::atomic<bool> active_{true};
  std::atomic<std::uint64_t> num_fused_{0};
  std::atomic<std::uint64_t> num_refused_{0};
  std::atomic<std::uint64_t> num_dropped_{0};

  std::thread thread_;
};

}  // namespace gem
