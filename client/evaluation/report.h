// What an experiment found, as data: tables, curves, figures with their aims. Knows no file format.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace gem::evaluation {

/// Cells are text, so that an experiment decides how many digits mean something.
struct Table {
  std::string title = {};
  std::vector<std::string> columns = {};
  std::vector<std::vector<std::string>> rows = {};  ///< each as long as `columns`
};

struct Series {
  std::string name = {};
  std::vector<double> x = {};
  std::vector<double> y = {};  ///< as long as x
};

/// Curves over one pair of axes.
struct Plot {
  std::string name = {};  ///< of the file, without its ending; unique in an experiment
  std::string title = {};
  std::string x_label = {};  ///< with unit
  std::string y_label = {};  ///< with unit
  std::vector<Series> series = {};
  bool points = false;  ///< dots instead of lines
};

/// One number that the experiment is about.
struct Figure {
  std::string name = {};
  double value = 0;
  std::string unit = {};
  std::optional<double> at_most = {};   ///< the aim
  std::optional<double> at_least = {};  ///< the aim
  std::optional<double> paper = {};     ///< what the paper reports for the same thing

  bool missed() const {
    return !(value <= at_most.value_or(value)) || !(value >= at_least.value_or(value));
  }
};

struct Report {
  std::string name = {};   ///< of the experiment: "cubes"
  std::string title = {};  ///< "Table I: six cubes"
  /// What was run, on what, how the figures are computed. Markdown, one or more paragraphs.
  std::string method = {};
  std::vector<Figure> figures = {};
  std::vector<Table> tables = {};
  std::vector<Plot> plots = {};
  /// What a reader should know of the figures: misses and their reasons. Markdown.
  std::vector<std::string> notes = {};
  /// Parts that were left out, and why: "kitti_raw_0001: no --data".
  std::vector<std::string> skipped = {};
};

}  // namespace gem::evaluation
