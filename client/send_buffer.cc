#include "client/send_buffer.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "gem/v1/ingest_service.pb.h"

namespace gem::client {
namespace {

// Scans that wait to be written; more would only add to the robot's memory.
constexpr std::size_t kUnsentScansMax = 2;
// Batches of poses that wait to be written.
constexpr std::size_t kUnsentPosesMax = 16;
// Batches of poses that are kept for the next stream while no scan is on its way.
constexpr std::size_t kSentPosesMax = 64;

}  // namespace

bool SendBuffer::Fits(std::uint64_t size_bytes) const {
  return bytes_ == 0 || bytes_ + size_bytes <= bytes_max_;
}

bool SendBuffer::HasRoomForScan(std::uint64_t size_bytes) const {
  return Fits(size_bytes) && scans_.size() < kUnsentScansMax;
}

bool SendBuffer::HasRoomForPoses(std::uint64_t size_bytes) const {
  return Fits(size_bytes) && poses_.size() < kUnsentPosesMax;
}

void SendBuffer::AddScan(std::shared_ptr<v1::IngestRequest> scan, std::uint64_t size_bytes) {
  bytes_ += size_bytes;
  scans_.push_back({std::move(scan), true, size_bytes});
}

void SendBuffer::AddPoses(std::shared_ptr<v1::IngestRequest> poses, std::uint64_t size_bytes) {
  // No scan asks for what is so old; nor will any acknowledgement ever release it.
  if (num_sent_scans_ == 0 && sent_.size() > kSentPosesMax) PopSent();
  bytes_ += size_bytes;
  poses_.push_back({std::move(poses), false, size_bytes});
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
