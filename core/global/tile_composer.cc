#include "core/global/tile_composer.h"

#include <algorithm>
#include <deque>
#include <utility>

#include "core/base/parallel_for.h"

namespace gem {

struct TileComposer::Job {
  TileIndex tile;
  bool submaps_changed = false;  ///< else its base is still good
  std::vector<const SubmapLayer*> submaps;
  std::vector<const LocalLayer*> local_maps;
};

namespace {

// Both by id.
std::vector<TileIndex> TilesOfChangedSubmaps(
    const std::vector<std::shared_ptr<const PlacedSubmap>>& before,
    const std::vector<std::shared_ptr<const PlacedSubmap>>& after) {
  std::vector<TileIndex> tiles;
  auto was = before.begin();
  auto is = after.begin();
  while (was != before.end() || is != after.end()) {
    const bool gone = is == after.end() || (was != before.end() && (*was)->id < (*is)->id);
    const bool added = was == before.end() || (is != after.end() && (*is)->id < (*was)->id);
    AppendChangedTiles(added ? nullptr : was->get(), gone ? nullptr : is->get(), tiles);
    if (!added) ++was;
    if (!gone) ++is;
  }
  return tiles;
}

std::vector<TileIndex> TilesOfChangedLocalMaps(
    const std::vector<std::shared_ptr<const PlacedLocalMap>>& before,
    const std::vector<std::shared_ptr<const PlacedLocalMap>>& after) {
  std::vector<TileIndex> tiles;
  const auto append_missing = [&tiles](const auto& of, const auto& in) {
    for (const auto& placed : of)
      if (std::find(in.begin(), in.end(), placed) == in.end())
        tiles.insert(tiles.end(), placed->tiles.begin(), placed->tiles.end());
  };
  append_missing(before, after);
  append_missing(after, before);
  return tiles;
}

}  // namespace

struct TileComposer::Plan {
  std::vector<Job> jobs;
  absl::flat_hash_map<TileIndex, std::size_t> job_of;
  std::deque<SubmapLayer> submap_layers;  // jobs point at them
  std::deque<LocalLayer> local_layers;

  void Mark(const std::vector<TileIndex>& tiles, bool submaps_changed) {
    for (const TileIndex tile : tiles)
      if (job_of.try_emplace(tile, jobs.size()).second)
        jobs.push_back({tile, submaps_changed, {}, {}});
  }
  Job* Find(TileIndex tile) {
    const auto it = job_of.find(tile);
    return it == job_of.end() ? nullptr : &jobs[it->second];
  }
};

TileComposer::Plan TileComposer::MakePlan(const MapContent& before, const MapContent& after) {
  Plan plan;
  plan.Mark(TilesOfChangedSubmaps(before.submaps, after.submaps), true);
  plan.Mark(TilesOfChangedLocalMaps(before.local_maps, after.local_maps), false);
  if (plan.jobs.empty()) return plan;

  // In an order that does not depend on who arrived first.
  std::vector<const PlacedSubmap*> submaps;
  for (const auto& placed : after.submaps) submaps.push_back(placed.get());
  std::sort(submaps.begin(), submaps.end(), [](const PlacedSubmap* a, const PlacedSubmap* b) {
    return Older(*a->submap, *b->submap);
  });
  for (const PlacedSubmap* placed : submaps) {
    const SubmapLayer* layer = nullptr;
    for (const TileIndex tile : placed->tiles) {
      Job* job = plan.Find(tile);
      if (job == nullptr || !job->submaps_changed) continue;
      if (layer == nullptr) layer = &plan.submap_layers.emplace_back(*placed);
      job->submaps.push_back(layer);
    }
  }
  for (const auto& placed : after.local_maps) {
    const LocalLayer* layer = nullptr;
    for (const TileIndex tile : placed->tiles) {
      Job* job = plan.Find(tile);
      if (job == nullptr) continue;
      if (layer == nullptr) layer = &plan.local_layers.emplace_back(*placed);
      job->local_maps.push_back(layer);
    }
  }
  return plan;
}

TileComposer::Result TileComposer::Compose(const MapContent& before, const MapContent& after,
                                           const TileMap& tiles, const MapVersion& version,
                                           const CancelToken& cancel) const {
  const Plan plan = MakePlan(before, after);
  Result result;
  result.rendered.resize(plan.jobs.size());
  ParallelFor(plan.jobs.size(), options_.compose_threads, [&](std::size_t i) {
    if (!cancel.cancelled()) result.rendered[i] = Run(plan.jobs[i], tiles, version);
  });
  if (cancel.cancelled()) return {{}, {}, true};
  for (const Result::Rendered& rendered : result.rendered) {
    const auto old = tiles.find(rendered.index);
    const Tile* old_tile = old == tiles.end() ? nullptr : old->second.get();
    if (rendered.tile.get() != old_tile) result.changed.push_back(rendered.index);
  }
  return result;
}

TileComposer::Result::Rendered TileComposer::Run(const Job& job, const TileMap& tiles,
                                                 const MapVersion& version) const {
  const auto published_it = tiles.find(job.tile);
  const std::shared_ptr<const Tile> published =
      published_it == tiles.end() ? nullptr : published_it->second;
  const auto as_tile = [&](TileCells cells) {
    if (published != nullptr && published->cells == cells) return published;
    return std::make_shared<const Tile>(Tile{0, job.tile, version, std::move(cells)});
  };

  TileCells fresh;
  std::shared_ptr<const TileCells> cached;
  if (job.submaps_changed) {
    fresh = RenderSubmaps(job.tile, job.submaps, options_.gate_sigmas);
  } else if (const auto it = bases_.find(job.tile); it != bases_.end()) {
    cached = it->second;
  }
  const TileCells* base = fresh.empty() ? cached.get() : &fresh;
  TileCells top;
  if (!job.local_maps.empty()) top = RenderLocalMaps(job.tile, base, job.local_maps);

  Result::Rendered rendered{job.tile, nullptr, cached};
  if (!top.empty()) {
    rendered.tile = as_tile(std::move(top));
    if (!fresh.empty()) rendered.base = std::make_shared<const TileCells>(std::move(fresh));
  } else if (base != nullptr) {
    // The tile is its own base: half a megabyte less.
    if (fresh.empty()) fresh = *cached;
    rendered.tile = as_tile(std::move(fresh));
    rendered.base = std::shared_ptr<const TileCells>(rendered.tile, &rendered.tile->cells);
  }
  return rendered;
}

void TileComposer::Apply(const Result& result, TileMap& tiles) {
  for (const Result::Rendered& rendered : result.rendered) {
    if (rendered.tile == nullptr) {
      tiles.erase(rendered.index);
    } else {
      tiles[rendered.index] = rendered.tile;
    }
  }
}

void TileComposer::Adopt(const Result& result) {
  for (const Result::Rendered& rendered : result.rendered) {
    if (rendered.base == nullptr) {
      bases_.erase(rendered.index);
    } else {
      bases_[rendered.index] = rendered.base;
    }
  }
}

}  // namespace gem
