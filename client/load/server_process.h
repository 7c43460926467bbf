// A server of our own, for experiments and benchmarks that go through the service: started on free
// ports and stopped when it goes out of scope.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace gem::load {

class ServerProcess {
 public:
  /// gem_server beside this program, with more options than its ports. NOT_FOUND if there is none,
  /// UNAVAILABLE if it does not start.
  static absl::StatusOr<std::unique_ptr<ServerProcess>> Start(
      const std::vector<std::string>& options = {});
  /// This program with other arguments; it must print the line that gem_server prints when it is
  /// ready. Errors as above.
  static absl::StatusOr<std::unique_ptr<ServerProcess>> StartOwn(
      const std::vector<std::string>& arguments);
  ~ServerProcess();
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  /// "127.0.0.1:PORT".
  const std::string& address() const { return address_; }
  pid_t pid() const { return pid_; }
  /// Tells it to go and waits. Its exit code, or minus the signal that ended it.
  int Stop();

 private:
  static absl::StatusOr<std::unique_ptr<ServerProcess>> Run(std::vector<std::string> words);
  ServerProcess(pid_t pid, int output) : pid_(pid), output_(output) {}

  const pid_t pid_;
  std::optional<int> exit_code_;
  const int output_;  ///< read end of its stdout
  std::string address_;
};

}  // namespace gem::load
