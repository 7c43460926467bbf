// The whole server in one object: services, actors, metrics page. main() and tests start it.
#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "server/options.h"

namespace gem {

struct Workers;

class Server {
 public:
  /// Listens and serves when it returns. INVALID_ARGUMENT names the option that is wrong;
  /// UNAVAILABLE names the address that cannot be had.
  static absl::StatusOr<std::unique_ptr<Server>> Start(const ServerOptions& options);
  /// Stops.
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  /// ADDR:PORT, with the port that was taken.
  const std::string& grpc_address() const;
  const std::string& metrics_address() const;

  /// So that a test can hold them up.
  Workers& workers();

  /// Tells the streams, answers who waits, ends all threads; in under two seconds. Idempotent.
  void Stop();

 private:
  struct Impl;
  explicit Server(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace gem
