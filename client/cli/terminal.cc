#include "client/cli/terminal.h"

#include <poll.h>
#include <sys/ioctl.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>

#include "absl/strings/str_replace.h"

namespace gem::client {
namespace {

constexpr char kEnter[] = "\x1b[?1049h\x1b[?25l";  // alternate screen, no cursor
constexpr char kLeave[] = "\x1b[?25h\x1b[?1049l";
constexpr char kCtrlC = '\x03';

void Write(const std::string& text) {
  std::fwrite(text.data(), 1, text.size(), stdout);
  std::fflush(stdout);
}

}  // namespace

std::unique_ptr<Terminal> Terminal::Open() {
  if (isatty(STDIN_FILENO) == 0 || isatty(STDOUT_FILENO) == 0) return nullptr;
  termios before{};
  if (tcgetattr(STDIN_FILENO, &before) != 0) return nullptr;
  sigset_t set;
  sigemptyset(&set);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGWINCH}) sigaddset(&set, signal);
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  const int signals = signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK);
  if (signals < 0) return nullptr;
  return std::unique_ptr<Terminal>(new Terminal(before, signals));
}

Terminal::Terminal(const termios& before, int signals) : before_(before), signals_(signals) {
  termios raw = before;
  raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  tcsetattr(STDIN_FILENO, TCSAFLUSH, &raw);
  Write(kEnter);
}

Terminal::~Terminal() {
  Write(kLeave);
  tcsetattr(STDIN_FILENO, TCSAFLUSH, &before_);
  close(signals_);
}

ScreenSize Terminal::size() const {
  winsize size{};
  if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0)
    return {80, 24};
  return {size.ws_col, size.ws_row};
}

void Terminal::Draw(const std::string& text) {
  // From the upper left corner; what an earlier frame left behind is erased line by line, so that
  // nothing flickers. No newline at the end: it would scroll a full screen.
  std::string lines = absl::StrReplaceAll(text, {{"\n", "\x1b[K\r\n"}});
  lines.resize(lines.size() - std::min<std::size_t>(lines.size(), 2));
  Write("\x1b[H" + lines + "\x1b[J");
}

TerminalEvent Terminal::WaitUntil(std::chrono::steady_clock::time_point deadline) {
  while (true) {
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now())
            .count();
    std::array<pollfd, 2> ready = {{{STDIN_FILENO, POLLIN, 0}, {signals_, POLLIN, 0}}};
    if (poll(ready.data(), ready.size(), static_cast<int>(std::max<std::int64_t>(left, 0))) == 0)
      return TerminalEvent::kTimeout;
    TerminalEvent event = TerminalEvent::kTimeout;
    if (ready[1].revents != 0) event = ReadSignal();
    if (event == TerminalEvent::kTimeout && ready[0].revents != 0) event = ReadKeys();
    if (event != TerminalEvent::kTimeout) return event;
  }
}

TerminalEvent Terminal::ReadKeys() {
  std::array<char, 64> keys{};
  const ssize_t got = read(STDIN_FILENO, keys.data(), keys.size());
  if (got <= 0) return TerminalEvent::kQuit;  // the terminal has gone
  const auto end = keys.begin() + got;
  const bool quit =
      std::any_of(keys.begin(), end, [](char k) { return k == 'q' || k == 'Q' || k == kCtrlC; });
  return quit ? TerminalEvent::kQuit : TerminalEvent::kTimeout;
}

TerminalEvent Terminal::ReadSignal() {
  signalfd_siginfo signal{};
  if (read(signals_, &signal, sizeof(signal)) != sizeof(signal)) return TerminalEvent::kTimeout;
  return signal.ssi_signo == SIGWINCH ? TerminalEvent::kResized : TerminalEvent::kQuit;
}

}  // namespace gem::client
