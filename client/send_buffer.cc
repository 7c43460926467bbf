#include "client/send_buffer.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/sensor/deskew.h"
#include "gem/v1/ingest_service.pb.h"
#include "proto/wire/pose.h"

namespace gem::client {
namespace {

// Batches of poses that wait to be written.
constexpr std::size_t kUnsentPosesMax = 16;
// Batches of poses that are kept for the next stream while no scan is on its way.
constexpr std::size_t kSentPosesMax = 64;

// How far a sweep reaches from its stamp.
constexpr auto kSweepReach_ns = static_cast<std::int64_t>(kTimeOffsetMax_s) * 1'000'000'000;

/// In one batch.
bool MayFollow(const v1::PoseBatch& poses, const v1::PoseBatch& before) {
  if (poses.poses().empty() || before.poses().empty()) return false;
  return before.poses_size() + poses.poses_size() <= wire::kPosesOfBatch_max &&
         before.poses().rbegin()->stamp_ns() < poses.poses(0).stamp_ns();
}

}  // namespace

bool SendBuffer::Fits(std::uint64_t size_bytes) const {
  return bytes_ == 0 || bytes_ + size_bytes <= limits_.bytes_max;
}

bool SendBuffer::HasRoomForScan(std::uint64_t size_bytes) const {
  return limits_.drop_oldest || (Fits(size_bytes) && scans_.size() < limits_.unsent_scans_max);
}

bool SendBuffer::HasRoomForPoses(std::uint64_t size_bytes) const {
  return limits_.drop_oldest || (Fits(size_bytes) && poses_.size() < kUnsentPosesMax);
}

void SendBuffer::AddScan(std::shared_ptr<v1::IngestRequest> scan, std::uint64_t size_bytes) {
  bytes_ += size_bytes;
  scans_.push_back({std::move(scan), true, size_bytes});
  Trim();
}

void SendBuffer::AddPoses(std::shared_ptr<v1::IngestRequest> poses, std::uint64_t size_bytes) {
  // No scan asks for what is so old; nor will any acknowledgement ever release it.
  if (num_sent_scans_ == 0 && sent_.size() > kSentPosesMax) PopSent();
  bytes_ += size_bytes;
  PushPoses({std::move(poses), false, size_bytes});
  Trim();
}

void SendBuffer::PushPoses(Item batch) {
  // Few large batches, so that a long silence fits.
  if (limits_.drop_oldest && !poses_.empty() &&
      MayFollow(batch.request->poses(), poses_.back().request->poses())) {
    poses_.back().request->mutable_poses()->MergeFrom(batch.request->poses());
    poses_.back().size_bytes += batch.size_bytes;
  } else {
    poses_.push_back(std::move(batch));
  }
}

void SendBuffer::Trim() {
  if (!limits_.drop_oldest) return;
  while (poses_.size() > kUnsentPosesMax) DropOldestPoses();
  while (scans_.size() > 1 &&
         (scans_.size() > limits_.unsent_scans_max || bytes_ > limits_.bytes_max))
    DropOldestScan();
  // A server that takes poses and fuses nothing.
  while (bytes_ > limits_.bytes_max && ForgetOldestSentPoses()) {
  }
}

bool SendBuffer::ForgetOldestSentPoses() {
  const auto poses =
      std::find_if(sent_.begin(), sent_.end(), [](const Item& item) { return !item.is_scan; });
  if (poses == sent_.end()) return false;
  bytes_ -= poses->size_bytes;
  sent_.erase(poses);
  return true;
}

void SendBuffer::DropOldestScan() {
  bytes_ -= scans_.front().size_bytes;
  scans_.pop_front();
  ++num_dropped_;
}

void SendBuffer::DropOldestPoses() {
  const v1::PoseBatch& batch = poses_.front().request->poses();
  if (!batch.poses().empty()) {
    // Without them the server would find the scans of that time between poses far apart.
    const std::int64_t needed_until_ns = batch.poses().rbegin()->stamp_ns() + kSweepReach_ns;
    while (!scans_.empty() && scans_.front().request->scan().stamp_ns() <= needed_until_ns)
      DropOldestScan();
  }
  bytes_ -= poses_.front().size_bytes;
  poses_.pop_front();
}

std::shared_ptr<const v1::IngestRequest> SendBuffer::TakeNext(std::int64_t& credit_bytes) {
  std::deque<Item>& from = poses_.empty() ? scans_ : poses_;
  if (from.empty()) return nullptr;
  if (from.front().is_scan) {
    const auto price_bytes = static_cast<std::int64_t>(from.front().size_bytes);
    if (price_bytes > credit_bytes) return nullptr;
    credit_bytes -= price_bytes;
    from.front().request->mutable_scan()->set_seq(++written_seq_);
    ++num_sent_scans_;
  }
  from.front().seq = written_seq_;
  sent_.push_back(std::move(from.front()));
  from.pop_front();
  return sent_.back().request;
}

absl::Status SendBuffer::Resume(std::uint64_t resume_after_seq) {
  if (resume_after_seq < fused_seq_)
    return absl::DataLossError(absl::StrCat("it wants scan ", resume_after_seq + 1,
                                            ", the oldest that is kept is ", fused_seq_ + 1));
  if (resume_after_seq > written_seq_)
    return absl::FailedPreconditionError(
        absl::StrCat("another client feeds the session: the server has scan ", resume_after_seq,
                     ", the newest sent is ", written_seq_));
  // What the server has is kept until it is fused, but not sent again. Poses after the last scan
  // that it has may be lost; if they are not, repeating them does no harm.
  while (!sent_.empty()) {
    Item& item = sent_.back();
    if (item.is_scan ? item.seq <= resume_after_seq : item.seq < resume_after_seq) break;
    if (item.is_scan) --num_sent_scans_;
    (item.is_scan ? scans_ : poses_).push_front(std::move(item));
    sent_.pop_back();
  }
  written_seq_ = resume_after_seq;
  for (Item& batch : std::exchange(poses_, {})) PushPoses(std::move(batch));
  Trim();
  return absl::OkStatus();
}

void SendBuffer::Acknowledge(std::uint64_t fused_seq) {
  fused_seq_ = std::max(fused_seq_, std::min(fused_seq, written_seq_));
  while (!sent_.empty() && IsUsed(sent_.front())) PopSent();
}

bool SendBuffer::IsUsed(const Item& item) const {
  // Poses are needed until the scan after them is fused.
  return item.is_scan ? item.seq <= fused_seq_ : item.seq < fused_seq_;
}

void SendBuffer::PopSent() {
  bytes_ -= sent_.front().size_bytes;
  if (sent_.front().is_scan) --num_sent_scans_;
  sent_.pop_front();
}

}  // namespace gem::client
