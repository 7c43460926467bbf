// Collects the cells that leave one session's local map into submaps (paper section V-A).
// One builder per session, used by the session's thread only. Everything it hands out is immutable.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/hash/hash.h"
#include "core/geometry/pose.h"
#include "core/global/global_map_options.h"
#include "core/global/submap.h"
#include "core/grid/cell_belief.h"

namespace gem {

/// Uncertainty of the trajectory pose that a submap hangs on, for eq. (11).
struct AnchorCovariance {
  Eigen::Matrix3d rotation_rad2 = Eigen::Matrix3d::Zero();   ///< Sigma_phi, in B
  Eigen::Matrix3d translation_m2 = Eigen::Matrix3d::Zero();  ///< Sigma_t, in O
};

class SubmapBuilder {
  struct CellHash {
    std::size_t operator()(CellIndex cell) const {
      return absl::Hash<std::uint64_t>()(PackedKey(cell));
    }
  };

 public:
  SubmapBuilder(std::string session, std::string robot, const GlobalMapOptions& options);

  /// Takes the cells that left the window when the robot came to T_O_B: they enter the submap that
  /// is active until now. Then, if the path since that submap's anchor has reached submap_length_m,
  /// that submap is finished and returned, and a new one is anchored here. The first call anchors
  /// the first submap. A submap without cells is not returned: it is re-anchored. A cell that comes
  /// back is fused with what the submap holds of it if they agree within the gate; else the newer
  /// one stays. Every scan's pose must be told, so that a submap's extent stays bounded.
  std::shared_ptr<const Submap> Add(std::int64_t stamp_ns, const Pose<Odom, Base>& T_O_B,
                                    const AnchorCovariance& covariance,
                                    const std::vector<EvictedCell>& evicted);

  /// Takes the last cells and finishes; nothing if the active submap is empty. Add() may begin a
  /// new one.
  std::shared_ptr<const Submap> Finish(const std::vector<EvictedCell>& evicted);

  /// The active submap as it is now; nothing if it is empty. Its SubmapId is 0 until the global
  /// mapper adopts it.
  std::shared_ptr<const Submap> ActiveSnapshot() const;

 private:
  struct Anchor {
    std::int64_t stamp_ns = 0;
    Pose<Odom, Base> T_O_B;
    Pose<Odom, Submap> T_O_K;
    CellIndex origin;                ///< cell of O whose lower left corner is the origin of K
    Eigen::Matrix3d rotation_rad2;   ///< Sigma_phi, in O
    Eigen::Matrix3d translation_m2;  ///< Sigma_t, in O
    double path_m = 0;               ///< driven since
  };

  void SetAnchor(std::int64_t stamp_ns, const Pose<Odom, Base>& T_O_B,
                 const AnchorCovariance& covariance);
  void Insert(const std::vector<EvictedCell>& evicted);
  bool Full(const Pose<Odom, Base>& T_O_B) const;
  Covariance3 CovarianceOf(CellIndex cell, const CellBelief& belief) const;
  std::shared_ptr<const Submap> Vectorise() const;
  void Forget();

  // Constant after construction.
  const std::string session_;
  const std::string robot_;
  const GlobalMapOptions options_;

  std::optional<Anchor> anchor_;
  Eigen::Vector3d last_position_O_ = Eigen::Vector3d::Zero();
  /// The hash grid: beliefs as they came, elevation over z = 0 of O, by cell of K. The covariance
  /// of eq. (11) follows from the cell's place and the anchor, so it is added on the way out.
  absl::flat_hash_map<CellIndex, CellBelief, CellHash> cells_;
  CellRect rect_;  ///< of cells_, in K
};

}  // namespace gem
