#include "client/evaluation/report_text.h"

#include <cmath>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

namespace gem::evaluation {
namespace {

std::string Row(const std::vector<std::string>& cells) {
  return absl::StrCat("| ", absl::StrJoin(cells, " | "), " |\n");
}

std::string AimOf(const Figure& figure) {
  std::vector<std::string> parts;
  if (figure.at_least.has_value())
    parts.push_back(absl::StrFormat("at least %.4g", *figure.at_least));
  if (figure.at_most.has_value()) parts.push_back(absl::StrFormat("at most %.4g", *figure.at_most));
  if (parts.empty()) return "";
  return absl::StrCat(absl::StrJoin(parts, ", "), figure.missed() ? " **missed**" : "");
}

std::string MarkdownTable(const Table& table) {
  std::string text = absl::StrCat("\n*", table.title, "*\n\n", Row(table.columns));
  absl::StrAppend(&text, Row(std::vector<std::string>(table.columns.size(), "---")));
  for (const std::vector<std::string>& row : table.rows) absl::StrAppend(&text, Row(row));
  return text;
}

std::string Quoted(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    switch (c) {
      case '"':
        quoted += "\\\"";
        break;
      case '\\':
        quoted += "\\\\";
        break;
      case '\n':
        quoted += "\\n";
        break;
      default:
        if (static_cast<unsigned char>(c) < 0x20)
          absl::StrAppendFormat(&quoted, "\\u%04x", static_cast<unsigned>(c));
        else
          quoted += c;
    }
  }
  return quoted + '"';
}

// JSON has no word for what is not a number.
std::string Number(double value) {
  return std::isfinite(value) ? absl::StrFormat("%.9g", value) : "null";
}
std::string Number(std::optional<double> value) {
  return value.has_value() ? Number(*value) : "null";
}

template <typename T, typename ToText>
std::string List(const std::vector<T>& items, ToText to_text) {
  std::vector<std::string> texts;
  texts.reserve(items.size());
  for (const T& item : items) texts.push_back(to_text(item));
  return absl::StrCat("[", absl::StrJoin(texts, ","), "]");
}

std::string Strings(const std::vector<std::string>& items) { return List(items, Quoted); }
std::string Numbers(const std::vector<double>& items) {
  return List(items, [](double value) { return Number(value); });
}

std::string JsonOf(const Figure& figure) {
  return absl::StrCat("{\"name\":", Quoted(figure.name), ",\"value\":", Number(figure.value),
                      ",\"unit\":", Quoted(figure.unit), ",\"at_most\":", Number(figure.at_most),
                      ",\"at_least\":", Number(figure.at_least),
                      ",\"paper\":", Number(figure.paper),
                      ",\"missed\":", figure.missed() ? "true" : "false", "}");
}
std::string JsonOf(const Table& table) {
  return absl::StrCat("{\"title\":", Quoted(table.title), ",\"columns\":", Strings(table.columns),
                      ",\"rows\":", List(table.rows, Strings), "}");
}
std::string JsonOf(const Series& series) {
  return absl::StrCat("{\"name\":", Quoted(series.name), ",\"x\":", Numbers(series.x),
                      ",\"y\":", Numbers(series.y), "}");
}
std::string JsonOf(const Plot& plot) {
  return absl::StrCat("{\"name\":", Quoted(plot.name), ",\"title\":", Quoted(plot.title),
                      ",\"x_label\":", Quoted(plot.x_label), ",\"y_label\":", Quoted(plot.y_label),
                      ",\"series\":", List(plot.series, [](const Series& s) { return JsonOf(s); }),
                      "}");
}

}  // namespace

std::string Markdown(const Report& report, const std::string& plot_dir) {
  std::string text = absl::StrCat("## ", report.title, "\n\n`gem evaluate ", report.name, "`\n\n",
                                  report.method, "\n");
  if (!report.figures.empty()) {
    absl::StrAppend(&text, "\n", Row({"figure", "ours", "unit", "aim", "paper"}),
                    Row({"---", "---", "---", "---", "---"}));
    for (const Figure& figure : report.figures)
      absl::StrAppend(
          &text, Row({figure.name, absl::StrFormat("%.4g", figure.value), figure.unit,
                      AimOf(figure), figure.paper ? absl::StrFormat("%.4g", *figure.paper) : ""}));
  }
  for (const Table& table : report.tables) absl::StrAppend(&text, MarkdownTable(table));
  for (const Plot& plot : report.plots)
    absl::StrAppend(&text, "\n![", plot.title, "](", plot_dir, "/", report.name, "/", plot.name,
                    ".svg)\n");
  for (const std::string& note : report.notes) absl::StrAppend(&text, "\n", note, "\n");
  for (const std::string& part : report.skipped) absl::StrAppend(&text, "\nSkipped: ", part, "\n");
  return text;
}

std::string Json(const Report& report) {
  return absl::StrCat(
      "{\"name\":", Quoted(report.name), ",\"title\":", Quoted(report.title),
      ",\"figures\":", List(report.figures, [](const Figure& f) { return JsonOf(f); }),
      ",\"tables\":", List(report.tables, [](const Table& t) { return JsonOf(t); }),
      ",\"plots\":", List(report.plots, [](const Plot& p) { return JsonOf(p); }),
      ",\"notes\":", Strings(report.notes), ",\"skipped\":", Strings(report.skipped), "}\n");
}

}  // namespace gem::evaluation
