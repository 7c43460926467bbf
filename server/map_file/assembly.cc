#include "server/map_file/assembly.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/grid/cell_index.h"
#include "core/local/local_map_options.h"
#include "proto/wire/scalar.h"

namespace gem::map_file {
namespace {

constexpr std::int64_t kNsPerMs = 1'000'000;
/// Cells of K and of O, far beyond kCoordinateMax_m at the smallest cell.
constexpr std::int32_t kCell_max = 1 << 28;
constexpr float kElevation_m_max = 4e6f;
constexpr float kVariance_m2_max = 1e12f;
constexpr std::uint32_t kParts_max = 64;
constexpr std::uint64_t kCellsOfSubmap_max =
    std::uint64_t{kSubmapSideCells_max} * static_cast<std::uint64_t>(kSubmapSideCells_max);
constexpr std::uint8_t kAllStates = kCellKnown | kCellAnnotated | kCellColored;

// What the parts of a map take in memory.
constexpr std::uint64_t kSessionMemory = sizeof(SessionState) + 512;
/// Twice: poses are copied into the mapper.
constexpr std::uint64_t kPoseMemory = 2 * sizeof(StampedPose<Odom, Base>);
/// With ids that are too long to be within it.
constexpr std::uint64_t kContributorMemory = sizeof(Contributor) + 2 * 64;

template <typename A, typename B>
void ReadPoses(ByteReader& from, std::uint64_t num_left, std::vector<StampedPose<A, B>>& poses) {
  const auto n = from.Within<std::uint32_t>(
      "count", 1,
      static_cast<std::uint32_t>(std::min<std::uint64_t>(num_left, kRawBytes_max / kPoseBytes)));
  const std::vector<std::int64_t> stamps_ns = from.Stamps("stamp_ns", n);
  std::vector<double> columns[7];
  for (std::vector<double>& column : columns) column = from.Column<double>("pose", n);
  if (!from.ok()) return;
  for (std::size_t i = 0; i < n; ++i) {
    if (!poses.empty() && stamps_ns[i] <= poses.back().stamp_ns)
      return from.Refuse(absl::StrCat("stamp_ns[", i, "]"), absl::StrCat(stamps_ns[i]),
                         absl::StrCat("more than ", poses.back().stamp_ns));
    double numbers[7];
    for (std::size_t k = 0; k < 7; ++k) numbers[k] = columns[k][i];
    from.CheckTransform(absl::StrCat("pose[", i, "]"), numbers);
    if (!from.ok()) return;
    poses.push_back({stamps_ns[i],
                     {Eigen::Quaterniond(numbers[3], numbers[0], numbers[1], numbers[2]),
                      Eigen::Vector3d(numbers[4], numbers[5], numbers[6])}});
  }
}

/// What a section says of n cells.
class CellColumns {
 public:
  CellColumns(std::size_t n, std::size_t num_sources, ByteReader& from)
      : elevation_m_(
            from.ColumnWithin<float>("elevation_m", n, -kElevation_m_max, kElevation_m_max)) {
    for (std::size_t k = 0; k < 6; ++k) {
      const bool diagonal = k == 0 || k == 3 || k == 5;
      covariance_m2_[k] = from.ColumnWithin<float>(
          "covariance_m2", n, diagonal ? 0 : -kVariance_m2_max, kVariance_m2_max);
    }
    rgba_ = from.Column<std::uint32_t>("rgba", n);
    traversability_ = from.Column<std::uint8_t>("traversability", n);
    stamp_ms_ = from.ColumnWithin<std::int64_t>("stamp_ms", n, 0, wire::kStamp_nsMax / kNsPerMs);
    if (num_sources > 1)
      source_ = from.ColumnWithin<std::uint16_t>("source", n, 0,
                                                 static_cast<std::uint16_t>(num_sources - 1));
    for (std::size_t i = 0; i < rgba_.size(); ++i)
      if (const std::uint8_t state = StateOf(i);
          (state & kCellKnown) == 0 || (state & ~kAllStates) != 0)
        from.Refuse(absl::StrCat("state[", i, "]"), absl::StrCat(+state),
                    "a known cell's, 1, 3, 5 or 7");
  }

  SubmapCell At(std::size_t i) const {
    SubmapCell cell;
    cell.elevation_m = elevation_m_[i];
    for (std::size_t k = 0; k < 6; ++k) cell.covariance_m2[k] = covariance_m2_[k][i];
    cell.traversability = static_cast<float>(traversability_[i]) / 255.0f;
    cell.rgba = (rgba_[i] & 0xffffffu) | 0xff000000u;
    cell.stamp_ns = stamp_ms_[i] * kNsPerMs;
    cell.state = StateOf(i);
    return cell;
  }
  SourceIndex source(std::size_t i) const { return source_.empty() ? SourceIndex{0} : source_[i]; }

 private:
  std::uint8_t StateOf(std::size_t i) const { return static_cast<std::uint8_t>(rgba_[i] >> 24); }

  std::vector<float> elevation_m_;
  std::array<std::vector<float>, 6> covariance_m2_;
  std::vector<std::uint32_t> rgba_;
  std::vector<std::uint8_t> traversability_;
  std::vector<std::int64_t> stamp_ms_;
  std::vector<std::uint16_t> source_;  ///< empty: all have the only one
};

}  // namespace

bool Assembly::Spend(std::uint64_t bytes, ByteReader& from) {
  if (!from.ok()) return false;
  if (bytes <= memory_bytes_left()) {
    memory_bytes_ += bytes;
    return true;
  }
  too_much_ = true;
  from.Refuse("the map", absl::StrCat("larger than ", limits_.memory_bytes_max, " bytes of memory"),
              "at most import_memory_bytes_max");
  return false;
}

SectionType Assembly::Due() const {
  if (!has_map_) return SectionType::kMap;
  if (piece_.has_value())
    return piece_->sources.size() < piece_->num_sources ? SectionType::kSources
                                                        : SectionType::kCells;
  if (local_map_ != nullptr) return SectionType::kLocalCells;
  if (odometry_left_ > 0) return SectionType::kOdometry;
  if (corrections_left_ > 0) return SectionType::kCorrections;
  if (submap_left_) return SectionType::kSubmap;
  if (local_map_left_) return SectionType::kLocalMap;
  if (state_.sessions.size() < num_sessions_) return SectionType::kSession;
  return num_pieces_ > 0 ? SectionType::kSubmap : SectionType::kEnd;
}

absl::Status Assembly::Take(SectionType type, absl::string_view raw) {
  ByteReader from(raw);
  if (type != Due()) {
    from.Refuse("the section", NameOf(type), NameOf(Due()));
    return from.status();
  }
  ++num_sections_;
  switch (type) {
    case SectionType::kMap:
      TakeMap(from);
      break;
    case SectionType::kSession:
      TakeSession(from);
      break;
    case SectionType::kOdometry:
      TakeOdometry(from);
      break;
    case SectionType::kCorrections:
      TakeCorrections(from);
      break;
    case SectionType::kSubmap:
      TakeSubmap(from);
      break;
    case SectionType::kSources:
      TakeSources(from);
      break;
    case SectionType::kCells:
      TakeCells(from);
      break;
    case SectionType::kLocalMap:
      TakeLocalMap(from);
      break;
    case SectionType::kLocalCells:
      TakeLocalCells(from);
      break;
    case SectionType::kEnd:
      TakeEnd(from);
      break;
  }
  from.CheckEnd();
  if (too_much_) return absl::ResourceExhaustedError(from.status().message());
  return from.status();
}

absl::StatusOr<MapState> Assembly::Finish() {
  if (!complete_) return absl::InvalidArgumentError("the file is cut off, want END");
  return std::move(state_);
}

void Assembly::TakeMap(ByteReader& from) {
  GlobalMapOptions& options = state_.options;
  state_.version.epoch = from.Number<std::uint64_t>("epoch");
  state_.version.revision = from.Number<std::uint64_t>("revision");
  options.cell_size_m = from.Number<float>("cell_size_m");
  options.submap_length_m = from.Number<float>("submap_length_m");
  options.traversable_only = from.Flag("traversable_only");
  options.traversability_free = from.Number<float>("traversability_free");
  options.gate_sigmas = from.Number<float>("gate_sigmas");
  options.merge_overlap_min = from.Number<float>("merge_overlap_min");
  options.merge_fuse_time_s_max = from.Number<double>("merge_fuse_time_s_max");
  options.merge_height_difference_m_max = from.Number<float>("merge_height_difference_m_max");
  options.odometry_poses_max = limits_.odometry_poses_max;
  options.compose_threads = limits_.compose_threads;
  state_.last_submap_id = from.Within<std::uint64_t>("last_submap_id", 0,
                                                     std::numeric_limits<std::uint64_t>::max() / 2);
  num_sessions_ = from.Within<std::uint32_t>("num_sessions", 0,
                                             static_cast<std::uint32_t>(limits_.sessions_max));
  num_pieces_ = from.Number<std::uint32_t>("num_submaps");
  has_map_ = true;
  if (!from.ok()) return;
  if (const absl::Status valid = Validate(options); !valid.ok()) from.Fail(valid);
}

void Assembly::TakeSession(ByteReader& from) {
  SessionState session;
  session.session = from.Id("session");
  session.robot = from.Id("robot");
  const auto flags = from.Within<std::uint8_t>("flags", 0, 15);
  session.ended = (flags & kSessionEnded) != 0;
  session.retracted = (flags & kSessionRetracted) != 0;
  session.trajectory.initial_T_G_O = from.Transform<Global, Odom>("map_from_odom");
  odometry_left_ = from.Within<std::uint64_t>(
      "num_odometry", 0, static_cast<std::uint64_t>(limits_.odometry_poses_max));
  // Stamps of corrections that the session has reached; each is a stamp of its time.
  corrections_left_ = from.Number<std::uint64_t>("num_corrections");
  submap_left_ = (flags & kSessionHasSubmap) != 0;
  local_map_left_ = (flags & kSessionHasLocalMap) != 0;
  if (from.ok() && !ids_.insert(session.session).second)
    from.Refuse("session", session.session, "an id that is not taken");
  if (!Spend(kSessionMemory, from)) return;
  state_.sessions.push_back(std::move(session));
}

void Assembly::TakeOdometry(ByteReader& from) {
  auto& poses = state_.sessions.back().trajectory.odometry;
  if (!Spend(from.remaining() / kPoseBytes * kPoseMemory, from)) return;
  const std::size_t before = poses.size();
  ReadPoses(from, odometry_left_, poses);
  odometry_left_ -= poses.size() - before;
}

void Assembly::TakeCorrections(ByteReader& from) {
  auto& poses = state_.sessions.back().trajectory.corrections;
  if (!Spend(from.remaining() / kPoseBytes * kPoseMemory, from)) return;
  const std::size_t before = poses.size();
  ReadPoses(from, corrections_left_, poses);
  corrections_left_ -= poses.size() - before;
}

void Assembly::TakeSubmap(ByteReader& from) {
  Piece piece;
  piece.id = SubmapId{from.Within<std::uint64_t>("id", 1, state_.last_submap_id)};
  piece.role = static_cast<SubmapRole>(from.Within<std::uint8_t>("role", 0, 2));
  const auto session = from.Number<std::uint32_t>("session");
  if (session >= state_.sessions.size())
    from.Refuse("session", absl::StrCat(session),
                absl::StrCat("less than ", state_.sessions.size()));
  piece.origin.anchor_stamp_ns = from.Stamp("anchor_stamp_ns");
  piece.origin.T_O_K = from.Transform<Odom, Submap>("odom_from_submap");
  if (from.Flag("has_left"))
    piece.left_T_G_K = from.Transform<Global, Submap>("left.map_from_submap");
  if (!from.ok()) return;
  piece.origin.id = piece.id;
  piece.origin.session = state_.sessions[session].session;
  piece.origin.robot = state_.sessions[session].robot;
  piece.origin.cell_size_m = state_.options.cell_size_m;
  CheckPlace(piece, from);
  piece_ = std::move(piece);
  TakeParts(from);
  piece_->num_sources = from.Within<std::uint32_t>("num_sources", 1, kSources_max);
  piece_->num_cells = from.Within<std::uint64_t>("num_cells", 1, kCellsOfSubmap_max);
}

// Where it stands among the others.
void Assembly::CheckPlace(const Piece& piece, ByteReader& from) {
  const auto id = static_cast<std::uint64_t>(piece.id);
  const bool grows = piece.role == SubmapRole::kGrowing;
  if (grows != submap_left_)
    return from.Refuse("role", absl::StrCat(static_cast<int>(piece.role)),
                       submap_left_ ? "0, a growing submap" : "1 or 2, a finished submap");
  if (grows && piece.origin.session != state_.sessions.back().session)
    return from.Refuse("session", piece.origin.session, "the session before it");
  if (growing_.contains(id)) return from.Refuse("id", absl::StrCat(id), "one that is not taken");
  const bool second = piece.role == SubmapRole::kHidden && !state_.submaps.empty() &&
                      state_.submaps.back().id == piece.id &&
                      state_.submaps.back().hidden == nullptr;
  if (second) return;
  if (!grows && !state_.submaps.empty() && piece.id <= state_.submaps.back().id)
    return from.Refuse(
        "id", absl::StrCat(id),
        absl::StrCat("more than ", static_cast<std::uint64_t>(state_.submaps.back().id)));
  // Two of one session with one anchor would have no order.
  if (!anchors_.emplace(piece.origin.anchor_stamp_ns, piece.origin.session).second)
    return from.Refuse("anchor_stamp_ns", absl::StrCat(piece.origin.anchor_stamp_ns),
                       "one that no other submap of the session has");
}

void Assembly::TakeParts(ByteReader& from) {
  const auto n = from.Within<std::uint32_t>("num_parts", 1, kParts_max);
  for (std::uint32_t i = 0; from.ok() && i < n; ++i) {
    double middle[3];
    for (double& coordinate : middle) {
      coordinate = from.Number<double>("part.middle");
      if (!(std::abs(coordinate) <= kPoseCoordinate_m_max))
        from.Refuse(absl::StrCat("parts[", i, "].middle"), absl::StrCat(coordinate),
                    absl::StrCat("at most ", kPoseCoordinate_m_max, " in magnitude"));
    }
    const auto spread_m2 = from.Number<double>("part.spread_m2");
    const auto num_cells = from.Number<double>("part.num_cells");
    if (!(spread_m2 >= 0 && spread_m2 <= kVariance_m2_max))
      from.Refuse(absl::StrCat("parts[", i, "].spread_m2"), absl::StrCat(spread_m2),
                  absl::StrCat("0 to ", kVariance_m2_max));
    if (!(num_cells >= 1 && num_cells <= static_cast<double>(kCellsOfSubmap_max)))
      from.Refuse(absl::StrCat("parts[", i, "].num_cells"), absl::StrCat(num_cells),
                  absl::StrCat("1 to ", kCellsOfSubmap_max));
    piece_->parts.push_back({Point<Submap>(middle[0], middle[1], middle[2]), spread_m2, num_cells,
                             from.Stamp("part.stamp_ns")});
  }
}

void Assembly::TakeSources(ByteReader& from) {
  const auto n = from.Within<std::uint32_t>(
      "count", 1, static_cast<std::uint32_t>(piece_->num_sources - piece_->sources.size()));
  for (std::uint32_t i = 0; from.ok() && i < n; ++i) {
    const auto size = from.Within<std::uint32_t>("set.count", 1, num_sessions_);
    if (!Spend(sizeof(ContributorSet) + size * kContributorMemory, from)) return;
    ContributorSet set;
    for (std::uint32_t k = 0; k < size; ++k) {
      // A growing submap comes before later sessions, and has its own session only.
      const auto session = from.Within<std::uint32_t>(
          "set.session", 0, static_cast<std::uint32_t>(state_.sessions.size() - 1));
      if (!from.ok()) return;
      set.push_back({state_.sessions[session].session, state_.sessions[session].robot});
    }
    if (!std::is_sorted(set.begin(), set.end()) ||
        std::adjacent_find(set.begin(), set.end()) != set.end())
      return from.Refuse("set", "not sorted", "sessions sorted by id, without repeats");
    piece_->sources.push_back(std::move(set));
  }
}

void Assembly::TakeCells(ByteReader& from) {
  const std::vector<CellIndex> cells = TakeGroups(from);
  if (!from.ok()) return;
  const std::size_t n = cells.size();
  if (n > piece_->num_cells - piece_->cells.size())
    return from.Refuse("cells", absl::StrCat(piece_->cells.size() + n),
                       absl::StrCat("num_cells, ", piece_->num_cells));
  CellColumns columns(n, piece_->num_sources, from);
  if (!Spend(n * sizeof(KeyedSubmapCell), from)) return;
  piece_->cell_bytes += n * sizeof(KeyedSubmapCell);
  for (std::size_t i = 0; i < n; ++i)
    piece_->cells.push_back({cells[i], columns.At(i), columns.source(i)});
  if (piece_->cells.size() == piece_->num_cells) FinishPiece(from);
}

std::vector<CellIndex> Assembly::TakeGroups(ByteReader& from) {
  const auto num_groups = from.Within<std::uint32_t>("num_groups", 1, kRawBytes_max / kGroupBytes);
  const auto x = from.ColumnWithin<std::int32_t>("group.x", num_groups, -kCell_max, kCell_max);
  const auto y = from.ColumnWithin<std::int32_t>("group.y", num_groups, -kCell_max, kCell_max);
  std::array<std::vector<std::uint64_t>, 4> occupied;
  for (auto& word : occupied) word = from.Column<std::uint64_t>("group.occupied", num_groups);
  std::vector<CellIndex> cells;
  for (std::size_t g = 0; from.ok() && g < num_groups; ++g) {
    if (!TakeGroup({x[g], y[g]}, from)) break;
    const std::size_t before = cells.size();
    for (std::size_t w = 0; w < 4; ++w)
      for (std::uint64_t word = occupied[w][g]; word != 0; word &= word - 1) {
        const int bit = static_cast<int>(w) * 64 + std::countr_zero(word);
        cells.push_back({x[g] + (bit & (kGroupCells - 1)), y[g] + (bit >> kGroupBits)});
      }
    if (cells.size() == before)
      from.Refuse(absl::StrCat("group.occupied[", g, "]"), "zero", "a cell at least");
    // A bit is cheap; what it claims to be there is not.
    if (const std::size_t cells_max = from.remaining() / kCellBytes_min; cells.size() > cells_max)
      from.Refuse(absl::StrCat("group.occupied[", g, "]"), absl::StrCat("cell ", cells.size()),
                  absl::StrCat("the ", cells_max, " that are there"));
  }
  return cells;
}

// Groups come by row, then column: none twice. All lie near each other.
bool Assembly::TakeGroup(CellIndex group, ByteReader& from) {
  const std::string name = absl::StrCat("group (", group.x, ", ", group.y, ")");
  if ((group.x & (kGroupCells - 1)) != 0 || (group.y & (kGroupCells - 1)) != 0) {
    from.Refuse(name, "not aligned", absl::StrCat("multiples of ", kGroupCells));
    return false;
  }
  const CellIndex at{group.x >> kGroupBits, group.y >> kGroupBits};
  CellRect& all = piece_->groups;
  if (all.empty()) {
    all = {at, {at.x + 1, at.y + 1}};
  } else if (std::pair(at.y, at.x) <= std::pair(piece_->last_group.y, piece_->last_group.x)) {
    from.Refuse(name, "out of order", "groups by row, then column");
    return false;
  }
  piece_->last_group = at;
  all = {{std::min(all.min.x, at.x), std::min(all.min.y, at.y)},
         {std::max(all.max.x, at.x + 1), std::max(all.max.y, at.y + 1)}};
  // One group less than the limit, so that cells at both ends are within it.
  constexpr std::int32_t kGroups_max = kSubmapSideCells_max / kGroupCells;
  if (all.max.x - all.min.x <= kGroups_max && all.max.y - all.min.y <= kGroups_max) return true;
  from.Refuse(name, "far from the others",
              absl::StrCat("all within ", kSubmapSideCells_max, " cells"));
  return false;
}

void Assembly::FinishPiece(ByteReader& from) {
  Piece piece = *std::exchange(piece_, std::nullopt);
  const CellRect& groups = piece.groups;
  // The table of groups, and per cell what a submap keeps of it.
  const auto table_bytes = static_cast<std::uint64_t>(groups.max.x - groups.min.x) *
                           static_cast<std::uint64_t>(groups.max.y - groups.min.y) *
                           sizeof(std::int32_t);
  if (!Spend(table_bytes + sizeof(Submap) + piece.cells.size() * kCellBytes, from)) return;
  const auto submap = std::make_shared<const Submap>(
      piece.origin, piece.cells, std::move(piece.parts), std::move(piece.sources));
  memory_bytes_ -= piece.cell_bytes;
  if (piece.role == SubmapRole::kGrowing) {
    growing_.insert(static_cast<std::uint64_t>(piece.id));
    state_.sessions.back().active_id = piece.id;
    state_.sessions.back().active = submap;
    submap_left_ = false;
    return;
  }
  --num_pieces_;
  if (state_.submaps.empty() || state_.submaps.back().id != piece.id)
    state_.submaps.push_back({piece.id, nullptr, nullptr, {}});
  FinishedSubmapState& finished = state_.submaps.back();
  if (piece.role == SubmapRole::kSeen) {
    finished.seen = submap;
  } else {
    finished.hidden = submap;
    finished.left_T_G_K = piece.left_T_G_K;
  }
}

void Assembly::TakeLocalMap(ByteReader& from) {
  auto map = std::make_shared<LocalMap>();
  map->stamp_ns = from.Stamp("stamp_ns");
  map->seq = from.Number<std::uint64_t>("seq");
  map->T_O_B = from.Transform<Odom, Base>("odom_from_base");
  map->origin.x = from.Within<std::int32_t>("origin.x", -kCell_max, kCell_max);
  map->origin.y = from.Within<std::int32_t>("origin.y", -kCell_max, kCell_max);
  map->side_cells = from.Within<std::int32_t>("side_cells", 1, kLocalSideCells_max);
  map->traversability_free = from.Number<float>("traversability_free");
  if (!(map->traversability_free >= 0 && map->traversability_free <= 1))
    from.Refuse("traversability_free", absl::StrCat(map->traversability_free), "0 to 1");
  map->cell_size_m = state_.options.cell_size_m;
  const auto side = static_cast<std::uint64_t>(map->side_cells);
  if (!Spend(sizeof(LocalMap) + side * side * kLocalCellBytes, from)) return;
  local_map_left_ = false;
  local_map_ = std::move(map);
  local_rows_ = 0;
}

void Assembly::TakeLocalCells(ByteReader& from) {
  LocalMap& map = *local_map_;
  const auto rows = from.Within<std::uint32_t>(
      "rows", 1, static_cast<std::uint32_t>(map.side_cells - local_rows_));
  const std::size_t n = std::size_t{rows} * static_cast<std::size_t>(map.side_cells);
  const auto append = [](auto& layer, const auto& column) {
    layer.insert(layer.end(), column.begin(), column.end());
  };
  append(map.state, from.ColumnWithin<std::uint8_t>("state", n, 0, kAllStates));
  append(map.elevation_m,
         from.ColumnWithin<float>("elevation_m", n, -kElevation_m_max, kElevation_m_max));
  append(map.variance_m2, from.ColumnWithin<float>("variance_m2", n, 0, kVariance_m2_max));
  append(map.slope_rad, from.ColumnWithin<float>("slope_rad", n, 0, 2));
  append(map.roughness_m, from.ColumnWithin<float>("roughness_m", n, 0, kElevation_m_max));
  append(map.traversability, from.ColumnWithin<float>("traversability", n, 0, 1));
  append(map.rgba, from.Column<std::uint32_t>("rgba", n));
  append(map.observed_ns, from.Stamps("observed_ns", n));
  if (!from.ok()) return;
  local_rows_ += static_cast<std::int32_t>(rows);
  if (local_rows_ == map.side_cells)
    state_.sessions.back().local_map = std::exchange(local_map_, nullptr);
}

void Assembly::TakeEnd(ByteReader& from) {
  from.Within<std::uint64_t>("num_sections", num_sections_, num_sections_);
  complete_ = from.ok();
}

}  // namespace gem::map_file
