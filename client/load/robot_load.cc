#include "client/load/robot_load.h"

#include <grpcpp/channel.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "client/call_status.h"
#include "client/ingest_messages.h"
#include "gem/v1/ingest_service.pb.h"

namespace gem::load {
namespace {

constexpr char kMethod[] = "/gem.v1.IngestService/Ingest";

grpc::ByteBuffer ToBuffer(const v1::IngestRequest& request) {
  const grpc::Slice slice(request.SerializeAsString());
  return {&slice, 1};
}

std::optional<v1::IngestResponse> FromBuffer(grpc::ByteBuffer& buffer) {
  v1::IngestResponse response;
  grpc::ProtoBufferReader reader(&buffer);
  if (!response.ParseFromZeroCopyStream(&reader)) return std::nullopt;
  return response;
}

}  // namespace

RobotLoad::RobotLoad(const client::Connection& connection, const ScanTape& tape,
                     const client::SessionSetup& setup)
    : tape_(tape), stub_(connection.channel()) {
  v1::IngestRequest open;
  client::ToProto(setup, open.mutable_open());
  sent_ = ToBuffer(open);
  stub_.PrepareBidiStreamingCall(&context_, kMethod, {}, this);
  // Due() starts writes from other threads: the call must not be over before reading is.
  AddHold();
  StartRead(&received_);
  StartWrite(&sent_);
  StartCall();
}

RobotLoad::~RobotLoad() {
  context_.TryCancel();
  MutexLock lock(mutex_);
  while (!end_.has_value()) changed_.Wait(mutex_);
}

absl::Status RobotLoad::WaitUntilOpened() {
  MutexLock lock(mutex_);
  while (!opened_ && !end_.has_value()) changed_.Wait(mutex_);
  if (opened_) return absl::OkStatus();
  return end_->ok() ? absl::InternalError("the stream ended before it was opened") : *end_;
}

void RobotLoad::Due() {
  MutexLock lock(mutex_);
  due_.push_back(Clock::now());
  WriteNextLocked();
}

void RobotLoad::FloodUntil(Clock::time_point end) {
  MutexLock lock(mutex_);
  flood_end_ = end;
  WriteNextLocked();
}

absl::Status RobotLoad::Close() {
  MutexLock lock(mutex_);
  closing_ = true;
  WriteNextLocked();
  while (!end_.has_value()) changed_.Wait(mutex_);
  if (end_->ok() && done_seq_ < sent_seq_)
    return absl::InternalError(
        absl::StrCat(sent_seq_ - done_seq_, " scans were never acknowledged"));
  return *end_;
}

std::uint64_t RobotLoad::num_done() const {
  MutexLock lock(mutex_);
  return done_seq_;
}

RobotReport RobotLoad::report() const {
  MutexLock lock(mutex_);
  return report_;
}

bool RobotLoad::HasDueLocked() const { return !due_.empty() || Clock::now() < flood_end_; }

void RobotLoad::WriteNextLocked() {
  if (writing_ || !opened_ || close_sent_ || read_all_) return;
  const std::uint64_t next_bytes = tape_.PayloadBytes(sent_seq_ + 1);
  if (HasDueLocked()) {
    if (next_bytes > credit_bytes_) return;
    credit_bytes_ -= next_bytes;
    on_the_way_.push_back(due_.empty() ? Clock::now() : due_.front());
    if (!due_.empty()) due_.pop_front();
    sent_ = tape_.Message(++sent_seq_);
  } else if (closing_) {
    close_sent_ = true;
    v1::IngestRequest close;
    close.mutable_close();
    sent_ = ToBuffer(close);
  } else {
    return;
  }
  writing_ = true;
  StartWrite(&sent_);
}

void RobotLoad::OnWriteDone(bool ok) {
  MutexLock lock(mutex_);
  writing_ = false;
  // A write that failed is followed by OnDone().
  if (ok) WriteNextLocked();
}

void RobotLoad::OnReadDone(bool ok) {
  if (!ok) {
    {
      MutexLock lock(mutex_);
      read_all_ = true;
    }
    return RemoveHold();
  }
  const std::optional<v1::IngestResponse> response = FromBuffer(received_);
  MutexLock lock(mutex_);
  if (response.has_value() && response->has_opened()) {
    opened_ = true;
    credit_bytes_ = response->opened().credit_bytes();
    sent_seq_ = done_seq_ = response->opened().resume_after_seq();
    changed_.NotifyAll();
  } else if (response.has_value() && response->has_ack()) {
    const v1::IngestAck& ack = response->ack();
    NoteAckLocked(ack.fused_seq(),
                  static_cast<std::uint64_t>(ack.problems_size()) + ack.problems_left_out(),
                  ack.credit_bytes());
  }
  WriteNextLocked();
  StartRead(&received_);
}

void RobotLoad::NoteAckLocked(std::uint64_t fused_seq, std::uint64_t num_refused,
                              std::uint64_t credit_bytes) {
  const Clock::time_point now = Clock::now();
  const std::uint64_t newly_done = fused_seq > done_seq_ ? fused_seq - done_seq_ : 0;
  for (std::uint64_t i = 0; i < newly_done && !on_the_way_.empty(); ++i) {
    report_.latencies_s.push_back(std::chrono::duration<double>(now - on_the_way_.front()).count());
    on_the_way_.pop_front();
  }
  done_seq_ += newly_done;
  report_.num_refused += num_refused;
  report_.num_fused += newly_done - std::min(newly_done, num_refused);
  credit_bytes_ += credit_bytes;
}

void RobotLoad::OnDone(const grpc::Status& status) {
  MutexLock lock(mutex_);
  end_ = client::ToStatus(status, "the server");
  changed_.NotifyAll();
}

}  // namespace gem::load
