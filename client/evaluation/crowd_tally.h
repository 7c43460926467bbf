// What walkers leave in the local map, and what the clearing of it costs the things that stand,
// against the simulator's truth.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "client/simulation/ray_caster.h"
#include "client/simulation/world.h"
#include "core/local/local_map.h"

namespace gem::evaluation {

/// Counts map after map. O is G, and the ground is flat at z = 0.
class CrowdTally {
 public:
  /// The world outlives the tally.
  CrowdTally(const World& world, double cell_size_m) : world_(world), cell_size_m_(cell_size_m) {}

  /// The map after a scan that was taken at `time_s` from `sensor_m`.
  void Add(const LocalMap& map, const Eigen::Vector3d& sensor_m, double time_s);

  struct Counts {
    /// Cells that the map has shown high while a walker was in them or after.
    int walked = 0;
    /// Of them, in clear sight of the sensor at least once after the last walker left.
    int revealed = 0;
    int trails = 0;  ///< of these, high without a walker when the map last held them
    /// Of the walked cells that never came into sight again, high when the map last held them.
    int hidden_trails = 0;
    /// Pairs of a scan and a walked cell that is in clear sight and holds no walker.
    std::int64_t seen = 0;
    std::int64_t seen_trails = 0;  ///< of them, still high
    /// Cells whose middle a standing thing covers and that the map has shown high.
    int standing = 0;
    int standing_lost = 0;  ///< of them, not high in a later map
    int edges = 0;          ///< the same of cells that a thing covers, but not in their middle
    int edges_lost = 0;
    int things = 0;       ///< things of which the map has shown a high cell
    int things_lost = 0;  ///< of them, without any high cell in a later map that holds them whole
    int ground = 0;       ///< cells without thing or walker that the map has known
    int ground_lost = 0;  ///< of them, not known or high in a later map

    Counts& operator+=(const Counts& other);
  };
  Counts Count() const;

  struct Now {
    double time_s = 0;
    int walked = 0;       ///< cells in the window that walkers have made high, and have left
    int trails = 0;       ///< of them, still high
    int seen_trails = 0;  ///< of these, in clear sight
  };
  const std::vector<Now>& by_scan() const { return by_scan_; }

 private:
  enum class Truth : std::uint8_t { kGround, kThing, kEdge, kBesideThing };
  /// A standing thing.
  struct Thing {
    bool high = false;
    bool lost = false;
  };
  struct Track {
    Truth truth = Truth::kGround;
    bool swept = false;       ///< a walker was in it
    bool high = false;        ///< thing: has been high; else: has been high when or after swept
    bool lost = false;        ///< thing, ground: see Counts
    bool known = false;       ///< ground: has been known
    bool revealed = false;    ///< in sight since the last walker left
    bool high_alone = false;  ///< high without a walker in it, in the last map that held it
  };

  Track& TrackOf(CellIndex cell);
  /// Of standing things and the ground over the cell and a margin about it.
  double HighestIn(CellIndex cell, double margin_m) const;
  /// Whether nothing stands or walks between the sensor and any place of the cell, or close behind
  /// it.
  bool IsInSight(CellIndex cell, const Eigen::Vector2d& sensor_m, const RayCaster& low_rays) const;
  /// One scan of a cell where nothing stands; true if walkers have made it high, and have left.
  static bool AddOpen(Track& track, bool known, bool high, bool occupied);
  template <typename Solid>
  void AddThings(const LocalMap& map, const std::vector<Solid>& solids, std::vector<Thing>& things);

  // Constant after construction.
  const World& world_;
  const double cell_size_m_;

  absl::flat_hash_map<std::uint64_t, Track> tracks_;  ///< by PackedKey()
  std::vector<Thing> boxes_, cylinders_;
  std::int64_t seen_ = 0, seen_trails_ = 0;
  std::vector<Now> by_scan_;
};

}  // namespace gem::evaluation
