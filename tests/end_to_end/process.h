// Runs the shipped binaries as a user would: a server in the background, `gem` in the foreground.
// Not for unit tests: everything goes through argv, stdout and files.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <string>
#include <vector>

namespace gem::test {

struct Finished {
  int exit_code = -1;  ///< 128 + signal if a signal ended it
  std::string output;  ///< stdout and stderr
};

/// Runs a program to its end. It is killed after timeout_s.
Finished RunProgram(const std::vector<std::string>& argv, int timeout_s = 600);

/// `gem` with these arguments.
Finished Gem(std::vector<std::string> arguments, int timeout_s = 600);

/// A gem_server on free ports, unless --listen is given; stopped with SIGTERM at the latest when it
/// goes out of scope.
class ServerProcess {
 public:
  explicit ServerProcess(std::vector<std::string> arguments = {});
  ~ServerProcess();
  ServerProcess(const ServerProcess&) = delete;
  ServerProcess& operator=(const ServerProcess&) = delete;

  const std::string& address() const { return address_; }
  const std::string& metrics_address() const { return metrics_address_; }
  /// SIGTERM, then the exit code and how long it took.
  int Stop(double& seconds);

 private:
  pid_t pid_ = -1;
  int stdout_ = -1;
  std::string address_;
  std::string metrics_address_;
};

/// A new empty directory under the system's temporary directory, removed with its contents at the
/// end.
class ScratchDir {
 public:
  ScratchDir();
  ~ScratchDir();
  ScratchDir(const ScratchDir&) = delete;
  ScratchDir& operator=(const ScratchDir&) = delete;
  std::string File(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace gem::test
