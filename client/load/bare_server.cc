#include "client/load/bare_server.h"

#include <grpcpp/grpcpp.h>

#include <csignal>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>

#include "absl/strings/str_cat.h"
#include "core/base/mutex.h"
#include "gem/v1/ingest_service.grpc.pb.h"

namespace gem::load {
namespace {

/// As gem_server has them by default.
constexpr std::uint64_t kCreditBytes = std::uint64_t{64} << 20;
constexpr std::uint64_t kScanBytesMax = std::uint64_t{16} << 20;
constexpr int kMessageBytesMax = 32 << 20;

/// Acknowledges at once what it reads; one answer at a time, like gem_server.
class BareStream final : public grpc::ServerBidiReactor<v1::IngestRequest, v1::IngestResponse> {
 public:
  BareStream() { StartRead(&request_); }

 private:
  void OnReadDone(bool ok) override {
    MutexLock lock(mutex_);
    if (!ok) return FinishLocked();
    switch (request_.payload_case()) {
      case v1::IngestRequest::kOpen:
        next_.emplace();
        next_->mutable_opened()->set_credit_bytes(kCreditBytes);
        next_->mutable_opened()->set_scan_bytes_max(kScanBytesMax);
        break;
      case v1::IngestRequest::kScan:
        AcknowledgeLocked(request_.scan());
        break;
      case v1::IngestRequest::kClose:
        return FinishLocked();
      default:
        break;
    }
    WriteNextLocked();
    StartRead(&request_);
  }

  void OnWriteDone(bool /*ok*/) override {
    MutexLock lock(mutex_);
    writing_ = false;
    WriteNextLocked();
    if (finishing_ && !writing_) Finish(grpc::Status::OK);
  }

  void OnDone() override { delete this; }

  void AcknowledgeLocked(const v1::Scan& scan) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!next_.has_value()) next_.emplace();
    v1::IngestAck& ack = *next_->mutable_ack();
    ack.set_accepted_seq(scan.seq());
    ack.set_fused_seq(scan.seq());
    ack.set_credit_bytes(ack.credit_bytes() + scan.points().size());
  }

  void WriteNextLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (writing_ || !next_.has_value()) return;
    response_ = *std::move(next_);
    next_.reset();
    writing_ = true;
    StartWrite(&response_);
  }

  void FinishLocked() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    finishing_ = true;
    if (!writing_) Finish(grpc::Status::OK);
  }

  v1::IngestRequest request_;  ///< the read in flight owns it

  Mutex mutex_;
  v1::IngestResponse response_ ABSL_GUARDED_BY(mutex_);  ///< the write in flight owns it
  std::optional<v1::IngestResponse> next_ ABSL_GUARDED_BY(mutex_);
  bool writing_ ABSL_GUARDED_BY(mutex_) = false;
  bool finishing_ ABSL_GUARDED_BY(mutex_) = false;
};

class BareService final : public v1::IngestService::CallbackService {
  grpc::ServerBidiReactor<v1::IngestRequest, v1::IngestResponse>* Ingest(
      grpc::CallbackServerContext* /*context*/) override {
    return new BareStream;
  }
};

}  // namespace

absl::Status RunBareServer(const std::string& listen) {
  // Before any thread exists, so that only sigwait() gets them.
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  BareService service;
  grpc::ServerBuilder builder;
  int port = 0;
  builder.AddListeningPort(listen, grpc::InsecureServerCredentials(), &port);
  builder.SetMaxReceiveMessageSize(kMessageBytesMax);
  builder.RegisterService(&service);
  const std::unique_ptr<grpc::Server> server = builder.BuildAndStart();
  if (server == nullptr || port == 0)
    return absl::UnavailableError(absl::StrCat("cannot listen on ", listen));
  std::printf("gem_server ready grpc=%s:%d metrics=none\n",
              listen.substr(0, listen.rfind(':')).c_str(), port);
  std::fflush(stdout);
  int signal = 0;
  sigwait(&signals, &signal);
  server->Shutdown(std::chrono::system_clock::now());
  return absl::OkStatus();
}

}  // namespace gem::load
