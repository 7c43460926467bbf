#include "core/global/path_check.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

/// A part that is a whole number of steps long, but for rounding, takes so many.
constexpr double kRoundingSteps = 1e-6;

/// Between two looks at whether the answer is still wanted.
constexpr std::size_t kCellsBetweenLooks = 16'384;

/// Steps that a length takes, at least one.
double StepsOf(double length_m, double step_m) {
  return std::max(1.0, std::ceil(length_m / step_m - kRoundingSteps));
}

/// Farthest that a turn on the spot moves anything, per radian.
double ReachOf(const Footprint& footprint) {
  const auto* rectangle = std::get_if<Rectangle>(&footprint);
  if (rectangle == nullptr) return 0;  // a disc turns within itself
  return std::hypot(std::max(std::abs(rectangle->x_m_min), std::abs(rectangle->x_m_max)),
                    std::max(std::abs(rectangle->y_m_min), std::abs(rectangle->y_m_max)));
}

/// A straight part of the path, and the turn at its beginning.
struct Part {
  Place from;
  Place to;
  Heading heading;
  double length_m = 0;
  double num_steps = 0;  ///< whole; as a double, as it may be huge
  double turn_rad = 0;   ///< from the heading of the part before
  double num_turns = 0;
};

/// Parts of no length are left out: they have no heading.
std::vector<Part> PartsOf(const PathQuestion& question, double step_m) {
  const double reach_m = ReachOf(question.footprint);
  std::vector<Part> parts;
  for (std::size_t i = 1; i < question.path.size(); ++i) {
    Part part{question.path[i - 1], question.path[i], {}, 0, 0, 0, 0};
    const double dx_m = part.to.x_m - part.from.x_m;
    const double dy_m = part.to.y_m - part.from.y_m;
    part.length_m = std::hypot(dx_m, dy_m);
    if (part.length_m == 0) continue;
    part.heading = {dx_m / part.length_m, dy_m / part.length_m};
    part.num_steps = StepsOf(part.length_m, step_m);
    if (!parts.empty() && reach_m > 0) {
      const Heading& before = parts.back().heading;
      part.turn_rad = std::atan2(before.x * part.heading.y - before.y * part.heading.x,
                                 before.x * part.heading.x + before.y * part.heading.y);
      if (part.turn_rad != 0) part.num_turns = StepsOf(std::abs(part.turn_rad) * reach_m, step_m);
    }
    parts.push_back(part);
  }
  return parts;
}

void AddTurn(const Part& part, const Heading& before, double distance_m,
             std::vector<PathStep>& steps) {
  const auto num_turns = static_cast<int>(part.num_turns);
  for (int turn = 1; turn < num_turns; ++turn) {
    const double angle_rad = part.turn_rad * turn / num_turns;
    const double c = std::cos(angle_rad);
    const double s = std::sin(angle_rad);
    steps.push_back({part.from,
                     part.from,
                     {before.x * c - before.y * s, before.x * s + before.y * c},
                     distance_m});
  }
  if (num_turns > 0) steps.push_back({part.from, part.from, part.heading, distance_m});
}

void AddStraight(const Part& part, double distance_m, std::vector<PathStep>& steps) {
  const auto num_steps = static_cast<int>(part.num_steps);
  Place from = part.from;
  for (int step = 1; step <= num_steps; ++step) {
    const double share = static_cast<double>(step) / num_steps;
    const Place to = step == num_steps
                         ? part.to
                         : Place{part.from.x_m + (part.to.x_m - part.from.x_m) * share,
                                 part.from.y_m + (part.to.y_m - part.from.y_m) * share};
    steps.push_back({from, to, part.heading, distance_m + part.length_m * share});
    from = to;
  }
}

/// True if a is worse than b: by state, then by traversability where both have one.
bool Worse(const GroundSample& a, const GroundSample& b) {
  if (a.state != b.state) return a.state > b.state;
  return a.annotated() && a.traversability < b.traversability;
}

/// What is under the footprint of one sample.
class SampleTally {
 public:
  void Add(CellIndex cell, const GroundSample& ground) {
    ++num_cells_;
    if (num_cells_ == 1 || Worse(ground, worst_)) {
      worst_ = ground;
      worst_cell_ = cell;
    }
    if (ground.annotated()) {
      traversability_min_ = num_annotated_ == 0
                                ? ground.traversability
                                : std::min(traversability_min_, ground.traversability);
      ++num_annotated_;
    }
    slope_rad_max_ = std::max(slope_rad_max_, ground.slope_rad.value_or(0));
  }

  void Fill(PathSample& sample) const {
    sample.worst = worst_.state;
    sample.traversability_min = traversability_min_;
    sample.slope_rad_max = slope_rad_max_;
    sample.unknown_share = static_cast<float>(static_cast<double>(num_cells_ - num_annotated_) /
                                              static_cast<double>(num_cells_));
  }

  const GroundSample& worst() const { return worst_; }
  CellIndex worst_cell() const { return worst_cell_; }

 private:
  std::size_t num_cells_ = 0;
  std::size_t num_annotated_ = 0;
  float traversability_min_ = 0;
  float slope_rad_max_ = 0;
  GroundSample worst_;
  CellIndex worst_cell_;
};

/// What an answer may cost.
class CellBudget {
 public:
  CellBudget(std::size_t num_samples, Abandoned abandoned)
      : num_samples_(num_samples), abandoned_(abandoned) {}

  /// Before so many cells are looked at: a single step may be kilometres long.
  absl::Status Spend(std::size_t num_cells) {
    num_cells_ += num_cells;
    if (num_cells_ > kPathCells_max)
      return absl::InvalidArgumentError(absl::StrCat(
          "path is such that its ", num_samples_, " samples cover more than ", kPathCells_max,
          " cells in all, want a shorter one, a longer step_m or a smaller footprint"));
    if (num_cells_ >= next_look_) {
      next_look_ = num_cells_ + kCellsBetweenLooks;
      if (abandoned_()) return absl::CancelledError("nobody waits for the answer any more");
    }
    return absl::OkStatus();
  }

 private:
  const std::size_t num_samples_;
  const Abandoned abandoned_;
  std::size_t num_cells_ = 0;
  std::size_t next_look_ = 0;
};

absl::StatusOr<SampleTally> Examine(const SweptFootprint& footprint, TerrainReader& reader,
                                    CellBudget& budget) {
  SampleTally tally;
  absl::Status status;
  footprint.ForEachRun(reader.cell_size_m(), [&](const CellRun& run) {
    status = budget.Spend(run.num_cells());
    if (!status.ok()) return false;
    for (std::int32_t column = run.first_column; column <= run.last_column; ++column)
      tally.Add({column, run.row}, reader.AtCell({column, run.row}));
    return true;
  });
  if (!status.ok()) return status;
  return tally;
}

}  // namespace

absl::StatusOr<std::vector<PathStep>> WalkPath(const PathQuestion& question, double cell_size_m) {
  const double step_m = question.step_m > 0 ? question.step_m : cell_size_m;
  const std::vector<Part> parts = PartsOf(question, step_m);
  double num_samples = 1;
  for (const Part& part : parts) num_samples += part.num_steps + part.num_turns;
  if (num_samples > static_cast<double>(kPathSamples_max))
    return absl::InvalidArgumentError(
        absl::StrCat("step_m is ", question.step_m, ", which makes ", num_samples,
                     " samples of the path, want at most ", kPathSamples_max));
  std::vector<PathStep> steps;
  steps.reserve(static_cast<std::size_t>(num_samples));
  const Place& start = question.path.front();
  steps.push_back({start, start, parts.empty() ? Heading{} : parts.front().heading, 0});
  double distance_m = 0;
  for (const Part& part : parts) {
    AddTurn(part, steps.back().heading, distance_m, steps);
    AddStraight(part, distance_m, steps);
    distance_m += part.length_m;
  }
  return steps;
}

absl::StatusOr<PathCheck> CheckPath(const MapSnapshot& map, const PathQuestion& question,
                                    Abandoned abandoned) {
  TerrainReader reader(map);
  const double cell_size_m = reader.cell_size_m();
  GEM_ASSIGN_OR_RETURN(const std::vector<PathStep> steps, WalkPath(question, cell_size_m));
  PathCheck check;
  check.samples.reserve(steps.size());
  check.free = true;
  CellBudget budget(steps.size(), abandoned);
  for (const PathStep& step : steps) {
    GEM_ASSIGN_OR_RETURN(
        const SampleTally tally,
        Examine({question.footprint, step.from, step.to, step.heading}, reader, budget));
    PathSample& sample = check.samples.emplace_back();
    sample.distance_m = step.distance_m;
    sample.position = step.to;
    sample.ground = reader.AtPlace(step.to);
    tally.Fill(sample);
    if (check.samples.size() == 1 || Worse(tally.worst(), check.worst.ground))
      check.worst = {{CenterOf(tally.worst_cell().x, cell_size_m),
                      CenterOf(tally.worst_cell().y, cell_size_m)},
                     tally.worst(),
                     check.samples.size() - 1};
    check.free = check.free && sample.worst == GroundState::kFree;
    if (check.free) check.free_distance_m = step.distance_m;
  }
  return check;
}

}  // namespace gem
