#include "server/ingest_reactor.h"

#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "proto/wire/map.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scan.h"
#include "proto/wire/session_setup.h"
#include "server/status_mapping.h"

namespace gem {
namespace {

constexpr double kReconnectAfter_s = 1.0;

void AckToProto(const IngestProgress& progress, v1::IngestAck* ack) {
  ack->set_accepted_seq(progress.accepted_seq);
  ack->set_fused_seq(progress.fused_seq);
  ack->set_credit_bytes(progress.credit_bytes);
  ack->set_problems_left_out(progress.problems_left_out);
  for (const IngestProblem& problem : progress.problems) {
    v1::ScanProblem* proto = ack->add_problems();
    proto->set_seq(problem.seq);
    proto->set_reason(static_cast<v1::ProblemReason>(problem.reason));
    proto->set_message(problem.text);
    proto->set_expected_seq(problem.expected_seq);
  }
}

absl::Status WantOpenFirst() {
  return wire::WithField(absl::InvalidArgumentError("open is unset, want it in the first message"),
                         "open");
}

}  // namespace

bool IngestStreams::Add(const std::shared_ptr<IngestReactor>& stream) {
  MutexLock lock(mutex_);
  if (!draining_) streams_.insert(stream);
  return !draining_;
}

void IngestStreams::Remove(const std::shared_ptr<IngestReactor>& stream) {
  MutexLock lock(mutex_);
  streams_.erase(stream);
}

void IngestStreams::DrainAll() {
  std::vector<std::shared_ptr<IngestReactor>> streams;
  {
    MutexLock lock(mutex_);
    draining_ = true;
    streams.assign(streams_.begin(), streams_.end());
  }
  for (const auto& stream : streams) stream->Drain();
}

void IngestReactor::Start() {
  self_ = shared_from_this();
  metrics_.Begin();
  const bool welcome = streams_.Add(self_);
  MutexLock lock(mutex_);
  if (welcome) {
    ReadOnLocked();
  } else {
    EndLocked(absl::UnavailableError("the server is going away"));
  }
}

void IngestReactor::Drain() {
  MutexLock lock(mutex_);
  drain_ = true;
  EndLocked(absl::UnavailableError("the server is going away"));
}

void IngestReactor::OnReadDone(bool ok) {
  std::shared_ptr<IngestSink> taken_over;
  absl::Status refused;
  bool is_open = false;
  if (ok) metrics_.CountReceived(request_.ByteSizeLong());
  if (ok && request_.has_open()) {
    is_open = true;
    // Outside of the mutex: it makes threads. Only this function sets session_.
    absl::StatusOr<std::shared_ptr<IngestSink>> previous = Open(request_.open());
    refused = previous.status();
    if (previous.ok()) taken_over = *std::move(previous);
  }
  {
    MutexLock lock(mutex_);
    reading_ = false;
    if (!ok) {
      half_closed_ = true;
    } else if (!refused.ok()) {
      EndLocked(refused);
    } else if (is_open) {
      ReadOnLocked();
    } else {
      TakeMessageLocked();
    }
    AdvanceLocked();
  }
  if (taken_over != nullptr) taken_over->OnTakenOver();
}

absl::StatusOr<std::shared_ptr<IngestSink>> IngestReactor::Open(const v1::OpenSession& open) {
  {
    MutexLock lock(mutex_);
    if (session_ != nullptr)
      return wire::WithField(
          absl::InvalidArgumentError("open is set again, want it in the first message only"),
          "open");
  }
  const absl::StatusOr<wire::SessionSetup> setup = wire::FromProto(open, wire::FieldPath("open"));
  if (!setup.ok()) return setup.status();
  if (open.overload() < 0 || open.overload() > v1::OVERLOAD_POLICY_DROP_OLDEST)
    return wire::Refuse(wire::FieldPath("open.overload"), absl::StrCat(open.overload()),
                        "BLOCK or DROP_OLDEST");
  const IngestOpening opening{open.opener(), open.attempt(),
                              open.overload() == v1::OVERLOAD_POLICY_DROP_OLDEST};
  absl::StatusOr<std::shared_ptr<IngestSink>> previous = OpenSession(*setup, opening);
  // In this order: a session that is ending never goes on again.
  if (open.closing() && absl::IsFailedPrecondition(previous.status()))
    return AwaitEnd(*setup, opening, previous.status());
  return previous;
}

absl::StatusOr<std::shared_ptr<IngestSink>> IngestReactor::OpenSession(
    const wire::SessionSetup& setup, IngestOpening opening) {
  absl::StatusOr<std::shared_ptr<SessionActor>> session = registry_.OpenSession(setup);
  if (!session.ok()) return session.status();
  absl::StatusOr<SessionMailbox::Attached> attached =
      (*session)->mailbox().Attach(shared_from_this(), opening);
  if (absl::IsAborted(attached.status())) return attached.status();
  if (!attached.ok())
    return wire::WithField(
        absl::FailedPreconditionError(
            absl::StrCat("open.session is ", setup.session, ", which has ended, want a new id")),
        "open.session");
  v1::SessionOpened opened;
  opened.set_resume_after_seq(attached->resume_after_seq);
  opened.set_credit_bytes(attached->credit_bytes);
  opened.set_scan_bytes_max(options_.scan_bytes_max);
  opened.set_cell_size_m((*session)->config().local_map.cell_size_m);
  opened.set_local_map_side_m(static_cast<float>(SideCells((*session)->config().local_map)) *
                              (*session)->config().local_map.cell_size_m);
  opened.set_epoch((*session)->map()->snapshot()->version.epoch);
  MutexLock lock(mutex_);
  session_ = *std::move(session);
  opened_ = std::move(opened);
  return std::move(attached->previous);
}

absl::StatusOr<std::shared_ptr<IngestSink>> IngestReactor::AwaitEnd(const wire::SessionSetup& setup,
                                                                    IngestOpening opening,
                                                                    const absl::Status& refused) {
  const std::shared_ptr<SessionActor> session = registry_.FindSession(setup);
  if (session == nullptr) return refused;
  {
    // Before it is attached: it may be told at once.
    MutexLock lock(mutex_);
    session_ = session;
    closing_ = true;
  }
  GEM_ASSIGN_OR_RETURN(SessionMailbox::EndOutlook outlook,
                       session->mailbox().AttachForEnd(shared_from_this(), opening));
  if (!outlook.ending) return refused;
  if (outlook.end.has_value()) OnEnded(*outlook.end);
  return std::move(outlook.previous);
}

void IngestReactor::TakeMessageLocked() {
  if (session_ == nullptr) return EndLocked(WantOpenFirst());
  IngestMessage message;
  message.arrived = Clock::now();
  switch (request_.payload_case()) {
    case v1::IngestRequest::kScan:
      message.seq = request_.scan().seq();
      message.credit_bytes = wire::PayloadBytes(request_.scan());
      message.size_bytes = request_.scan().SpaceUsedLong();
      message.scan.reset(request_.release_scan());
      return EnqueueLocked(std::move(message));
    case v1::IngestRequest::kPoses:
      message.size_bytes = request_.poses().SpaceUsedLong();
      message.poses.reset(request_.release_poses());
      return EnqueueLocked(std::move(message));
    case v1::IngestRequest::kClose:
      closing_ = true;
      return session_->mailbox().RequestEnd(this);
    case v1::IngestRequest::kOpen:
    case v1::IngestRequest::PAYLOAD_NOT_SET:
      break;
  }
  session_->mailbox().AddProblem(
      this, {0, wire::ProblemReason::kMalformed, "payload is unset, want scan, poses or close"});
  ReadOnLocked();
}

void IngestReactor::EnqueueLocked(IngestMessage message) {
  // Without room the stream is not read: OnProgress() reads on. The robot notices by its credit, or
  // by TCP.
  if (session_->Enqueue(this, std::move(message))) ReadOnLocked();
}

void IngestReactor::ReadOnLocked() {
  if (reading_ || half_closed_ || closing_ || end_.has_value() || finished_) return;
  reading_ = true;
  StartRead(&request_);
}

void IngestReactor::OnProgress() {
  MutexLock lock(mutex_);
  if (session_ == nullptr || finished_) return;
  if (session_->mailbox().HasRoom()) ReadOnLocked();
  AdvanceLocked();
}

void IngestReactor::OnEnded(const absl::StatusOr<SessionEnd>& end) {
  MutexLock lock(mutex_);
  if (!end.ok()) return EndLocked(end.status());
  closed_.emplace();
  wire::ToProto(end->version, closed_->mutable_version());
  closed_->set_num_scans_fused(end->num_scans_fused);
  closed_->set_num_scans_refused(end->num_scans_refused);
  closed_->set_num_scans_not_deskewed(end->num_scans_not_deskewed);
  closed_->set_num_scans_dropped(end->num_scans_dropped);
  EndLocked(absl::OkStatus());
}

void IngestReactor::OnTakenOver() {
  MutexLock lock(mutex_);
  EndLocked(absl::AbortedError("another stream has resumed the session"));
}

void IngestReactor::OnWriteDone(bool /*ok*/) {
  MutexLock lock(mutex_);
  writing_ = false;
  // A write that failed is followed by OnCancel(): the session goes on without this stream.
  AdvanceLocked();
}

void IngestReactor::OnCancel() {
  MutexLock lock(mutex_);
  cancelled_ = true;
  EndLocked(absl::CancelledError("the client has gone"));
}

void IngestReactor::OnDone() {
  std::shared_ptr<SessionActor> session;
  {
    MutexLock lock(mutex_);
    session = std::move(session_);
  }
  if (session != nullptr) session->mailbox().Detach(this);
  streams_.Remove(self_);
  self_.reset();
}

void IngestReactor::EndLocked(const absl::Status& status) {
  if (!end_.has_value()) end_ = status;
  AdvanceLocked();
}

bool IngestReactor::NextResponseLocked() {
  if (cancelled_) return false;
  response_.Clear();
  if (opened_.has_value()) {
    *response_.mutable_opened() = *std::exchange(opened_, std::nullopt);
    return true;
  }
  if (session_ == nullptr) return false;
  const IngestProgress progress = session_->mailbox().TakeProgress(this);
  if (progress.news) {
    AckToProto(progress, response_.mutable_ack());
    return true;
  }
  if (std::exchange(drain_, false)) {
    response_.mutable_drain()->set_reconnect_after_s(kReconnectAfter_s);
    return true;
  }
  if (closed_.has_value()) {
    *response_.mutable_closed() = *std::exchange(closed_, std::nullopt);
    return true;
  }
  return false;
}

void IngestReactor::AdvanceLocked() {
  if (writing_ || finished_) return;
  if (NextResponseLocked()) {
    writing_ = true;
    metrics_.CountSent(response_.ByteSizeLong());
    StartWrite(&response_);
    return;
  }
  // A client that has said all it had to say without closing the session hears how its scans fared.
  const bool all_told =
      half_closed_ && !closing_ && (session_ == nullptr || session_->mailbox().idle());
  if (!end_.has_value() && all_told) end_ = absl::OkStatus();
  if (!end_.has_value()) return;
  finished_ = true;
  metrics_.End(CodeName(*end_), std::chrono::duration<double>(Clock::now() - start_).count());
  Finish(ToGrpc(*end_));
}

}  // namespace gem
