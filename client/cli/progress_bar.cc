#include "client/cli/progress_bar.h"

#include <unistd.h>

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace gem::client {
namespace {

constexpr std::chrono::milliseconds kTerminalPeriod{100};
constexpr std::chrono::seconds kLinePeriod{5};
constexpr std::size_t kTerminalWidth = 79;
constexpr std::size_t kLineWidth = 60;

}  // namespace

std::string ProgressLine(const std::string& name, const Progress& progress, double elapsed_s,
                         std::size_t width) {
  const auto [done, done_before, total] = progress;
  const double rate_hz = elapsed_s > 0 ? static_cast<double>(done - done_before) / elapsed_s : 0;
  std::string tail = absl::StrFormat(" %d/%d  %.1f scans/s", done, total, rate_hz);
  if (done < total && rate_hz > 0)
    absl::StrAppendFormat(&tail, "  ETA %.0f s", static_cast<double>(total - done) / rate_hz);
  const std::string head = absl::StrCat(name.substr(0, 24), " ");
  const std::size_t taken = head.size() + tail.size() + 2;
  const std::size_t bar_width = width > taken ? width - taken : 0;
  const std::size_t filled = total == 0 ? 0 : bar_width * std::min(done, total) / total;
  std::string bar(filled, '=');
  if (filled < bar_width) bar += '>';
  bar.resize(bar_width, ' ');
  return absl::StrCat(head, "[", bar, "]", tail);
}

ProgressBar::ProgressBar(std::string name, const Progress& progress)
    : name_(std::move(name)),
      terminal_(isatty(STDERR_FILENO) != 0),
      begin_(Clock::now()),
      progress_(progress),
      shown_(begin_) {}

ProgressBar::~ProgressBar() {
  if (open_line_) std::fputc('\n', stderr);
}

void ProgressBar::Show(std::uint64_t done) {
  const Clock::time_point now = Clock::now();
  progress_.done = done;
  const bool last = done == progress_.total;
  if (!last && now - shown_ < (terminal_ ? Clock::duration(kTerminalPeriod) : kLinePeriod)) return;
  shown_ = now;
  const double elapsed_s = std::chrono::duration<double>(now - begin_).count();
  if (terminal_) {
    // Erases what a longer line left behind.
    std::fprintf(stderr, "\r\x1b[K%s",
                 ProgressLine(name_, progress_, elapsed_s, kTerminalWidth).c_str());
    open_line_ = true;
  } else {
    std::fprintf(stderr, "%s\n", ProgressLine(name_, progress_, elapsed_s, kLineWidth).c_str());
  }
  std::fflush(stderr);
}

}  // namespace gem::client
