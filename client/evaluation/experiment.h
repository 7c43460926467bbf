// The experiments of the paper's section VII, by name. Each is one function in a file of its own.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/evaluation/report.h"

namespace gem::evaluation {

struct Settings {
  /// Real recordings as `data/tools/unpack` lays them out; nothing: those parts are skipped, and
  /// the report says so.
  std::optional<std::filesystem::path> data_dir;
  /// Share of the full size, (0, 1]: 1 is what EVALUATION.md shows; less is for trying out, and
  /// the report says so.
  double scale = 1;
  int threads = 2;
  std::uint64_t seed = 1;
  /// Called now and then with what is being done and how far it is, [0, 1]; never empty.
  std::function<void(const std::string& what, double share)> progress = [](const std::string&,
                                                                           double) {};
};

struct Experiment {
  std::string name;     ///< for `gem evaluate NAME`
  std::string summary;  ///< one line, for --help
  std::function<absl::StatusOr<Report>(const Settings&)> run;
};

/// In the order of the paper.
const std::vector<Experiment>& Experiments();

}  // namespace gem::evaluation
