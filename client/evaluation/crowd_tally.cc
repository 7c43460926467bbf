#include "client/evaluation/crowd_tally.h"

#include <algorithm>
#include <cmath>

namespace gem::evaluation {
namespace {

/// A cell is high if it lies so far above what truly stands there: nearer than half of a cube, and
/// farther than any noise.
constexpr double kHigh_m = 0.25;
/// Ranges err by some centimetres, so a body's points fall into cells that it just does not touch.
constexpr double kBlur_m = 0.1;
/// Sides of the grid of places that are asked in a cell.
constexpr int kPlaces = 5;

bool IsHigh(const LocalMap& map, CellIndex cell) {
  const CellBelief belief = map.BeliefAt(map.IndexOf(cell));
  return belief.known() && static_cast<double>(belief.elevation_m) > kHigh_m;
}

/// Distance from a place to the nearest place of a cell.
double DistanceTo(CellIndex cell, double cell_size_m, const Eigen::Vector2d& place_m) {
  const Eigen::Vector2d center_m(CenterOf(cell.x, cell_size_m), CenterOf(cell.y, cell_size_m));
  const Eigen::Vector2d beyond_m =
      ((place_m - center_m).cwiseAbs().array() - 0.5 * cell_size_m).cwiseMax(0.0);
  return beyond_m.norm();
}

/// The place (i, j) of the grid over a cell that is wider by a margin.
Eigen::Vector2d PlaceOf(CellIndex cell, double cell_size_m, double margin_m, int i, int j) {
  const double reach_m = cell_size_m + 2 * margin_m;
  const Eigen::Vector2d center_m(CenterOf(cell.x, cell_size_m), CenterOf(cell.y, cell_size_m));
  return center_m + reach_m * Eigen::Vector2d((i + 0.5) / kPlaces - 0.5, (j + 0.5) / kPlaces - 0.5);
}

}  // namespace

double CrowdTally::HighestIn(CellIndex cell, double margin_m) const {
  double height_m = 0;
  for (int j = 0; j < kPlaces; ++j) {
    for (int i = 0; i < kPlaces; ++i) {
      const Eigen::Vector2d place_m = PlaceOf(cell, cell_size_m_, margin_m, i, j);
      height_m = std::max(height_m, world_.TrueHeightAt(place_m.x(), place_m.y()).value_or(0));
    }
  }
  return height_m;
}

CrowdTally::Track& CrowdTally::TrackOf(CellIndex cell) {
  const auto [entry, is_new] = tracks_.try_emplace(PackedKey(cell));
  Track& track = entry->second;
  if (!is_new) return track;
  const double x_m = CenterOf(cell.x, cell_size_m_), y_m = CenterOf(cell.y, cell_size_m_);
  if (world_.TrueHeightAt(x_m, y_m).value_or(0) > kHigh_m)
    track.truth = Truth::kThing;
  else if (HighestIn(cell, 0) > kHigh_m)
    track.truth = Truth::kEdge;
  else if (HighestIn(cell, kBlur_m) > kHigh_m)
    track.truth = Truth::kBesideThing;
  return track;
}

bool CrowdTally::IsInSight(CellIndex cell, const Eigen::Vector2d& sensor_m,
                           const RayCaster& low_rays) const {
  for (int j = 0; j < kPlaces; ++j) {
    for (int i = 0; i < kPlaces; ++i) {
      const Eigen::Vector2d way_m = PlaceOf(cell, cell_size_m_, 0, i, j) - sensor_m;
      const double distance_m = way_m.norm();
      const auto hit = low_rays.Cast({way_m.x() / distance_m, way_m.y() / distance_m, 0});
      // A ray must end beyond the cell, in another range bin, to say something about it.
      if (hit && hit->range_m < distance_m + 2.5 * cell_size_m_) return false;
    }
  }
  return true;
}

bool CrowdTally::AddOpen(Track& track, bool known, bool high, bool occupied) {
  if (occupied) {
    track.swept = true;
    track.high |= high;
    track.revealed = track.high_alone = false;
    return false;
  }
  if (!track.swept) {
    track.lost |= track.known && (!known || high);
    track.known |= known && !high;
    return false;
  }
  track.high |= high;
  track.high_alone = high;
  return track.high;
}

template <typename Solid>
void CrowdTally::AddThings(const LocalMap& map, const std::vector<Solid>& solids,
                           std::vector<Thing>& things) {
  things.resize(solids.size());
  for (std::size_t i = 0; i < solids.size(); ++i) {
    const Eigen::Vector2d& center_m = solids[i].center_m;
    const double reach_m = BoundingRadius(solids[i]);
    const CellIndex low = CellAt(center_m.x() - reach_m, center_m.y() - reach_m, cell_size_m_);
    const CellIndex high = CellAt(center_m.x() + reach_m, center_m.y() + reach_m, cell_size_m_);
    if (!map.rect().Contains(low) || !map.rect().Contains(high)) continue;
    bool shown = false;
    for (std::int32_t y = low.y; y <= high.y && !shown; ++y) {
      for (std::int32_t x = low.x; x <= high.x && !shown; ++x) {
        if (!IsHigh(map, {x, y})) continue;
        for (int place = 0; place < kPlaces * kPlaces && !shown; ++place)
          shown =
              Covers(solids[i], PlaceOf({x, y}, cell_size_m_, 0, place % kPlaces, place / kPlaces));
      }
    }
    things[i].lost |= things[i].high && !shown;
    things[i].high |= shown;
  }
}

void CrowdTally::Add(const LocalMap& map, const Eigen::Vector3d& sensor_m, double time_s) {
  std::vector<Cylinder> bodies;
  for (std::size_t i = 0; i < world_.walkers().size(); ++i)
    bodies.push_back(world_.WalkerAt(i, time_s));
  const RayCaster low_rays(world_, {sensor_m.x(), sensor_m.y(), kHigh_m},
                           map.side_cells * cell_size_m_, time_s);
  Now now{.time_s = time_s};
  const CellRect rect = map.rect();
  for (std::int32_t y = rect.min.y; y < rect.max.y; ++y) {
    for (std::int32_t x = rect.min.x; x < rect.max.x; ++x) {
      const CellIndex cell{x, y};
      Track& track = TrackOf(cell);
      const bool high = IsHigh(map, cell);
      if (track.truth != Truth::kGround) {
        track.lost |= track.high && !high;
        track.high |= high;
        continue;
      }
      const bool known = map.BeliefAt(map.IndexOf(cell)).known();
      const bool occupied = std::any_of(bodies.begin(), bodies.end(), [&](const Cylinder& body) {
        return DistanceTo(cell, cell_size_m_, body.center_m) <= body.radius_m + kBlur_m;
      });
      if (!AddOpen(track, known, high, occupied)) continue;
      ++now.walked;
      now.trails += high;
      if (!IsInSight(cell, sensor_m.head<2>(), low_rays)) continue;
      track.revealed = true;
      ++seen_;
      seen_trails_ += high;
      now.seen_trails += high;
    }
  }
  by_scan_.push_back(now);
  AddThings(map, world_.boxes(), boxes_);
  AddThings(map, world_.cylinders(), cylinders_);
}

CrowdTally::Counts& CrowdTally::Counts::operator+=(const Counts& other) {
  for (int Counts::*count :
       {&Counts::walked, &Counts::revealed, &Counts::trails, &Counts::hidden_trails,
        &Counts::standing, &Counts::standing_lost, &Counts::edges, &Counts::edges_lost,
        &Counts::things, &Counts::things_lost, &Counts::ground, &Counts::ground_lost})
    this->*count += other.*count;
  seen += other.seen;
  seen_trails += other.seen_trails;
  return *this;
}

CrowdTally::Counts CrowdTally::Count() const {
  Counts counts{.seen = seen_, .seen_trails = seen_trails_};
  for (const auto& [key, track] : tracks_) {
    const bool walked = track.swept && track.high;
    switch (track.truth) {
      case Truth::kThing:
        counts.standing += track.high;
        counts.standing_lost += track.lost;
        break;
      case Truth::kEdge:
        counts.edges += track.high;
        counts.edges_lost += track.lost;
        break;
      case Truth::kBesideThing:
        break;
      case Truth::kGround:
        counts.walked += walked;
        counts.revealed += walked && track.revealed;
        counts.trails += walked && track.revealed && track.high_alone;
        counts.hidden_trails += walked && !track.revealed && track.high_alone;
        counts.ground += !track.swept && track.known;
        counts.ground_lost += !track.swept && track.lost;
        break;
    }
  }
  for (const auto* things : {&boxes_, &cylinders_}) {
    for (const Thing& thing : *things) {
      counts.things += thing.high;
      counts.things_lost += thing.lost;
    }
  }
  return counts;
}

}  // namespace gem::evaluation
