// A planner that watches a map: counts what it is sent and decodes nothing. One that never reads
// shows what a dead radio link does to the server.
#pragma once

#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/client_callback.h>

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "client/connection.h"
#include "core/base/mutex.h"

namespace gem::load {

struct WatchReport {
  std::uint64_t num_messages = 0;
  std::uint64_t num_bytes = 0;
};

class WatchLoad final : private grpc::ClientBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer> {
 public:
  /// The whole map in its default encoding, from now until it is destroyed.
  WatchLoad(const client::Connection& connection, const std::string& map, bool reads);
  ~WatchLoad() override;

  WatchReport report() const;
  /// How the stream ended; nothing while it goes on.
  std::optional<absl::Status> end() const;

 private:
  void OnReadDone(bool ok) override;
  void OnDone(const grpc::Status& status) override;

  grpc::GenericStub stub_;
  grpc::ClientContext context_;
  grpc::ByteBuffer request_;
  grpc::ByteBuffer received_;  ///< the read in flight owns it

  mutable Mutex mutex_;
  CondVar changed_;
  WatchReport report_ ABSL_GUARDED_BY(mutex_);
  std::optional<absl::Status> end_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace gem::load
