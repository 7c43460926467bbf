// What a robot has given to its session and the server has not used yet: in which order it travels,
// which numbers scans get, what is kept for the next stream. Knows no stream and no clock; not
// thread-safe: the client guards it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>

#include "absl/status/status.h"

namespace gem::v1 {
class IngestRequest;
}  // namespace gem::v1

namespace gem::client {

/// Scans are numbered when they are written: what the server has not accepted when a stream breaks
/// is unsent again, and gets its number anew. Poses go before every scan that is unsent: scans that
/// hold the credit may wait for them.
class SendBuffer {
 public:
  struct Limits {
    std::uint64_t bytes_max = 0;
    std::size_t unsent_scans_max = 1;
    /// Nobody waits for room: the oldest unsent scans give way to newer ones, and then the poses
    /// that a next stream would repeat. Sent scans are kept, and so is the newest.
    bool drop_oldest = false;
  };
  explicit SendBuffer(const Limits& limits) : limits_(limits) {}

  // The robot's side.
  bool HasRoomForScan(std::uint64_t size_bytes) const;
  bool HasRoomForPoses(std::uint64_t size_bytes) const;
  /// size_bytes: of points or pixels, which is what credit pays for.
  void AddScan(std::shared_ptr<v1::IngestRequest> scan, std::uint64_t size_bytes);
  void AddPoses(std::shared_ptr<v1::IngestRequest> poses, std::uint64_t size_bytes);

  // The stream's side.
  /// The next message, numbered and paid for; null if there is none or credit is missing. It stays
  /// valid when it is acknowledged while it is still being written.
  std::shared_ptr<const v1::IngestRequest> TakeNext(std::int64_t& credit_bytes);
  /// Everything was written.
  bool all_written() const { return scans_.empty() && poses_.empty(); }
  /// Everything was written and every scan is fused or refused.
  bool all_fused() const { return all_written() && fused_seq_ >= written_seq_; }

  // What the server says.
  /// The first stream is open: numbers go on after those of an earlier process.
  void Begin(std::uint64_t resume_after_seq) { written_seq_ = fused_seq_ = resume_after_seq; }
  /// A new stream is open. DATA_LOSS if the server wants scans that are not kept any more,
  /// FAILED_PRECONDITION if it has scans that were never written.
  absl::Status Resume(std::uint64_t resume_after_seq);
  /// A server that acknowledges what was never written does no harm.
  void Acknowledge(std::uint64_t fused_seq);

  /// Number of the newest scan that was written.
  std::uint64_t written_seq() const { return written_seq_; }
  std::uint64_t fused_seq() const { return fused_seq_; }
  /// Scans that gave way before they had been accepted.
  std::uint64_t num_dropped() const { return num_dropped_; }

 private:
  struct Item {
    std::shared_ptr<v1::IngestRequest> request;
    bool is_scan = false;
    std::uint64_t size_bytes = 0;
    std::uint64_t seq = 0;  ///< once written: of the scan, or of the last scan before the poses
  };
  bool Fits(std::uint64_t size_bytes) const;
  bool IsUsed(const Item& item) const;
  void PushPoses(Item batch);
  void PopSent();
  void DropOldestScan();
  void DropOldestPoses();
  /// False: none is left.
  bool ForgetOldestSentPoses();
  /// Drops what is too much, if that is the policy.
  void Trim();

  const Limits limits_;
  std::deque<Item> sent_;   ///< as they were written
  std::deque<Item> poses_;  ///< unsent
  std::deque<Item> scans_;  ///< unsent
  std::size_t num_sent_scans_ = 0;
  std::uint64_t bytes_ = 0;
  std::uint64_t written_seq_ = 0;
  std::uint64_t fused_seq_ = 0;
  std::uint64_t num_dropped_ = 0;
};

}  // namespace gem::client
