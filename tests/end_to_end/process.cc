#include "tests/end_to_end/process.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <regex>
#include <thread>

#include "core/base/check.h"

extern char** environ;

namespace gem::test {
namespace {

using Clock = std::chrono::steady_clock;

pid_t Spawn(const std::vector<std::string>& argv, int& output) {
  int ends[2];
  GEM_CHECK(pipe2(ends, O_CLOEXEC) == 0);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDERR_FILENO);
  std::vector<char*> pointers;
  for (const std::string& argument : argv) pointers.push_back(const_cast<char*>(argument.c_str()));
  pointers.push_back(nullptr);
  pid_t pid = -1;
  const int error = posix_spawn(&pid, argv[0].c_str(), &actions, nullptr, pointers.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  close(ends[1]);
  GEM_CHECK(error == 0);
  output = ends[0];
  return pid;
}

int ExitCode(int status) {
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

/// Reads until `enough` says so, the other end closes or the deadline passes. False after the
/// deadline.
template <typename Enough>
bool Read(int file, std::string& text, Clock::time_point deadline, Enough enough) {
  while (!enough(text)) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now()).count();
    if (left <= 0) return false;
    pollfd ready{file, POLLIN, 0};
    if (poll(&ready, 1, static_cast<int>(left)) <= 0) continue;
    char buffer[4096];
    const ssize_t got = read(file, buffer, sizeof(buffer));
    if (got <= 0) return true;
    text.append(buffer, static_cast<std::size_t>(got));
  }
  return true;
}

}  // namespace

Finished RunProgram(const std::vector<std::string>& argv, int timeout_s) {
  int output = -1;
  const pid_t pid = Spawn(argv, output);
  Finished result;
  const auto deadline = Clock::now() + std::chrono::seconds(timeout_s);
  if (!Read(output, result.output, deadline, [](const std::string&) { return false; })) {
    kill(pid, SIGKILL);
    result.output += "\n(killed: it ran longer than " + std::to_string(timeout_s) + " s)\n";
  }
  int status = 0;
  waitpid(pid, &status, 0);
  close(output);
  result.exit_code = ExitCode(status);
  return result;
}

Finished Gem(std::vector<std::string> arguments, int timeout_s) {
  arguments.insert(arguments.begin(), GEM_BINARY);
  return RunProgram(arguments, timeout_s);
}

ServerProcess::ServerProcess(std::vector<std::string> arguments) {
  std::vector<std::string> argv = {GEM_SERVER_BINARY, "--metrics_listen", "127.0.0.1:0"};
  if (std::find(arguments.begin(), arguments.end(), "--listen") == arguments.end())
    argv.insert(argv.end(), {"--listen", "127.0.0.1:0"});
  argv.insert(argv.end(), arguments.begin(), arguments.end());
  pid_ = Spawn(argv, stdout_);
  static const std::regex kReady(R"(gem_server ready grpc=(\S+) metrics=(\S+)\n)");
  std::string text;
  std::smatch match;
  Read(stdout_, text, Clock::now() + std::chrono::seconds(30),
       [&](const std::string& so_far) { return std::regex_search(so_far, match, kReady); });
  if (!std::regex_search(text, match, kReady)) {
    fprintf(stderr, "gem_server did not get ready: %s\n", text.c_str());
    GEM_CHECK(false);
  }
  address_ = match[1];
  metrics_address_ = match[2];
  // Logs must not fill the pipe and stop the server.
  std::thread([file = stdout_] {
    char buffer[4096];
    while (read(file, buffer, sizeof(buffer)) > 0) {
    }
    close(file);
  }).detach();
}

int ServerProcess::Stop(double& seconds) {
  const auto start = Clock::now();
  kill(pid_, SIGTERM);
  int status = 0;
  waitpid(pid_, &status, 0);
  pid_ = -1;
  seconds = std::chrono::duration<double>(Clock::now() - start).count();
  return ExitCode(status);
}

ServerProcess::~ServerProcess() {
  double seconds = 0;
  if (pid_ > 0) Stop(seconds);
}

ScratchDir::ScratchDir() {
  std::string name = std::filesystem::temp_directory_path() / "gem-test-XXXXXX";
  GEM_CHECK(mkdtemp(name.data()) != nullptr);
  path_ = name;
}

ScratchDir::~ScratchDir() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace gem::test
