// A gem_server of our own, for experiments that go through the service: started on free ports and
// stopped when it goes out of scope.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace gem::evaluation {

class ServerProcess {
 public:
  /// gem_server beside this program. NOT_FOUND if there is none, UNAVAILABLE if it does not start.
  static absl::StatusOr<std::unique_ptr<ServerProcess>> Start();
  ~ServerProcess();
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  /// "127.0.0.1:PORT".
  const std::string& address() const { return address_; }

 private:
  ServerProcess(pid_t pid, int output) : pid_(pid), output_(output) {}

  const pid_t pid_;
  const int output_;  ///< read end of its stdout
  std::string address_;
};

}  // namespace gem::evaluation
