// A report as Markdown for people and as JSON for programs.
#pragma once

#include <string>
#include <vector>

#include "client/evaluation/report.h"

namespace gem::evaluation {

/// A section: heading, method, figures with aims and the paper's numbers, tables, plots (linked as
/// NAME/PLOT.svg below `plot_dir`), notes, what was skipped.
std::string Markdown(const Report& report, const std::string& plot_dir);

/// One object: name, title, figures, tables, plots, notes, skipped.
std::string Json(const Report& report);

}  // namespace gem::evaluation
