// The terminal that a full-screen command draws on: its size, its keys, and how it was before.
#pragma once

#include <termios.h>

#include <chrono>
#include <memory>
#include <string>

#include "client/cli/top_screen.h"

namespace gem::client {

/// What ended a wait.
enum class TerminalEvent { kTimeout, kQuit, kResized };

/// Draws on the alternate screen while it lives, and leaves the terminal as it was, also on Ctrl-C
/// and SIGTERM. Make it before any other thread: they must not get these signals. Not thread-safe.
class Terminal {
 public:
  /// Null if standard input and output are not both a terminal.
  static std::unique_ptr<Terminal> Open();
  ~Terminal();
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  ScreenSize size() const;
  /// Replaces what is shown; the text ends with \n and fits the size.
  void Draw(const std::string& text);
  /// Until a key or signal says to quit (q, Ctrl-C, SIGTERM, SIGHUP), the size changes, or the time
  /// is over.
  TerminalEvent WaitUntil(std::chrono::steady_clock::time_point deadline);

 private:
  Terminal(const termios& before, int signals);
  TerminalEvent ReadKeys();
  TerminalEvent ReadSignal();

  const termios before_;
  const int signals_;  ///< signalfd
};

}  // namespace gem::client
