// Renders one tile by gathering (paper section V-B, "Render a global dense map", but pulling cells
// instead of pushing points). Pure functions: safe on several threads at once.
#pragma once

#include <vector>

#include "core/global/gather.h"
#include "core/global/placement.h"
#include "core/grid/cell_belief.h"

namespace gem {

/// kTileCells * kTileCells cells by IndexInTile().
using TileCells = std::vector<CellBelief>;

/// A placed submap, made ready for many look-ups.
class SubmapLayer {
 public:
  /// Keeps a reference.
  explicit SubmapLayer(const PlacedSubmap& placed);

  const PlacedSubmap& placed() const { return placed_; }
  const CellRect& rect_G() const { return placed_.rect_G; }
  const Submap& field() const { return *placed_.submap; }
  const Gather& gather() const { return gather_; }
  /// Height over z = 0 of G; variance: the zz entry of R * Sigma * R^T.
  CellBelief BeliefAt(const GatherHit& hit) const;

 private:
  const PlacedSubmap& placed_;
  Gather gather_;
  Eigen::Vector3d down_K_;  ///< z of G in K
};

/// The same for a local map: its cells know their variance along z of O, and lie anywhere in their
/// cell.
class LocalLayer {
 public:
  /// Keeps a reference.
  explicit LocalLayer(const PlacedLocalMap& placed);

  const CellRect& rect_G() const { return placed_.rect_G; }
  const LocalField& field() const { return *placed_.field; }
  const Gather& gather() const { return gather_; }
  CellBelief BeliefAt(const GatherHit& hit) const;

 private:
  const PlacedLocalMap& placed_;
  Gather gather_;
  float variance_gain_ = 1;
  float place_variance_m2_ = 0;
};

/// The tile as the submaps know it; empty if they know no cell. Where several know a cell, the
/// newest observation counts, fused with those that agree with it within the gate; ties go to the
/// layer that comes first.
TileCells RenderSubmaps(TileIndex tile, const std::vector<const SubmapLayer*>& layers,
                        float gate_sigmas);

/// The tile with the local maps on top of `base` (null: no submap knows a cell): where one knows a
/// cell, it replaces what the submaps say; among several the newest observation wins, ties go to
/// the first. Empty if no local map shows here.
TileCells RenderLocalMaps(TileIndex tile, const TileCells* base,
                          const std::vector<const LocalLayer*>& layers);

}  // namespace gem
