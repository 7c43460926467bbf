#include "client/ingest_client.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <random>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/call_status.h"
#include "client/calls/read_message.h"
#include "client/ingest_messages.h"
#include "client/send_buffer.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "gem/v1/ingest_service.grpc.pb.h"
#include "proto/wire/pose.h"
#include "proto/wire/scan.h"

namespace gem::client {
namespace {

using Clock = std::chrono::steady_clock;
using Stream = grpc::ClientReaderWriter<v1::IngestRequest, v1::IngestResponse>;

constexpr double kInt16StepMin_m = 1e-5;
constexpr double kInt16StepMax_m = 1;
// A server that asks for a longer pause is asked again after this one.
constexpr double kPauseMax_s = 60;
// How long a closed stream may take to end by itself.
constexpr double kGoodbye_s = 2;

Clock::duration Seconds(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

/// How one stream ended.
struct StreamEnd {
  absl::Status status;
  double pause_s = 0;       ///< that the server asks for
  bool progressed = false;  ///< a scan was accepted
};

}  // namespace

class IngestClient::Impl {
 public:
  Impl(std::shared_ptr<const Connection> connection, const SessionSetup& setup,
       IngestOptions options)
      : connection_(std::move(connection)),
        options_(std::move(options)),
        stub_(v1::IngestService::NewStub(connection_->channel())),
        buffer_({options_.buffer_bytes_max, static_cast<std::size_t>(options_.unsent_scans_max),
                 options_.overload == OverloadPolicy::kDropOldest}) {
    ToProto(setup, open_request_.mutable_open());
    open_request_.mutable_open()->set_overload(options_.overload == OverloadPolicy::kDropOldest
                                                   ? v1::OVERLOAD_POLICY_DROP_OLDEST
                                                   : v1::OVERLOAD_POLICY_BLOCK);
    open_request_.mutable_open()->set_opener(RandomOpener());
  }

  ~Impl() {
    {
      MutexLock lock(mutex_);
      const Clock::time_point deadline = Clock::now() + Seconds(kGoodbye_s);
      while (closed_.has_value() && !ended_ && changed_.WaitUntil(mutex_, deadline)) {
      }
      stopping_ = true;
      if (context_ != nullptr) context_->TryCancel();
      changed_.NotifyAll();
    }
    if (supervisor_.joinable()) supervisor_.join();
  }

  absl::Status Open() {
    supervisor_ = std::thread([this] { Supervise(); });
    MutexLock lock(mutex_);
    const Clock::time_point deadline = Clock::now() + Seconds(options_.open_timeout_s);
    while (!opened_once_ && !ended_) {
      if (!changed_.WaitUntil(mutex_, deadline))
        return last_error_.ok() ? NotOpenedError() : last_error_;
    }
    return opened_once_ ? absl::OkStatus() : failure_;
  }

  // Constant once Open() has returned.
  const SessionOpened& opened() const { return opened_; }

  absl::Status Send(const OutgoingScan& scan) {
    auto request = std::make_shared<v1::IngestRequest>();
    GEM_RETURN_IF_ERROR(ToProto(scan, options_, request->mutable_scan()));
    const std::uint64_t plain_bytes = wire::PayloadBytes(request->scan());
    if (plain_bytes > opened_.scan_bytes_max)
      return absl::InvalidArgumentError(
          absl::StrCat("the scan has ", plain_bytes, " bytes of ",
                       scan.depth_image ? "depths and colours" : "points",
                       ", the server takes at most ", opened_.scan_bytes_max));
    Compress(options_.compression, request->mutable_scan());
    const std::uint64_t size_bytes = wire::PayloadBytes(request->scan());
    MutexLock lock(mutex_);
    GEM_RETURN_IF_ERROR(WaitForRoomLocked([=, this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
      return buffer_.HasRoomForScan(size_bytes);
    }));
    buffer_.AddScan(std::move(request), size_bytes);
    changed_.NotifyAll();
    return absl::OkStatus();
  }

  absl::Status SendPoses(const std::vector<StampedPose<Odom, Base>>& poses) {
    if (poses.size() > wire::kPosesOfBatch_max)
      return absl::InvalidArgumentError(
          absl::StrCat(poses.size(), " poses in a batch, want at most ", wire::kPosesOfBatch_max));
    auto request = std::make_shared<v1::IngestRequest>();
    wire::ToProto(poses, request->mutable_poses());
    const std::uint64_t size_bytes = request->ByteSizeLong();
    MutexLock lock(mutex_);
    GEM_RETURN_IF_ERROR(WaitForRoomLocked([=, this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
      return buffer_.HasRoomForPoses(size_bytes);
    }));
    buffer_.AddPoses(std::move(request), size_bytes);
    changed_.NotifyAll();
    return absl::OkStatus();
  }

  absl::Status WaitUntilFused() {
    MutexLock lock(mutex_);
    return WaitLocked("scans to be fused", [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
      return buffer_.all_fused();
    });
  }

  absl::StatusOr<SessionClosed> Close() {
    MutexLock lock(mutex_);
    close_wanted_ = true;
    changed_.NotifyAll();
    const absl::Status waited =
        WaitLocked("the session to be closed",
                   [this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) { return closed_.has_value(); });
    if (!waited.ok()) return waited;
    return *closed_;
  }

  IngestProgress progress() const {
    MutexLock lock(mutex_);
    return {buffer_.written_seq(), buffer_.fused_seq(), num_problems_, num_reconnects_,
            buffer_.num_dropped()};
  }

 private:
  // --- What the user's thread waits for.

  template <typename Condition>
  absl::Status WaitLocked(absl::string_view what, Condition condition)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const Clock::time_point begin = Clock::now();
    while (!condition()) {
      if (ended_) return failure_.ok() ? absl::CancelledError("the session is closed") : failure_;
      const Clock::time_point deadline =
          std::max(begin, progress_time_) + Seconds(options_.progress_timeout_s);
      if (!changed_.WaitUntil(mutex_, deadline) &&
          Clock::now() >= std::max(begin, progress_time_) + Seconds(options_.progress_timeout_s))
        return absl::DeadlineExceededError(absl::StrCat("waited ", options_.progress_timeout_s,
                                                        " s for ", what, " without an answer"));
    }
    return absl::OkStatus();
  }

  template <typename Condition>
  absl::Status WaitForRoomLocked(Condition has_room) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (close_wanted_) return absl::FailedPreconditionError("the session is closed");
    return WaitLocked("credit", [=, this]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
      // Also true while a broken stream is opened anew: what comes fits the buffer all the same.
      return !ended_ && has_room();
    });
  }

  // --- The supervisor's thread: one stream after the other, each read to its end.

  void Supervise() {
    int tries = 0;
    while (true) {
      const StreamEnd end = RunStream();
      MutexLock lock(mutex_);
      tries = end.progressed ? 1 : tries + 1;
      if (stopping_ || closed_.has_value()) return EndLocked(absl::OkStatus());
      last_error_ = end.status;
      if (!IsTransient(end.status)) return EndLocked(end.status);
      if (tries >= options_.tries_max)
        return EndLocked(absl::Status(
            end.status.code(),
            absl::StrCat("gave up after ", tries, " streams: ", end.status.message())));
      const double backoff_s = std::min(
          options_.backoff_s_max, options_.backoff_s_min * std::exp2(std::min(tries, 30) - 1));
      const Clock::time_point deadline =
          Clock::now() +
          Seconds(std::clamp(end.pause_s, backoff_s, std::max(kPauseMax_s, backoff_s)));
      while (!stopping_ && changed_.WaitUntil(mutex_, deadline)) {
      }
      if (stopping_) return EndLocked(absl::OkStatus());
      ++num_reconnects_;
    }
  }

  void EndLocked(const absl::Status& failure) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    failure_ = failure;
    ended_ = true;
    changed_.NotifyAll();
  }

  StreamEnd RunStream() {
    grpc::ClientContext context;
    {
      MutexLock lock(mutex_);
      if (stopping_) return {absl::CancelledError("stopped")};
      context_ = &context;
      stream_open_ = false;
      stream_broken_ = false;
      open_timed_out_ = false;
      close_written_ = false;
      // The session may have ended by the close whose answer was lost.
      open_request_.mutable_open()->set_closing(close_ever_written_);
      open_request_.mutable_open()->set_attempt(open_request_.open().attempt() + 1);
    }
    const std::unique_ptr<Stream> stream = stub_->Ingest(&context);
    stream->Write(open_request_);
    std::thread writer([&] { WriteScans(*stream, context); });
    StreamEnd end;
    v1::IngestResponse response;
    while (end.status.ok()) {
      const Got got = ReadMessage(*stream, response);
      if (got == Got::kEnd) break;
      end.status =
          got == Got::kMessage ? Handle(response, end) : DamageError(connection_->address());
      if (!end.status.ok()) context.TryCancel();
    }
    {
      MutexLock lock(mutex_);
      stream_broken_ = true;
      changed_.NotifyAll();
    }
    writer.join();
    const grpc::Status status = stream->Finish();
    MutexLock lock(mutex_);
    context_ = nullptr;
    if (open_timed_out_) {
      end.status = NotOpenedError();
    } else if (end.status.ok()) {
      end.status = status.ok() ? absl::UnavailableError("the server ended the stream")
                               : ToStatus(status, connection_->address());
      end.pause_s = std::max(end.pause_s, RetryAfter_s(status).value_or(0));
    }
    return end;
  }

  /// An error means that the session cannot go on.
  absl::Status Handle(const v1::IngestResponse& response, StreamEnd& end) {
    switch (response.payload_case()) {
      case v1::IngestResponse::kOpened:
        return HandleOpened(response.opened());
      case v1::IngestResponse::kAck:
        HandleAck(response.ack(), end);
        return absl::OkStatus();
      case v1::IngestResponse::kDrain:
        end.pause_s = response.drain().reconnect_after_s();
        return absl::OkStatus();
      case v1::IngestResponse::kClosed:
        HandleClosed(response.closed());
        return absl::OkStatus();
      case v1::IngestResponse::PAYLOAD_NOT_SET:
        break;
    }
    return absl::OkStatus();  // a kind of message that is newer than this client
  }

  absl::Status HandleOpened(const v1::SessionOpened& opened) {
    MutexLock lock(mutex_);
    if (!opened_once_) {
      opened_ = {opened.resume_after_seq(), opened.scan_bytes_max(), opened.cell_size_m(),
                 opened.local_map_side_m()};
      epoch_ = opened.epoch();
      buffer_.Begin(opened.resume_after_seq());
      opened_once_ = true;
    }
    const absl::Status resumed = buffer_.Resume(opened.resume_after_seq());
    if (absl::IsDataLoss(resumed))
      return absl::DataLossError(absl::StrCat(
          opened.epoch() == epoch_ ? "the server forgot the session: "
                                   : "the server was restarted and what it had fused is lost: ",
          resumed.message(), "; open a new session"));
    if (!resumed.ok()) return resumed;
    credit_bytes_ = CreditOf(opened.credit_bytes());
    stream_open_ = true;
    progress_time_ = Clock::now();
    changed_.NotifyAll();
    return absl::OkStatus();
  }

  void HandleAck(const v1::IngestAck& ack, StreamEnd& end) {
    {
      MutexLock lock(mutex_);
      if (ack.accepted_seq() > accepted_seq_) {
        accepted_seq_ = ack.accepted_seq();
        end.progressed = true;
      }
      credit_bytes_ = std::min(credit_bytes_ + CreditOf(ack.credit_bytes()), kCreditMax);
      buffer_.Acknowledge(ack.fused_seq());
      num_problems_ += static_cast<std::uint64_t>(ack.problems_size()) + ack.problems_left_out();
      progress_time_ = Clock::now();
      changed_.NotifyAll();
    }
    if (!options_.on_problem) return;
    for (const v1::ScanProblem& problem : ack.problems()) options_.on_problem(FromProto(problem));
    if (ack.problems_left_out() > 0)
      options_.on_problem({0, "left_out", absl::StrCat(ack.problems_left_out(), " more problems")});
  }

  void HandleClosed(const v1::SessionClosed& closed) {
    MutexLock lock(mutex_);
    closed_ = SessionClosed{{closed.version().epoch(), closed.version().revision()},
                            closed.num_scans_fused(),
                            closed.num_scans_refused(),
                            closed.num_scans_not_deskewed(),
                            closed.num_scans_dropped()};
    changed_.NotifyAll();
  }

  // --- The writer's thread, one per stream.

  void WriteScans(Stream& stream, grpc::ClientContext& context) {
    const Clock::time_point open_deadline = Clock::now() + Seconds(options_.open_timeout_s);
    MutexLock lock(mutex_);
    while (!stream_broken_ && !stream_open_) {
      if (changed_.WaitUntil(mutex_, open_deadline) || stream_open_) continue;
      open_timed_out_ = true;
      context.TryCancel();  // ends the reader's wait, too
      return;
    }
    while (!stream_broken_) {
      if (const auto request = buffer_.TakeNext(credit_bytes_)) {
        changed_.NotifyAll();
        if (!WriteUnlocked(stream, *request)) return;
      } else if (buffer_.all_written() && close_wanted_ && !close_written_) {
        close_written_ = close_ever_written_ = true;
        v1::IngestRequest close;
        close.mutable_close();
        if (!WriteUnlocked(stream, close)) return;
      } else if (close_written_ && closed_.has_value()) {
        mutex_.Unlock();
        stream.WritesDone();
        mutex_.Lock();
        return;
      } else {
        changed_.Wait(mutex_);
      }
    }
  }

  bool WriteUnlocked(Stream& stream, const v1::IngestRequest& request)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    mutex_.Unlock();
    const bool written = stream.Write(request);
    mutex_.Lock();
    return written;
  }

  // --- Small things.

  absl::Status NotOpenedError() const {
    return absl::DeadlineExceededError(absl::StrCat("server ", connection_->address(),
                                                    " did not open the session within ",
                                                    options_.open_timeout_s, " s"));
  }

  static constexpr std::int64_t kCreditMax = std::int64_t{1} << 40;
  static std::int64_t CreditOf(std::uint64_t credit_bytes) {
    return static_cast<std::int64_t>(std::min<std::uint64_t>(credit_bytes, kCreditMax));
  }
  /// Other than that of any process before, or of another robot's.
  static std::uint64_t RandomOpener() {
    std::random_device device;
    const std::uint64_t high = device();
    return high << 32 | device();
  }

  // Constant after construction.
  const std::shared_ptr<const Connection> connection_;
  const IngestOptions options_;
  const std::unique_ptr<v1::IngestService::Stub> stub_;

  v1::IngestRequest open_request_;  // the supervisor's own

  SessionOpened opened_;  // written once, before Open() returns

  mutable Mutex mutex_;
  CondVar changed_;  // anything below

  // What the user wants.
  SendBuffer buffer_ ABSL_GUARDED_BY(mutex_);
  bool close_wanted_ ABSL_GUARDED_BY(mutex_) = false;
  bool stopping_ ABSL_GUARDED_BY(mutex_) = false;

  // The stream.
  grpc::ClientContext* context_ ABSL_GUARDED_BY(mutex_) = nullptr;
  bool stream_open_ ABSL_GUARDED_BY(mutex_) = false;
  bool stream_broken_ ABSL_GUARDED_BY(mutex_) = false;
  bool open_timed_out_ ABSL_GUARDED_BY(mutex_) = false;
  bool close_written_ ABSL_GUARDED_BY(mutex_) = false;
  bool close_ever_written_ ABSL_GUARDED_BY(mutex_) = false;  // on any stream
  std::int64_t credit_bytes_ ABSL_GUARDED_BY(mutex_) = 0;

  // What the server said.
  bool opened_once_ ABSL_GUARDED_BY(mutex_) = false;
  std::uint64_t accepted_seq_ ABSL_GUARDED_BY(mutex_) = 0;
  std::uint64_t epoch_ ABSL_GUARDED_BY(mutex_) = 0;
  std::uint64_t num_problems_ ABSL_GUARDED_BY(mutex_) = 0;
  std::uint64_t num_reconnects_ ABSL_GUARDED_BY(mutex_) = 0;
  Clock::time_point progress_time_ ABSL_GUARDED_BY(mutex_) = {};
  std::optional<SessionClosed> closed_ ABSL_GUARDED_BY(mutex_);
  absl::Status last_error_ ABSL_GUARDED_BY(mutex_);
  absl::Status failure_ ABSL_GUARDED_BY(mutex_);
  bool ended_ ABSL_GUARDED_BY(mutex_) = false;

  std::thread supervisor_;
};

absl::Status Validate(const IngestOptions& options) {
  const auto in_range = [](const char* name, auto value, decltype(value) low,
                           decltype(value) high) {
    // Written so that NaN is refused.
    if (value >= low && value <= high) return absl::OkStatus();
    return absl::InvalidArgumentError(
        absl::StrCat(name, " is ", value, ", want [", low, ", ", high, "]"));
  };
  GEM_RETURN_IF_ERROR(in_range("open_timeout_s", options.open_timeout_s, 0.001, 3600.0));
  GEM_RETURN_IF_ERROR(in_range("progress_timeout_s", options.progress_timeout_s, 0.001, 1e6));
  GEM_RETURN_IF_ERROR(in_range("tries_max", options.tries_max, 1, 1000));
  GEM_RETURN_IF_ERROR(in_range("backoff_s_max", options.backoff_s_max, 0.0, 3600.0));
  GEM_RETURN_IF_ERROR(in_range("backoff_s_min", options.backoff_s_min, 0.0, options.backoff_s_max));
  GEM_RETURN_IF_ERROR(in_range("buffer_bytes_max", options.buffer_bytes_max, std::uint64_t{1},
                               std::uint64_t{1} << 40));
  GEM_RETURN_IF_ERROR(in_range("unsent_scans_max", options.unsent_scans_max, 1, 100'000));
  return in_range("int16_step_m", options.int16_step_m, kInt16StepMin_m, kInt16StepMax_m);
}

IngestClient::IngestClient(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
IngestClient::~IngestClient() = default;

absl::StatusOr<std::unique_ptr<IngestClient>> IngestClient::Open(
    std::shared_ptr<const Connection> connection, const SessionSetup& setup,
    IngestOptions options) {
  GEM_RETURN_IF_ERROR(Validate(options));
  auto impl = std::make_unique<Impl>(std::move(connection), setup, std::move(options));
  GEM_RETURN_IF_ERROR(impl->Open());
  return std::unique_ptr<IngestClient>(new IngestClient(std::move(impl)));
}

const SessionOpened& IngestClient::opened() const { return impl_->opened(); }
absl::Status IngestClient::Send(const OutgoingScan& scan) { return impl_->Send(scan); }
absl::Status IngestClient::SendPoses(const std::vector<StampedPose<Odom, Base>>& poses) {
  return impl_->SendPoses(poses);
}
absl::Status IngestClient::WaitUntilFused() { return impl_->WaitUntilFused(); }
absl::StatusOr<SessionClosed> IngestClient::Close() { return impl_->Close(); }
IngestProgress IngestClient::progress() const { return impl_->progress(); }

}  // namespace gem::client
