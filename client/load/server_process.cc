#include "client/load/server_process.h"

#include <fcntl.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <system_error>

#include "absl/strings/str_cat.h"

extern char** environ;

namespace gem::load {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::chrono::seconds kStart_max{30};
constexpr char kReady[] = "gem_server ready grpc=";

/// The words after kReady up to the next blank; empty as long as the line is not whole.
std::string AddressIn(const std::string& text) {
  const std::size_t begin = text.find(kReady);
  if (begin == std::string::npos) return "";
  const std::size_t first = begin + sizeof(kReady) - 1;
  const std::size_t last = text.find(' ', first);
  return last == std::string::npos ? "" : text.substr(first, last - first);
}

std::string WaitForAddress(int output) {
  const Clock::time_point deadline = Clock::now() + kStart_max;
  std::string text;
  while (AddressIn(text).empty()) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now()).count();
    if (left <= 0) return "";
    pollfd ready{output, POLLIN, 0};
    if (poll(&ready, 1, static_cast<int>(left)) <= 0) continue;
    std::array<char, 4096> buffer{};
    const ssize_t got = read(output, buffer.data(), buffer.size());
    if (got <= 0) return "";
    text.append(buffer.data(), static_cast<std::size_t>(got));
  }
  return AddressIn(text);
}

}  // namespace

absl::StatusOr<std::unique_ptr<ServerProcess>> ServerProcess::Start(
    const std::vector<std::string>& options) {
  std::error_code error;
  const fs::path binary = fs::read_symlink("/proc/self/exe", error).parent_path() / "gem_server";
  if (error || !fs::exists(binary, error))
    return absl::NotFoundError("no gem_server beside this program");
  std::vector<std::string> words = {binary.string(), "--listen", "127.0.0.1:0", "--metrics_listen",
                                    "127.0.0.1:0"};
  words.insert(words.end(), options.begin(), options.end());
  return Run(std::move(words));
}

absl::StatusOr<std::unique_ptr<ServerProcess>> ServerProcess::StartOwn(
    const std::vector<std::string>& arguments) {
  std::vector<std::string> words = {"/proc/self/exe"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  return Run(std::move(words));
}

absl::StatusOr<std::unique_ptr<ServerProcess>> ServerProcess::Run(std::vector<std::string> words) {
  std::array<int, 2> ends{};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) return absl::UnavailableError("no pipe");
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  std::vector<char*> argv;
  argv.reserve(words.size() + 1);
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  pid_t pid = -1;
  const int failed = posix_spawn(&pid, words[0].c_str(), &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  close(ends[1]);
  if (failed != 0) {
    close(ends[0]);
    return absl::UnavailableError(absl::StrCat(words[0], " does not start: error ", failed));
  }
  std::unique_ptr<ServerProcess> server(new ServerProcess(pid, ends[0]));
  server->address_ = WaitForAddress(ends[0]);
  if (server->address_.empty())
    return absl::UnavailableError(absl::StrCat(words[0], " does not become ready"));
  return server;
}

ServerProcess::~ServerProcess() {
  Stop();
  close(output_);
}

int ServerProcess::Stop() {
  if (exit_code_.has_value()) return *exit_code_;
  kill(pid_, SIGTERM);
  int status = 0;
  while (waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
  }
  exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  return *exit_code_;
}

}  // namespace gem::load
