// How two beliefs of the same place become one in the global map: fused if they agree, else the
// newer one. Pure functions; the local mapper's rules for scans are its own.
#pragma once

#include "core/global/submap.h"
#include "core/grid/cell_belief.h"

namespace gem {

/// True if the heights differ by at most gate_sigmas standard deviations of their difference, eq.
/// (5).
bool Agree(float elevation_a_m, float variance_a_m2, float elevation_b_m, float variance_b_m2,
           float gate_sigmas);

/// Variance-weighted fusion, eq. (6), of height, traversability and colour. The stamp is the newer
/// one.
CellBelief Fuse(const CellBelief& a, const CellBelief& b);

/// The same for points with covariance. The height gets surer; the place within the cell does not,
/// as it comes from the cell's size. Keeps the matrix positive semidefinite.
SubmapCell Fuse(const SubmapCell& a, const SubmapCell& b);

inline float HeightVariance(const Covariance3& covariance_m2) { return covariance_m2[5]; }

}  // namespace gem
