#include "client/formats/esri_ascii.h"

#include <cmath>
#include <limits>
#include <optional>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "client/formats/text_file.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

constexpr double kNoData = -9999;
constexpr std::uint64_t kFileBytesMax = std::uint64_t{4} << 30;

/// Words of a text one by one, and the line that each stands in.
class WordReader {
 public:
  explicit WordReader(absl::string_view text) : text_(text) {}

  /// Empty at the end.
  absl::string_view Next() {
    std::size_t begin = 0;
    while (begin < text_.size() && absl::ascii_isspace(text_[begin]))
      if (text_[begin++] == '\n') ++line_;
    std::size_t end = begin;
    while (end < text_.size() && !absl::ascii_isspace(text_[end])) ++end;
    const absl::string_view word = text_.substr(begin, end - begin);
    text_.remove_prefix(end);
    return word;
  }
  /// Where the last word stands, from 1.
  std::size_t line() const { return line_; }

 private:
  absl::string_view text_;
  std::size_t line_ = 1;
};

struct Header {
  std::optional<double> columns, rows, cell_size_m, no_data;
  std::optional<double> x_corner_m, y_corner_m, x_center_m, y_center_m;

  std::optional<double>* Find(absl::string_view key) {
    if (absl::EqualsIgnoreCase(key, "ncols")) return &columns;
    if (absl::EqualsIgnoreCase(key, "nrows")) return &rows;
    if (absl::EqualsIgnoreCase(key, "cellsize")) return &cell_size_m;
    if (absl::EqualsIgnoreCase(key, "nodata_value")) return &no_data;
    if (absl::EqualsIgnoreCase(key, "xllcorner")) return &x_corner_m;
    if (absl::EqualsIgnoreCase(key, "yllcorner")) return &y_corner_m;
    if (absl::EqualsIgnoreCase(key, "xllcenter")) return &x_center_m;
    if (absl::EqualsIgnoreCase(key, "yllcenter")) return &y_center_m;
    return nullptr;
  }
};

/// Reads the header; `reader` is left before the first height.
absl::StatusOr<Header> ReadHeader(const std::string& path, WordReader& reader) {
  Header header;
  while (true) {
    const WordReader before = reader;
    const absl::string_view key = reader.Next();
    std::optional<double>* field = header.Find(key);
    if (field == nullptr) {
      double value = 0;
      // The first number begins the heights.
      if (key.empty() || ParseNumber(key, value)) {
        reader = before;
        return header;
      }
      return absl::InvalidArgumentError(
          absl::StrCat(path, ":", reader.line(), ": unknown header key \"", key.substr(0, 32),
                       "\", want ncols, nrows, xllcorner, yllcorner, cellsize or NODATA_value"));
    }
    const absl::string_view text = reader.Next();
    double value = 0;
    if (!ParseNumber(text, value))
      return absl::InvalidArgumentError(absl::StrCat(path, ":", reader.line(), ": ", key, " is \"",
                                                     text.substr(0, 32), "\", want a number"));
    *field = value;
  }
}

absl::Status MissingKey(const std::string& path, absl::string_view key) {
  return absl::InvalidArgumentError(absl::StrCat(path, ": the header lacks ", key));
}

absl::Status CheckCount(const std::string& path, absl::string_view key, double value) {
  if (value >= 1 && value <= 1e6 && value == std::floor(value)) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": ", key, " is ", value, ", want a whole number in [1, 1000000]"));
}

/// The grid without its cells.
absl::StatusOr<EsriAsciiGrid> MakeGrid(const std::string& path, const Header& header) {
  if (!header.columns) return MissingKey(path, "ncols");
  if (!header.rows) return MissingKey(path, "nrows");
  if (!header.cell_size_m) return MissingKey(path, "cellsize");
  if (!header.x_corner_m && !header.x_center_m) return MissingKey(path, "xllcorner");
  if (!header.y_corner_m && !header.y_center_m) return MissingKey(path, "yllcorner");
  GEM_RETURN_IF_ERROR(CheckCount(path, "ncols", *header.columns));
  GEM_RETURN_IF_ERROR(CheckCount(path, "nrows", *header.rows));
  const double cell_size_m = *header.cell_size_m;
  if (!(cell_size_m > 0 && cell_size_m < 1e6))
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": cellsize is ", cell_size_m, ", want (0, 1000000)"));
  if (*header.columns * *header.rows > static_cast<double>(kEsriAsciiCellsMax))
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", *header.columns, " x ", *header.rows,
                                                   " cells, want at most ", kEsriAsciiCellsMax));
  EsriAsciiGrid grid;
  grid.columns = static_cast<std::int32_t>(*header.columns);
  grid.rows = static_cast<std::int32_t>(*header.rows);
  grid.cell_size_m = cell_size_m;
  grid.x_m_min = header.x_corner_m ? *header.x_corner_m : *header.x_center_m - cell_size_m / 2;
  grid.y_m_min = header.y_corner_m ? *header.y_corner_m : *header.y_center_m - cell_size_m / 2;
  if (!std::isfinite(grid.x_m_min) || !std::isfinite(grid.y_m_min))
    return absl::InvalidArgumentError(absl::StrCat(path, ": the lower left corner is not finite"));
  return grid;
}

}  // namespace

absl::StatusOr<EsriAsciiGrid> ReadEsriAscii(const std::string& path) {
  GEM_ASSIGN_OR_RETURN(const std::string contents, ReadFile(path, kFileBytesMax));
  WordReader reader(contents);
  GEM_ASSIGN_OR_RETURN(const Header header, ReadHeader(path, reader));
  GEM_ASSIGN_OR_RETURN(EsriAsciiGrid grid, MakeGrid(path, header));
  const std::size_t num_cells =
      static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows);
  // A cell takes two bytes of text at least: a short file must not make us allocate a large grid.
  if (num_cells > contents.size() / 2 + 1)
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": ends before ", grid.columns, " x ", grid.rows, " values were read"));
  grid.values.resize(num_cells);
  grid.valid.resize(num_cells);
  for (std::int32_t row = grid.rows - 1; row >= 0; --row) {
    for (std::int32_t column = 0; column < grid.columns; ++column) {
      const absl::string_view word = reader.Next();
      if (word.empty())
        return absl::InvalidArgumentError(
            absl::StrCat(path, ":", reader.line(), ": the file ends in row ", grid.rows - row,
                         ", column ", column + 1, ", want ", grid.rows, " x ", grid.columns));
      double value = 0;
      if (!ParseNumber(word, value))
        return absl::InvalidArgumentError(absl::StrCat(path, ":", reader.line(), ": \"",
                                                       word.substr(0, 32), "\" is not a number"));
      // NaN as "no data" is met in the wild.
      if (std::isnan(value) || (header.no_data && value == *header.no_data)) continue;
      if (!(std::abs(value) <= static_cast<double>(std::numeric_limits<float>::max())))
        return absl::InvalidArgumentError(absl::StrCat(
            path, ":", reader.line(), ": ", word.substr(0, 32), " is too large for a height"));
      const std::size_t index = static_cast<std::size_t>(row) * grid.columns + column;
      grid.values[index] = static_cast<float>(value);
      grid.valid[index] = 1;
    }
  }
  if (!reader.Next().empty())
    return absl::InvalidArgumentError(absl::StrCat(path, ":", reader.line(), ": more than ",
                                                   grid.columns, " x ", grid.rows, " values"));
  return grid;
}

std::string ToEsriAscii(const EsriAsciiGrid& grid) {
  std::string text = absl::StrFormat(
      "ncols %d\nnrows %d\nxllcorner %.17g\nyllcorner %.17g\ncellsize %.17g\nNODATA_value %g\n",
      grid.columns, grid.rows, grid.x_m_min, grid.y_m_min, grid.cell_size_m, kNoData);
  for (std::int32_t row = grid.rows - 1; row >= 0; --row) {
    for (std::int32_t column = 0; column < grid.columns; ++column) {
      const std::size_t index = static_cast<std::size_t>(row) * grid.columns + column;
      if (column > 0) text += ' ';
      if (grid.valid[index] != 0) {
        absl::StrAppendFormat(&text, "%.9g", grid.values[index]);
      } else {
        text += "-9999";
      }
    }
    text += '\n';
  }
  return text;
}

}  // namespace gem
