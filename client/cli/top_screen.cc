#include "client/cli/top_screen.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numeric>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "client/cli/json.h"

namespace gem::client {
namespace {

/// The period of scans, and the objective of a correction.
constexpr double kLate_s = 0.1;
/// Live maps are published twice a second.
constexpr double kStale_s = 2;
/// From here on stages and calls lie beside each other.
constexpr int kColumnsForTwo = 144;
constexpr int kGap = 3;

enum class Tone { kPlain, kTitle, kHead, kDim, kGood, kWarning, kBad };

absl::string_view EscapeOf(Tone tone) {
  switch (tone) {
    case Tone::kTitle:
      return "\x1b[1;7m";
    case Tone::kHead:
      return "\x1b[1m";
    case Tone::kDim:
      return "\x1b[2m";
    case Tone::kGood:
      return "\x1b[32m";
    case Tone::kWarning:
      return "\x1b[33m";
    case Tone::kBad:
      return "\x1b[1;31m";
    case Tone::kPlain:
      break;
  }
  return "";
}

struct Cell {
  Cell(std::string text_in, Tone tone_in = Tone::kPlain)  // NOLINT(google-explicit-constructor)
      : text(std::move(text_in)), tone(tone_in) {}
  std::string text;
  Tone tone;
};

/// One line: pieces one behind the other.
using Line = std::vector<Cell>;

int WidthOf(const Line& line) {
  return std::accumulate(line.begin(), line.end(), 0, [](int width, const Cell& cell) {
    return width + static_cast<int>(cell.text.size());
  });
}

/// Cut at `width`, and filled up to it.
Line Fitted(const Line& line, int width) {
  Line fitted;
  int left = width;
  for (const Cell& cell : line) {
    if (left == 0) break;
    const int taken = std::min(left, static_cast<int>(cell.text.size()));
    fitted.emplace_back(cell.text.substr(0, static_cast<std::size_t>(taken)), cell.tone);
    left -= taken;
  }
  fitted.emplace_back(std::string(static_cast<std::size_t>(left), ' '));
  return fitted;
}

std::string Text(const Line& line, bool color) {
  std::string text;
  for (const Cell& cell : line) {
    if (color && cell.tone != Tone::kPlain) {
      absl::StrAppend(&text, EscapeOf(cell.tone), cell.text, "\x1b[0m");
    } else {
      absl::StrAppend(&text, cell.text);
    }
  }
  if (!color) text.erase(text.find_last_not_of(' ') + 1);
  return text;
}

// Numbers.

/// Three digits are enough to watch; "-" where there is nothing to say.
std::string Short(double value) {
  if (!std::isfinite(value)) return "-";
  const double size = std::abs(value);
  if (size >= 9.995e8) return absl::StrFormat("%.3gG", value / 1e9);
  if (size >= 9.995e5) return absl::StrFormat("%.3gM", value / 1e6);
  if (size >= 99'950) return absl::StrFormat("%.0fk", value / 1e3);
  if (size >= 99.95) return absl::StrFormat("%.0f", value);
  if (size >= 9.995) return absl::StrFormat("%.1f", value);
  return size == 0 ? "0" : absl::StrFormat("%.2f", value);
}

std::string Bytes(double bytes) {
  if (bytes < 1024) return absl::StrFormat("%.0f B", bytes);
  const char* unit = "KiB";
  double value = bytes / 1024;
  for (const char* larger : {"MiB", "GiB", "TiB"}) {
    if (value < 999.5) break;
    value /= 1024;
    unit = larger;
  }
  return absl::StrFormat("%.*f %s", value < 9.995 ? 2 : value < 99.95 ? 1 : 0, value, unit);
}

std::string Age(double seconds) {
  const auto s = static_cast<std::int64_t>(seconds);
  if (s < 60) return absl::StrFormat("%d s", s);
  if (s < 3600) return absl::StrFormat("%d min %02d s", s / 60, s % 60);
  if (s < 86'400) return absl::StrFormat("%d h %02d min", s / 3600, s / 60 % 60);
  return absl::StrFormat("%d d %02d h", s / 86'400, s / 3600 % 24);
}

Cell Lag(double seconds, double seconds_bad) {
  std::string text = seconds == 0   ? "0"
                     : seconds >= 1 ? absl::StrCat(Short(seconds), " s")
                                    : absl::StrCat(Short(seconds * 1e3), " ms");
  return {std::move(text), seconds > seconds_bad ? Tone::kBad : Tone::kPlain};
}

Cell CountOfBad(double rate_hz) { return {Short(rate_hz), rate_hz > 0 ? Tone::kBad : Tone::kDim}; }

// Tables.

/// A part of the screen: the names of columns, rows.
struct Table {
  struct Column {
    std::string name;
    bool is_text = false;  ///< to the left, and cut if there is no room
  };
  std::vector<Column> columns;
  std::vector<Line> rows;  ///< a cell a column
};

constexpr int kNumberWidthMin = 7;
constexpr int kTextWidthMin = 8;
constexpr int kColumnGap = 2;

/// As wide as what is in them; texts give way, the widest first, until the table fits.
std::vector<int> ColumnWidths(const Table& table, int columns) {
  std::vector<int> widths;
  for (std::size_t i = 0; i < table.columns.size(); ++i) {
    std::size_t width = table.columns[i].name.size();
    for (const Line& row : table.rows) width = std::max(width, row[i].text.size());
    widths.push_back(std::max(static_cast<int>(width),
                              table.columns[i].is_text ? kTextWidthMin : kNumberWidthMin));
  }
  int excess = std::accumulate(widths.begin(), widths.end(), -columns) +
               kColumnGap * (static_cast<int>(widths.size()) - 1);
  for (; excess > 0; --excess) {
    int* widest = nullptr;
    for (std::size_t i = 0; i < widths.size(); ++i)
      if (table.columns[i].is_text && widths[i] > (widest == nullptr ? kTextWidthMin : *widest))
        widest = &widths[i];
    if (widest == nullptr) break;
    --*widest;
  }
  return widths;
}

Line RowOf(const Table& table, const std::vector<int>& widths, const Line& cells) {
  Line line;
  for (std::size_t i = 0; i < widths.size(); ++i) {
    const auto width = static_cast<std::size_t>(widths[i]);
    std::string text = cells[i].text.substr(0, width);
    const std::string blanks(width - text.size(), ' ');
    text = table.columns[i].is_text ? text + blanks : blanks + text;
    if (i > 0) line.emplace_back(std::string(kColumnGap, ' '));
    line.emplace_back(std::move(text), cells[i].tone);
  }
  return line;
}

/// Head and at most rows_max rows; the last of them says how many are missing.
std::vector<Line> LinesOf(const Table& table, int rows_max, int columns) {
  const std::vector<int> widths = ColumnWidths(table, columns);
  Line head;
  for (const Table::Column& column : table.columns) head.emplace_back(column.name, Tone::kHead);
  std::vector<Line> lines = {RowOf(table, widths, head)};
  if (table.rows.empty() || rows_max <= 0) return lines;
  const auto num_rows = static_cast<int>(table.rows.size());
  const int num_shown = num_rows <= rows_max ? num_rows : rows_max - 1;
  for (int i = 0; i < num_shown; ++i)
    lines.push_back(RowOf(table, widths, table.rows[static_cast<std::size_t>(i)]));
  if (num_shown < num_rows)
    lines.push_back({Cell(absl::StrCat("... ", num_rows - num_shown, " more"), Tone::kDim)});
  return lines;
}

Table RobotTable(const TopRates& rates) {
  Table table{{{"ROBOT", true},
               {"map", true},
               {"session", true},
               {"state", true},
               {"scans/s"},
               {"refused/s"},
               {"queue"},
               {"lag"}},
              {}};
  for (const RobotRates& robot : rates.robots) {
    const Cell state =
        robot.connected ? Cell("streaming", Tone::kGood) : Cell("no stream", Tone::kWarning);
    table.rows.push_back({robot.robot, robot.map, robot.session, state, Short(robot.scans_hz),
                          CountOfBad(robot.refused_hz),
                          Bytes(static_cast<double>(robot.queue_bytes)),
                          Lag(robot.lag_s, kLate_s)});
  }
  return table;
}

Table MapTable(const TopRates& rates) {
  Table table{{{"MAP", true},
               {"submaps"},
               {"points"},
               {"points/s"},
               {"tiles"},
               {"memory"},
               {"revision"},
               {"rev/s"},
               {"behind"},
               {"corrections"}},
              {}};
  for (const MapRates& map : rates.maps)
    table.rows.push_back({map.map, absl::StrCat(map.num_submaps), absl::StrCat(map.num_points),
                          Short(map.points_hz), absl::StrCat(map.num_tiles),
                          Bytes(static_cast<double>(map.submap_bytes)), absl::StrCat(map.revision),
                          Short(map.revisions_hz), Lag(map.staleness_s, kStale_s),
                          absl::StrCat(map.num_corrections_waiting)});
  return table;
}

Table StageTable(const TopRates& rates) {
  Table table{{{"STAGE", true}, {"runs/s"}, {"mean ms"}, {"~p50 ms"}, {"~p99 ms"}, {"max ms"}}, {}};
  for (const StageRates& stage : rates.stages) {
    const bool late = stage.mapper == "service" && stage.times.p99 > kLate_s * 1e3;
    table.rows.push_back({absl::StrCat(stage.mapper, " ", stage.stage),
                          Short(stage.runs_hz),
                          Short(stage.times.mean),
                          Short(stage.times.p50),
                          {Short(stage.times.p99), late ? Tone::kBad : Tone::kPlain},
                          Short(stage.times.max)});
  }
  return table;
}

Table CallTable(const TopRates& rates) {
  Table table{{{"CALL", true},
               {"calls/s"},
               {"failed/s"},
               {"active"},
               {"mean ms"},
               {"~p99 ms"},
               {"in/s"},
               {"out/s"}},
              {}};
  for (const CallRates& call : rates.calls)
    table.rows.push_back({call.method, Short(call.calls_hz), CountOfBad(call.failed_hz),
                          absl::StrCat(call.num_active), Short(call.times.mean),
                          Short(call.times.p99), Bytes(call.received_bytes_hz),
                          Bytes(call.sent_bytes_hz)});
  return table;
}

std::vector<Line> HeadOf(const TopRates& rates, const TopView& view) {
  Line title = {{absl::StrFormat(" gem_server %s  %s  %s  up %s", rates.server_version, view.server,
                                 rates.backend, Age(rates.uptime_s)),
                 Tone::kTitle}};
  const std::string hint = absl::StrFormat("last %s s ", Short(rates.interval_s));
  const int blanks = view.size.columns - WidthOf(title) - static_cast<int>(hint.size());
  title.emplace_back(std::string(static_cast<std::size_t>(std::max(blanks, 1)), ' ') + hint,
                     Tone::kTitle);
  const Line process = {{absl::StrFormat(
      " cpu %s cores  memory %s  %d threads  %d files  tiles %s/s, absent %s/s",
      Short(rates.cpu_cores), Bytes(static_cast<double>(rates.process.resident_bytes)),
      rates.process.num_threads, rates.process.num_open_files, Short(rates.tiles_hz),
      Short(rates.absent_tiles_hz))}};
  const auto num_streaming = std::count_if(rates.robots.begin(), rates.robots.end(),
                                           [](const RobotRates& robot) { return robot.connected; });
  const Line sessions = {{absl::StrFormat(
      " sessions %d streaming, %d without a stream, %d ended", num_streaming,
      static_cast<std::int64_t>(rates.robots.size()) - num_streaming, rates.num_ended_sessions)}};
  return {title, process, sessions};
}

/// How many rows each table gets of `left`: all, or shares that leave nobody behind.
std::vector<int> Shares(const std::vector<int>& wanted, int left) {
  std::vector<int> shares(wanted.size(), 0);
  for (bool given = true; given && left > 0;) {
    given = false;
    for (std::size_t i = 0; i < wanted.size() && left > 0; ++i) {
      if (shares[i] == wanted[i]) continue;
      ++shares[i];
      --left;
      given = true;
    }
  }
  return shares;
}

std::vector<Line> Beside(const std::vector<Line>& left, const std::vector<Line>& right) {
  int width = 0;
  for (const Line& line : left) width = std::max(width, WidthOf(line));
  std::vector<Line> lines;
  for (std::size_t i = 0; i < std::max(left.size(), right.size()); ++i) {
    Line line = Fitted(i < left.size() ? left[i] : Line{}, width + kGap);
    if (i < right.size()) line.insert(line.end(), right[i].begin(), right[i].end());
    lines.push_back(std::move(line));
  }
  return lines;
}

int Rows(const Table& table) { return static_cast<int>(table.rows.size()); }

/// All tables, with a blank line before each.
std::vector<Line> BodyOf(const TopRates& rates, int columns, int rows) {
  const Table robots = RobotTable(rates), maps = MapTable(rates), stages = StageTable(rates),
              calls = CallTable(rates);
  const bool two = columns >= kColumnsForTwo;
  const std::vector<int> wanted =
      two ? std::vector<int>{Rows(robots), Rows(maps), std::max(Rows(stages), Rows(calls))}
          : std::vector<int>{Rows(robots), Rows(maps), Rows(stages), Rows(calls)};
  // Blank line and head of each.
  const int frame = 2 * static_cast<int>(wanted.size());
  const std::vector<int> shares = rows == 0 ? wanted : Shares(wanted, rows - frame);
  std::vector<std::vector<Line>> parts = {LinesOf(robots, shares[0], columns),
                                          LinesOf(maps, shares[1], columns)};
  if (two) {
    parts.push_back(
        Beside(LinesOf(stages, shares[2], columns), LinesOf(calls, shares[2], columns)));
  } else {
    parts.push_back(LinesOf(stages, shares[2], columns));
    parts.push_back(LinesOf(calls, shares[3], columns));
  }
  std::vector<Line> body;
  for (const std::vector<Line>& part : parts) {
    body.push_back({});
    body.insert(body.end(), part.begin(), part.end());
  }
  return body;
}

// JSON.

std::string Json(const TimesMs& times) {
  return absl::StrCat("{\"mean\":", JsonNumber(times.mean), ",\"p50\":", JsonNumber(times.p50),
                      ",\"p99\":", JsonNumber(times.p99), ",\"max\":", JsonNumber(times.max), "}");
}

std::string Json(const RobotRates& robot) {
  return absl::StrCat(
      "{\"map\":", JsonText(robot.map), ",\"robot\":", JsonText(robot.robot),
      ",\"session\":", JsonText(robot.session), ",\"connected\":", JsonBool(robot.connected),
      ",\"scans_hz\":", JsonNumber(robot.scans_hz),
      ",\"refused_hz\":", JsonNumber(robot.refused_hz), ",\"queue_bytes\":", robot.queue_bytes,
      ",\"lag_s\":", JsonNumber(robot.lag_s), "}");
}

std::string Json(const MapRates& map) {
  return absl::StrCat("{\"id\":", JsonText(map.map), ",\"num_submaps\":", map.num_submaps,
                      ",\"num_points\":", map.num_points, ",\"num_tiles\":", map.num_tiles,
                      ",\"submap_bytes\":", map.submap_bytes, ",\"revision\":", map.revision,
                      ",\"revisions_hz\":", JsonNumber(map.revisions_hz),
                      ",\"points_hz\":", JsonNumber(map.points_hz),
                      ",\"staleness_s\":", JsonNumber(map.staleness_s),
                      ",\"num_corrections_waiting\":", map.num_corrections_waiting, "}");
}

std::string Json(const StageRates& stage) {
  return absl::StrCat("{\"mapper\":", JsonText(stage.mapper), ",\"stage\":", JsonText(stage.stage),
                      ",\"runs_hz\":", JsonNumber(stage.runs_hz), ",\"ms\":", Json(stage.times),
                      "}");
}

std::string Json(const CallRates& call) {
  return absl::StrCat(
      "{\"method\":", JsonText(call.method), ",\"calls_hz\":", JsonNumber(call.calls_hz),
      ",\"failed_hz\":", JsonNumber(call.failed_hz), ",\"num_active\":", call.num_active,
      ",\"received_bytes_hz\":", JsonNumber(call.received_bytes_hz),
      ",\"sent_bytes_hz\":", JsonNumber(call.sent_bytes_hz), ",\"ms\":", Json(call.times), "}");
}

template <typename Items>
std::string JsonList(const Items& items) {
  return JsonArray(items, [](const auto& item) { return Json(item); });
}

}  // namespace

std::string TopScreen(const TopRates& rates, const TopView& view) {
  const int rows = view.size.rows;
  std::vector<Line> lines = HeadOf(rates, view);
  const int taken = static_cast<int>(lines.size()) + (view.notice.empty() ? 0 : 1);
  const std::vector<Line> body =
      BodyOf(rates, view.size.columns, rows == 0 ? 0 : std::max(rows - taken, 1));
  lines.insert(lines.end(), body.begin(), body.end());
  if (rows > 0 && static_cast<int>(lines.size()) > rows)
    lines.resize(static_cast<std::size_t>(rows));
  if (!view.notice.empty()) {
    if (static_cast<int>(lines.size()) == rows) lines.pop_back();
    lines.push_back({Cell(view.notice, Tone::kBad)});
  }
  std::string text;
  for (const Line& line : lines)
    absl::StrAppend(&text, Text(Fitted(line, view.size.columns), view.color), "\n");
  return text;
}

std::string TopJson(const TopRates& rates) {
  return absl::StrCat(
      "{\"server_version\":", JsonText(rates.server_version),
      ",\"backend\":", JsonText(rates.backend), ",\"uptime_s\":", JsonNumber(rates.uptime_s),
      ",\"interval_s\":", JsonNumber(rates.interval_s),
      ",\"cpu_cores\":", JsonNumber(rates.cpu_cores),
      ",\"resident_bytes\":", rates.process.resident_bytes,
      ",\"num_threads\":", rates.process.num_threads,
      ",\"num_open_files\":", rates.process.num_open_files,
      ",\"tiles_hz\":", JsonNumber(rates.tiles_hz),
      ",\"absent_tiles_hz\":", JsonNumber(rates.absent_tiles_hz),
      ",\"num_ended_sessions\":", rates.num_ended_sessions, ",\"robots\":", JsonList(rates.robots),
      ",\"maps\":", JsonList(rates.maps), ",\"stages\":", JsonList(rates.stages),
      ",\"calls\":", JsonList(rates.calls), "}\n");
}

}  // namespace gem::client
