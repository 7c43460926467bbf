#include "server/reader_stream.h"

#include <utility>

#include "server/byte_buffer.h"
#include "server/status_mapping.h"

namespace gem {

void ReaderStream::Start(std::size_t request_bytes, std::unique_ptr<MessageSource> source,
                         NewsSource news) {
  source_ = std::move(source);
  Begin(request_bytes);
  const absl::Status seated = scheduler_.Add(self_, news);
  if (seated.ok()) return;
  MutexLock lock(mutex_);
  EndLocked(seated);
}

void ReaderStream::Refuse(std::size_t request_bytes, const absl::Status& status) {
  Begin(request_bytes);
  MutexLock lock(mutex_);
  EndLocked(status);
}

void ReaderStream::Begin(std::size_t request_bytes) {
  self_ = shared_from_this();
  metrics_.Begin();
  metrics_.CountReceived(request_bytes);
}

std::optional<Clock::time_point> ReaderStream::TakeTurn(Clock::time_point now) {
  {
    // A reader that is slow costs no turn's work: the end of the write wakes it.
    MutexLock lock(mutex_);
    if (writing_ || end_.has_value()) return std::nullopt;
  }
  MessageSource::Next next = source_->TakeNext(now);
  MutexLock lock(mutex_);
  if (end_.has_value()) return std::nullopt;
  if (next.end.has_value()) EndLocked(*next.end);
  if (!next.message.has_value()) return next.wake_at;
  message_ = ToByteBuffer(*next.message);
  metrics_.CountSent(next.message->size_bytes());
  writing_ = true;
  StartWrite(&message_);
  return std::nullopt;
}

void ReaderStream::OnStop() {
  MutexLock lock(mutex_);
  EndLocked(absl::UnavailableError("the server is going away"));
}

std::optional<Clock::time_point> ReaderStream::behind_since() const {
  return source_->behind_since();
}

void ReaderStream::OnWriteDone(bool /*ok*/) {
  {
    MutexLock lock(mutex_);
    writing_ = false;
    message_.Clear();
    // A write that failed is followed by OnCancel().
    FinishIfDueLocked();
  }
  scheduler_.Wake(this);
}

void ReaderStream::OnCancel() {
  MutexLock lock(mutex_);
  EndLocked(absl::CancelledError("the client has gone"));
}

void ReaderStream::OnDone() {
  scheduler_.Remove(this);
  self_.reset();
}

void ReaderStream::EndLocked(const absl::Status& status) {
  if (!end_.has_value()) end_ = status;
  FinishIfDueLocked();
}

void ReaderStream::FinishIfDueLocked() {
  if (!end_.has_value() || writing_ || finished_) return;
  finished_ = true;
  metrics_.End(CodeName(*end_), std::chrono::duration<double>(Clock::now() - start_).count());
  Finish(ToGrpc(*end_));
}

}  // namespace gem
