#include "core/global/tile_renderer.h"

#include <algorithm>
#include <cstdint>
#include <optional>

#include "absl/container/inlined_vector.h"
#include "core/global/fusion.h"

namespace gem {
namespace {

CellRect TileRect(TileIndex tile) {
  const CellIndex origin = OriginOf(tile);
  return {origin, {origin.x + kTileCells, origin.y + kTileCells}};
}

CellRect Intersection(const CellRect& a, const CellRect& b) {
  return {{std::max(a.min.x, b.min.x), std::max(a.min.y, b.min.y)},
          {std::min(a.max.x, b.max.x), std::min(a.max.y, b.max.y)}};
}

// Calls visit(cell, belief) for every cell of the rectangle that the layer knows.
template <typename Layer, typename Visit>
void ForEachHit(const Layer& layer, const CellRect& rect, const Visit& visit) {
  for (CellIndex cell = rect.min; cell.y < rect.max.y; ++cell.y)
    for (cell.x = rect.min.x; cell.x < rect.max.x; ++cell.x)
      if (const std::optional<GatherHit> hit = layer.gather().At(layer.field(), cell))
        visit(cell, layer.BeliefAt(*hit));
}

// One layer has nobody to disagree with.
TileCells RenderOne(TileIndex tile, const SubmapLayer& layer) {
  TileCells cells;
  ForEachHit(layer, Intersection(TileRect(tile), layer.rect_G()),
             [&cells](CellIndex cell, const CellBelief& belief) {
               if (cells.empty()) cells.resize(kTileCells * kTileCells);
               cells[static_cast<std::size_t>(IndexInTile(cell))] = belief;
             });
  return cells;
}

using Contributions = absl::InlinedVector<CellBelief, 8>;

CellBelief Combine(Contributions& contributions, float gate_sigmas) {
  // Newest first; stable, so that ties keep the order of the layers.
  for (std::size_t i = 1; i < contributions.size(); ++i)
    for (std::size_t k = i; k > 0 && contributions[k - 1].stamp_ns < contributions[k].stamp_ns; --k)
      std::swap(contributions[k - 1], contributions[k]);
  CellBelief combined = contributions.front();
  for (std::size_t i = 1; i < contributions.size(); ++i) {
    const CellBelief& older = contributions[i];
    if (Agree(combined.elevation_m, combined.variance_m2, older.elevation_m, older.variance_m2,
              gate_sigmas))
      combined = Fuse(combined, older);
  }
  return combined;
}

}  // namespace

SubmapLayer::SubmapLayer(const PlacedSubmap& placed)
    : placed_(placed),
      gather_(placed.T_G_K.matrix(), placed.T_G_K.translation(),
              placed.submap->origin().cell_size_m, placed.submap->elevation_m_min(),
              placed.submap->elevation_m_max()),
      down_K_(placed.T_G_K.matrix().row(2)) {}

CellBelief SubmapLayer::BeliefAt(const GatherHit& hit) const {
  const SubmapCell cell = field().At(hit.position);
  const Covariance3& c = cell.covariance_m2;
  const double x = down_K_.x(), y = down_K_.y(), z = down_K_.z();
  const double variance_m2 =
      x * x * c[0] + y * y * c[3] + z * z * c[5] + 2 * (x * y * c[1] + x * z * c[2] + y * z * c[4]);
  return {hit.elevation_m,     static_cast<float>(variance_m2),
          cell.traversability, cell.rgba,
          cell.stamp_ns,       cell.state};
}

LocalLayer::LocalLayer(const PlacedLocalMap& placed)
    : placed_(placed),
      gather_(placed.T_G_O.matrix(), placed.T_G_O.translation(), placed.field->map().cell_size_m,
              placed.field->elevation_m_min(), placed.field->elevation_m_max()) {
  const Eigen::Vector3d down_O = placed.T_G_O.matrix().row(2);
  const double cell_size_m = placed.field->map().cell_size_m;
  variance_gain_ = static_cast<float>(down_O.z() * down_O.z());
  place_variance_m2_ = static_cast<float>((down_O.x() * down_O.x() + down_O.y() * down_O.y()) *
                                          cell_size_m * cell_size_m / 12.0);
}

CellBelief LocalLayer::BeliefAt(const GatherHit& hit) const {
  CellBelief belief = field().map().BeliefAt(hit.position);
  belief.elevation_m = hit.elevation_m;
  belief.variance_m2 = variance_gain_ * belief.variance_m2 + place_variance_m2_;
  return belief;
}

TileCells RenderSubmaps(TileIndex tile, const std::vector<const SubmapLayer*>& layers,
                        float gate_sigmas) {
  TileCells cells;
  if (layers.size() == 1) return RenderOne(tile, *layers.front());

  const CellRect tile_rect = TileRect(tile);
  std::vector<const SubmapLayer*> in_row;
  Contributions contributions;
  for (CellIndex cell = tile_rect.min; cell.y < tile_rect.max.y; ++cell.y) {
    in_row.clear();
    for (const SubmapLayer* layer : layers)
      if (cell.y >= layer->rect_G().min.y && cell.y < layer->rect_G().max.y)
        in_row.push_back(layer);
    if (in_row.empty()) continue;
    for (cell.x = tile_rect.min.x; cell.x < tile_rect.max.x; ++cell.x) {
      contributions.clear();
      for (const SubmapLayer* layer : in_row) {
        if (cell.x < layer->rect_G().min.x || cell.x >= layer->rect_G().max.x) continue;
        if (const std::optional<GatherHit> hit = layer->gather().At(layer->field(), cell))
          contributions.push_back(layer->BeliefAt(*hit));
      }
      if (contributions.empty()) continue;
      if (cells.empty()) cells.resize(kTileCells * kTileCells);
      cells[static_cast<std::size_t>(IndexInTile(cell))] = Combine(contributions, gate_sigmas);
    }
  }
  return cells;
}

TileCells RenderLocalMaps(TileIndex tile, const TileCells* base,
                          const std::vector<const LocalLayer*>& layers) {
  TileCells cells;
  std::vector<bool> on_top(kTileCells * kTileCells);
  for (const LocalLayer* layer : layers) {
    ForEachHit(*layer, Intersection(TileRect(tile), layer->rect_G()),
               [&](CellIndex cell, const CellBelief& belief) {
                 if (cells.empty())
                   cells = base == nullptr ? TileCells(kTileCells * kTileCells) : *base;
                 const std::size_t index = static_cast<std::size_t>(IndexInTile(cell));
                 if (on_top[index] && belief.stamp_ns <= cells[index].stamp_ns) return;
                 cells[index] = belief;
                 on_top[index] = true;
               });
  }
  return cells;
}

}  // namespace gem
