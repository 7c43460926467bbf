#include "core/global/global_mapper.h"

#include <algorithm>
#include <deque>
#include <limits>
#include <optional>
#include <utility>

#include "absl/container/btree_map.h"
#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"
#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/stopwatch.h"
#include "core/global/coverage.h"
#include "core/global/finished_submaps.h"
#include "core/global/placement.h"
#include "core/global/pyramid.h"
#include "core/global/submap_merger.h"
#include "core/global/tile_composer.h"

namespace gem {
namespace {

struct Session {
  Session(const std::string& session, const std::string& robot_name,
          const Pose<Global, Odom>& T_G_O, std::size_t odometry_poses_max)
      : name(session), robot(robot_name), trajectory(T_G_O, odometry_poses_max) {}
  Session(const SessionState& state, std::size_t odometry_poses_max)
      : name(state.session),
        robot(state.robot),
        trajectory(state.trajectory, odometry_poses_max),
        active(state.active),
        active_id(state.active_id),
        local_field(state.local_map == nullptr
                        ? nullptr
                        : std::make_shared<const LocalField>(state.local_map)),
        ended(true) {}

  std::string name;
  std::string robot;
  SessionTrajectory trajectory;
  std::shared_ptr<const Submap> active;
  std::optional<std::int64_t> active_anchor_ns;  ///< of the submap that active_id belongs to
  SubmapId active_id{};
  std::shared_ptr<const LocalField> local_field;
  bool ended = false;
};

/// Counts the tiles under rectangles of cells, and stops before the count costs more than it may.
class TouchedTiles {
 public:
  explicit TouchedTiles(std::uint64_t tiles_max)
      : tiles_max_(std::min(tiles_max, std::numeric_limits<std::uint64_t>::max() / kTouches_max)) {}

  void Add(const CellRect& rect) {
    num_touches_ += NumSquares(rect, kTileBits);
    if (too_many()) return;
    touched_.clear();
    AppendSquares(rect, kTileBits, touched_);
    tiles_.insert(touched_.begin(), touched_.end());
  }
  bool too_many() const {
    return tiles_.size() > tiles_max_ || num_touches_ > tiles_max_ * kTouches_max;
  }

 private:
  /// Of one tile on average. Groups have 256 cells: only what leans by more than any ground, or is
  /// as many submaps on each other, touches more.
  static constexpr std::uint64_t kTouches_max = 1024;

  const std::uint64_t tiles_max_;
  std::uint64_t num_touches_ = 0;
  std::vector<TileIndex> touched_;
  absl::flat_hash_set<TileIndex> tiles_;
};

// Of submaps with the same cells.
bool SameSources(const Submap& a, const Submap& b) {
  if (a.sources().size() < 2) return true;
  for (std::size_t i = 0; i < a.num_cells(); ++i)
    if (a.source(i) != b.source(i)) return false;
  return true;
}

bool SameContent(const Submap& a, const Submap& b) {
  return a.num_cells() == b.num_cells() && a.rect() == b.rect() && a.sources() == b.sources() &&
         SameSources(a, b) &&
         std::all_of(a.groups().begin(), a.groups().end(),
                     [&](const Submap::Group& group) { return SameGroup(a, group, b); });
}

absl::Status CheckSubmap(const Submap& submap, const std::string& session, float cell_size_m) {
  if (submap.origin().session != session)
    return absl::InvalidArgumentError(absl::StrCat(
        "update.submap.session is \"", submap.origin().session, "\", want \"", session, "\""));
  if (submap.origin().cell_size_m != cell_size_m)
    return absl::InvalidArgumentError(absl::StrCat(
        "update.submap.cell_size_m is ", submap.origin().cell_size_m, ", want ", cell_size_m));
  return absl::OkStatus();
}

absl::Status CheckUpdate(const SessionUpdate& update, const Session& session, float cell_size_m) {
  const Trajectory<Odom, Base>& odometry = session.trajectory.odometry();
  std::optional<std::int64_t> newest_ns;
  if (!odometry.empty()) newest_ns = odometry.back().stamp_ns;
  for (const StampedPose<Odom, Base>& pose : update.odometry) {
    if (newest_ns && pose.stamp_ns <= *newest_ns)
      return absl::InvalidArgumentError(absl::StrCat("update.odometry.stamp_ns is ", pose.stamp_ns,
                                                     ", want more than ", *newest_ns));
    newest_ns = pose.stamp_ns;
  }
  for (const auto& submap : update.finished) {
    GEM_CHECK(submap != nullptr);
    GEM_RETURN_IF_ERROR(CheckSubmap(*submap, session.name, cell_size_m));
  }
  if (update.active != nullptr)
    GEM_RETURN_IF_ERROR(CheckSubmap(*update.active, session.name, cell_size_m));
  if (update.local_map != nullptr && update.local_map->cell_size_m != cell_size_m)
    return absl::InvalidArgumentError(absl::StrCat(
        "update.local_map.cell_size_m is ", update.local_map->cell_size_m, ", want ", cell_size_m));
  return absl::OkStatus();
}

SubmapInfo InfoOf(const PlacedSubmap& placed) {
  const Submap& submap = *placed.submap;
  SubmapInfo info{submap.origin(),
                  AllContributors(submap.sources()),
                  placed.T_G_K,
                  placed.rect_G,
                  submap.num_cells(),
                  submap.size_bytes(),
                  submap.first_stamp_ns(),
                  submap.last_stamp_ns(),
                  placed.finished};
  info.origin.id = placed.id;
  return info;
}

bool Same(const std::vector<SessionInfo>& a, const std::vector<SessionInfo>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const SessionInfo& x, const SessionInfo& y) {
                      return x.session == y.session && x.ended == y.ended &&
                             x.retracted == y.retracted && Identical(x.T_G_O, y.T_G_O);
                    });
}

}  // namespace

struct GlobalMapper::Impl {
  explicit Impl(const GlobalMapOptions& map_options)
      : options(map_options), composer(map_options) {}

  struct CollectedSubmap {
    SubmapId id{};
    std::shared_ptr<const Submap> submap;
    const FinishedSubmaps::Stored* stored = nullptr;  ///< null: it still grows
  };

  absl::StatusOr<Session*> Find(const std::string& name) {
    const auto it = session_of.find(name);
    if (it == session_of.end())
      return absl::NotFoundError(absl::StrCat("session \"", name, "\" is unknown"));
    return it->second;
  }

  SubmapId IdOf(Session& session, const Submap& submap);
  /// Enters what the state holds; places and renders nothing.
  void Load(const MapState& state);
  /// RESOURCE_EXHAUSTED if what is to be placed may fill more than tiles_max tiles. Counts before
  /// anything is made for them.
  absl::Status CheckTiles(std::uint64_t tiles_max) const;
  Pose<Global, Submap> T_G_K(const Submap& submap) const;
  std::vector<CollectedSubmap> CollectSubmaps() const;
  void PlaceSubmaps(const std::vector<CollectedSubmap>& collected, MapContent& next,
                    absl::flat_hash_set<SubmapId>& changed, CommitReport& report) const;
  void PlaceLocalMaps(MapContent& next) const;
  std::shared_ptr<const MapSnapshot> Publish(const std::shared_ptr<const MapSnapshot>& old,
                                             std::shared_ptr<MapSnapshot> fresh, MapContent next,
                                             const TileComposer::Result& composed);

  // Constant after construction.
  const GlobalMapOptions options;

  // What was told, whether published or not.
  std::deque<Session> sessions;  // by order of arrival
  absl::flat_hash_map<std::string, Session*> session_of;
  FinishedSubmaps finished;
  std::uint64_t last_id = 0;

  bool as_it_was = false;  ///< loaded, and not published yet: maintenance has looked at it before

  // What is published. A commit compares the two, so that one that is cancelled loses nothing.
  MapContent content;
  TileComposer composer;
};

GlobalMapper::GlobalMapper(const GlobalMapOptions& options, std::uint64_t epoch)
    : impl_(std::make_unique<Impl>(options)) {
  auto snapshot = std::make_shared<MapSnapshot>();
  snapshot->version.epoch = epoch;
  snapshot->options = options;
  snapshot_ = std::move(snapshot);
}

GlobalMapper::~GlobalMapper() = default;

absl::Status GlobalMapper::AddSession(const std::string& session, const std::string& robot,
                                      const Pose<Global, Odom>& T_G_O) {
  if (impl_->session_of.contains(session))
    return absl::AlreadyExistsError(absl::StrCat("session \"", session, "\" exists"));
  impl_->sessions.emplace_back(session, robot, T_G_O,
                               static_cast<std::size_t>(impl_->options.odometry_poses_max));
  impl_->session_of[session] = &impl_->sessions.back();
  return absl::OkStatus();
}

absl::Status GlobalMapper::Update(const std::string& name, SessionUpdate update) {
  GEM_ASSIGN_OR_RETURN(Session * session, impl_->Find(name));
  if (session->ended)
    return absl::FailedPreconditionError(absl::StrCat("session \"", name, "\" has ended"));
  GEM_RETURN_IF_ERROR(CheckUpdate(update, *session, impl_->options.cell_size_m));

  for (const StampedPose<Odom, Base>& pose : update.odometry)
    session->trajectory.AppendOdometry(pose.stamp_ns, pose.T_A_B);
  for (std::shared_ptr<const Submap>& submap : update.finished) {
    if (submap->empty()) continue;
    const SubmapId id = impl_->IdOf(*session, *submap);
    impl_->finished.Add(id, std::move(submap));
  }
  session->ended = update.ended;
  session->active = update.ended ? nullptr : std::move(update.active);
  if (session->active != nullptr && session->active->empty()) session->active = nullptr;
  if (session->active != nullptr) impl_->IdOf(*session, *session->active);
  const std::shared_ptr<const LocalMap> local_map =
      update.ended ? nullptr : std::move(update.local_map);
  if (local_map == nullptr) {
    session->local_field = nullptr;
  } else if (session->local_field == nullptr || session->local_field->shared_map() != local_map) {
    session->local_field = std::make_shared<const LocalField>(local_map);
  }
  return absl::OkStatus();
}

absl::StatusOr<CorrectionCounts> GlobalMapper::Correct(const std::string& name,
                                                       CorrectedTrajectory correction) {
  GEM_ASSIGN_OR_RETURN(Session * session, impl_->Find(name));
  if (correction.empty()) return absl::InvalidArgumentError("correction.poses is empty");
  for (std::size_t i = 1; i < correction.size(); ++i)
    if (correction[i].stamp_ns <= correction[i - 1].stamp_ns)
      return absl::InvalidArgumentError(absl::StrCat("correction.poses[", i, "].stamp_ns is ",
                                                     correction[i].stamp_ns, ", want more than ",
                                                     correction[i - 1].stamp_ns));
  const Trajectory<Odom, Base>& odometry = session->trajectory.odometry();
  if (!odometry.empty() && correction.back().stamp_ns < odometry.front().stamp_ns)
    return absl::OutOfRangeError(absl::StrCat("correction.poses end at stamp_ns ",
                                              correction.back().stamp_ns, ", before session \"",
                                              name, "\" began at ", odometry.front().stamp_ns));
  if (session->ended &&
      (odometry.empty() || correction.front().stamp_ns > odometry.back().stamp_ns))
    return absl::OutOfRangeError(absl::StrCat("correction.poses begin at stamp_ns ",
                                              correction.front().stamp_ns, ", after session \"",
                                              name, "\" ended"));
  return session->trajectory.SetCorrection(correction);
}

absl::StatusOr<RetractionCounts> GlobalMapper::Retract(const std::string& name, bool restore) {
  GEM_ASSIGN_OR_RETURN(Session * session, impl_->Find(name));
  if (restore != impl_->finished.IsRetracted(name)) return RetractionCounts{};
  RetractionCounts counts = restore ? impl_->finished.Restore(name)
                                    : impl_->finished.Retract(name, impl_->content.submaps);
  if (session->active != nullptr) ++counts.num_submaps;
  return counts;
}

std::shared_ptr<const MapSnapshot> GlobalMapper::Commit(const CancelToken& cancel,
                                                        CommitReport& report) {
  report = {};
  const auto cancelled = [&report, this] {
    report.cancelled = true;
    return snapshot_;
  };
  if (cancel.cancelled()) return cancelled();

  Stopwatch stopwatch;
  const std::vector<Impl::CollectedSubmap> collected = impl_->CollectSubmaps();
  report.seconds.finish = stopwatch.Lap();

  MapContent next;
  absl::flat_hash_set<SubmapId> changed;
  impl_->PlaceSubmaps(collected, next, changed, report);
  impl_->PlaceLocalMaps(next);
  report.seconds.deform = stopwatch.Lap();

  if (impl_->as_it_was) changed.clear();
  Maintenance maintenance = Maintain(std::move(next.submaps), changed, impl_->options, cancel);
  report.seconds.merge = changed.empty() ? 0 : stopwatch.Lap();
  if (maintenance.cancelled) return cancelled();
  next.submaps = std::move(maintenance.submaps);

  const MapVersion version{snapshot_->version.epoch, snapshot_->version.revision + 1};
  const TileComposer::Result composed =
      impl_->composer.Compose(impl_->content, next, snapshot_->tiles, version, cancel);
  if (composed.cancelled) return cancelled();
  report.seconds.compose = composed.rendered.empty() ? 0 : stopwatch.Lap();

  auto fresh = std::make_shared<MapSnapshot>();
  fresh->version = version;
  fresh->tiles = snapshot_->tiles;
  fresh->coarser = snapshot_->coarser;
  TileComposer::Apply(composed, fresh->tiles);
  if (!UpdatePyramid(composed.changed, impl_->options, cancel, *fresh)) return cancelled();
  report.seconds.coarsen = composed.changed.empty() ? 0 : stopwatch.Lap();
  report.num_merged_submaps = maintenance.num_merged;
  report.num_touched_tiles = static_cast<std::uint32_t>(composed.rendered.size());
  if (!changed.empty()) impl_->finished.NoteChange();
  impl_->as_it_was = false;
  snapshot_ = impl_->Publish(snapshot_, std::move(fresh), std::move(next), composed);
  return snapshot_;
}

absl::StatusOr<std::unique_ptr<GlobalMapper>> GlobalMapper::FromState(const MapState& state,
                                                                      std::uint64_t epoch,
                                                                      std::uint64_t tiles_max) {
  auto mapper = std::make_unique<GlobalMapper>(state.options, epoch);
  mapper->impl_->Load(state);
  GEM_RETURN_IF_ERROR(mapper->impl_->CheckTiles(tiles_max));
  return mapper;
}

void GlobalMapper::Impl::Load(const MapState& state) {
  for (const SessionState& session : state.sessions) {
    sessions.emplace_back(session, static_cast<std::size_t>(options.odometry_poses_max));
    session_of[session.session] = &sessions.back();
    if (session.retracted) finished.LoadRetracted(session.session);
  }
  for (const FinishedSubmapState& submap : state.submaps) {
    FinishedSubmaps::Stored stored{submap.seen, submap.hidden, {}};
    if (submap.left_T_G_K.has_value()) stored.left = {*submap.left_T_G_K, 0};
    finished.Load(submap.id, std::move(stored));
  }
  last_id = state.last_submap_id;
  as_it_was = true;
}

MapState GlobalMapper::State() const {
  MapState state{impl_->options, snapshot_->version, impl_->last_id, {}, {}};
  for (const Session& session : impl_->sessions)
    state.sessions.push_back(
        {session.name, session.robot, session.trajectory.state(), session.ended,
         impl_->finished.IsRetracted(session.name), session.active_id, session.active,
         session.local_field == nullptr ? nullptr : session.local_field->shared_map()});
  for (const auto& [id, stored] : impl_->finished.all())
    state.submaps.push_back({id, stored.seen, stored.hidden, impl_->finished.LeftAt(stored)});
  return state;
}

absl::Status GlobalMapper::Impl::CheckTiles(std::uint64_t tiles_max) const {
  TouchedTiles tiles(tiles_max);
  // Hidden ones too: they may come back.
  const auto touch = [&](const std::shared_ptr<const Submap>& submap) {
    if (submap == nullptr) return;
    const Pose<Global, Submap> pose = T_G_K(*submap);
    for (const Submap::Group& group : submap->groups())
      tiles.Add(
          RectUnder(BoxOf(*submap, group), pose.matrix(), pose.translation(), options.cell_size_m));
  };
  for (const auto& [id, stored] : finished.all()) {
    touch(stored.seen);
    touch(stored.hidden);
  }
  for (const Session& session : sessions) {
    touch(session.active);
    if (session.local_field == nullptr || session.local_field->empty()) continue;
    const LocalField& field = *session.local_field;
    const Pose<Global, Odom> pose = session.trajectory.T_G_O(field.map().stamp_ns);
    tiles.Add(RectUnder({field.rect(), field.elevation_m_min(), field.elevation_m_max()},
                        pose.matrix(), pose.translation(), options.cell_size_m));
  }
  if (!tiles.too_many()) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      absl::StrCat("the map lies on more tiles than ", tiles_max, ", want at most so many"));
}

// The active submap keeps its id when it is finished.
SubmapId GlobalMapper::Impl::IdOf(Session& session, const Submap& submap) {
  const std::int64_t anchor_ns = submap.origin().anchor_stamp_ns;
  if (session.active_anchor_ns != anchor_ns) {
    session.active_anchor_ns = anchor_ns;
    session.active_id = SubmapId{++last_id};
  }
  return session.active_id;
}

std::vector<GlobalMapper::Impl::CollectedSubmap> GlobalMapper::Impl::CollectSubmaps() const {
  std::vector<CollectedSubmap> collected;
  collected.reserve(finished.all().size() + sessions.size());
  for (const auto& [id, stored] : finished.all())
    if (stored.seen != nullptr) collected.push_back({id, stored.seen, &stored});
  for (const Session& session : sessions)
    if (session.active != nullptr && !finished.IsRetracted(session.name))
      collected.push_back({session.active_id, session.active, nullptr});
  std::sort(collected.begin(), collected.end(),
            [](const CollectedSubmap& a, const CollectedSubmap& b) { return a.id < b.id; });
  return collected;
}

Pose<Global, Submap> GlobalMapper::Impl::T_G_K(const Submap& submap) const {
  const SubmapOrigin& origin = submap.origin();
  return session_of.at(origin.session)->trajectory.T_G_O(submap.parts(), origin.T_O_K) *
         origin.T_O_K;
}

// A submap that is as it was keeps its placement: then it touches nothing.
void GlobalMapper::Impl::PlaceSubmaps(const std::vector<CollectedSubmap>& collected,
                                      MapContent& next, absl::flat_hash_set<SubmapId>& changed,
                                      CommitReport& report) const {
  auto before = content.submaps.begin();
  next.submaps.reserve(collected.size());
  for (const CollectedSubmap& is : collected) {
    const Pose<Global, Submap> T_G_K = this->T_G_K(*is.submap);
    while (before != content.submaps.end() && (*before)->id < is.id) ++before;
    const bool is_new = before == content.submaps.end() || (*before)->id != is.id;
    const bool moved = !is_new && !Identical((*before)->T_G_K, T_G_K);
    const bool is_finished = is.stored != nullptr;
    const bool finished_now = is_finished && (is_new || !(*before)->finished);
    const bool came_back = is_new && is_finished && finished.CameBack(*is.stored, T_G_K);
    const bool same =
        !is_new && !moved && !finished_now &&
        ((*before)->submap == is.submap || SameContent(*(*before)->submap, *is.submap));
    if (moved) ++report.num_moved_submaps;
    if (is_finished && (moved || finished_now) && !came_back) changed.insert(is.id);
    next.submaps.push_back(
        same ? *before
             : std::make_shared<const PlacedSubmap>(Place(is.id, is.submap, is_finished, T_G_K)));
  }
}

void GlobalMapper::Impl::PlaceLocalMaps(MapContent& next) const {
  for (const Session& session : sessions) {
    if (session.local_field == nullptr || session.local_field->empty()) continue;
    if (finished.IsRetracted(session.name)) continue;
    const Pose<Global, Odom> T_G_O = session.trajectory.T_G_O(session.local_field->map().stamp_ns);
    const auto before =
        std::find_if(content.local_maps.begin(), content.local_maps.end(),
                     [&](const auto& placed) { return placed->session == session.name; });
    const bool same = before != content.local_maps.end() &&
                      (*before)->field == session.local_field && Identical((*before)->T_G_O, T_G_O);
    next.local_maps.push_back(same ? *before
                                   : std::make_shared<const PlacedLocalMap>(
                                         Place(session.name, session.local_field, T_G_O)));
  }
  std::sort(next.local_maps.begin(), next.local_maps.end(),
            [](const auto& a, const auto& b) { return a->session < b->session; });
}

// Takes over what a commit worked out, and completes `fresh`, which has its version and tiles; the
// old snapshot itself if nothing in it has changed.
std::shared_ptr<const MapSnapshot> GlobalMapper::Impl::Publish(
    const std::shared_ptr<const MapSnapshot>& old, std::shared_ptr<MapSnapshot> fresh,
    MapContent next, const TileComposer::Result& composed) {
  const bool submaps_changed = next.submaps != content.submaps;
  content = std::move(next);
  composer.Adopt(composed);
  // Maintenance may have replaced and removed some.
  if (submaps_changed) finished.Adopt(content.submaps);

  for (const Session& session : sessions) {
    const Trajectory<Odom, Base>& odometry = session.trajectory.odometry();
    const std::int64_t newest_ns = odometry.empty() ? 0 : odometry.back().stamp_ns;
    fresh->sessions.push_back({session.name, session.robot, session.trajectory.T_G_O(newest_ns),
                               session.ended, finished.IsRetracted(session.name)});
  }
  if (!submaps_changed && composed.changed.empty() && Same(fresh->sessions, old->sessions))
    return old;

  fresh->options = options;
  bool observed = false;
  const auto observe = [&](std::int64_t stamp_ns) {
    fresh->newest_stamp_ns = observed ? std::max(fresh->newest_stamp_ns, stamp_ns) : stamp_ns;
    observed = true;
  };
  for (const auto& placed : content.submaps) {
    fresh->submaps.push_back(InfoOf(*placed));
    fresh->num_points += placed->submap->num_cells();
    fresh->submap_bytes += placed->submap->size_bytes();
    observe(placed->submap->last_stamp_ns());
  }
  fresh->submap_bytes += finished.HiddenBytes();
  for (const auto& placed : content.local_maps) observe(placed->field->newest_ns());
  return fresh;
}

}  // namespace gem
