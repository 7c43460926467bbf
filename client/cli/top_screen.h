// How `gem top` looks: rates as lines of text of a given size. A pure function; the terminal itself
// is terminal.h's.
#pragma once

#include <string>

#include "client/cli/top_rates.h"

namespace gem::client {

struct ScreenSize {
  int columns = 132;
  int rows = 0;  ///< 0: as many as it takes
};

struct TopView {
  ScreenSize size;
  bool color = false;  ///< ANSI escapes for emphasis
  std::string server;  ///< its address
  std::string notice;  ///< shown in the last line; for what went wrong
};

/// Lines that end with \n, none wider than size.columns, at most size.rows of them. What does not
/// fit is counted ("3 more").
std::string TopScreen(const TopRates& rates, const TopView& view);

/// One object in one line: the same numbers.
std::string TopJson(const TopRates& rates);

}  // namespace gem::client
