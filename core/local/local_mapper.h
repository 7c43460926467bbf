// The local dense mapper (paper section IV, Algorithm 1): fuses scans into a robocentric map.
// Several backends, one contract; the map depends on the scans and their order only, never on
// threads or timing.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/local/local_map.h"
#include "core/local/local_map_options.h"
#include "core/sensor/scan.h"

namespace gem {

/// Wall time of the stages of one scan, seconds.
struct LocalStageSeconds {
  double move = 0;
  double measure = 0;
  double fuse = 0;
  double annotate = 0;
  double clear = 0;
  double total() const { return move + measure + fuse + annotate + clear; }
};

/// What one scan did. Every point is counted once: points = the sum of the six point counts below
/// it.
struct ScanReport {
  LocalStageSeconds seconds;
  std::uint64_t points = 0;
  std::uint64_t points_outside_window = 0;  ///< in range and height, but not over the window
  std::uint64_t points_out_of_range = 0;    ///< nearer or farther than the range limits
  std::uint64_t points_out_of_height = 0;   ///< outside the height window
  std::uint64_t points_on_body = 0;         ///< inside the body box
  std::uint64_t points_fused = 0;           ///< passed the gate, or began or restarted a cell
  std::uint64_t points_gated = 0;           ///< in the window, but failed the gate
  std::uint64_t cells_evicted = 0;
  std::uint64_t cells_restarted = 0;  ///< the highest point was above the gate
  std::uint64_t cells_inflated = 0;   ///< traversable, and the highest point was below the gate
  std::uint64_t cells_cleared = 0;    ///< what rays passed below: see LocalMapOptions
};

class LocalMapper {
 public:
  virtual ~LocalMapper() = default;

  /// A scan is being decoded: threads of the mapper that sleep wake up meanwhile. It changes
  /// nothing but the time of the next FuseScan().
  virtual void Expect() {}

  /// Moves the window over the base, appends the cells that left it to `evicted`, then measures,
  /// fuses, annotates and clears. The scan is valid: finite points and poses, |position| <=
  /// kCoordinateMax_m, stamps that increase. Does not allocate once buffers have grown to the
  /// largest scan (`evicted` included).
  virtual ScanReport FuseScan(const Scan& scan, std::vector<EvictedCell>& evicted) = 0;

  /// Copies the map as it is after the last scan; buffers in `map` are reused.
  virtual void CopyTo(LocalMap& map) const = 0;

  /// Appends every known cell and forgets it: the session ends here.
  virtual void EvictAll(std::vector<EvictedCell>& evicted) = 0;
};

enum class LocalBackend {
  kReference,
  kCpu,
  kCuda,  ///< the bits of kCpu, from a GPU
  kAuto,  ///< kCuda where there is a device, else kCpu
};

/// Threads that one mapper may work with.
inline constexpr int kLocalThreadsMax = 64;

/// threads: how many work on a scan, the caller among them; the map is the same bit for bit. Range
/// [1, kLocalThreadsMax]. `reference` takes one, and kCuda ignores it. INVALID_ARGUMENT names the
/// option, its value and its range. kCuda: UNAVAILABLE without a device, RESOURCE_EXHAUSTED without
/// memory for one more map on it.
absl::StatusOr<std::unique_ptr<LocalMapper>> MakeLocalMapper(LocalBackend backend,
                                                             const LocalMapOptions& options,
                                                             int threads = 1);

/// What is there on this machine of what is wanted.
struct BackendChoice {
  LocalBackend backend = LocalBackend::kCpu;  ///< never kAuto
  std::string why_not_cuda;                   ///< set if kCpu stands in for kCuda
};
BackendChoice ChooseLocalBackend(LocalBackend wanted);

/// "reference", "cpu", "cuda" or "auto". INVALID_ARGUMENT for anything else.
absl::StatusOr<LocalBackend> ParseLocalBackend(absl::string_view name);
absl::string_view NameOf(LocalBackend backend);

}  // namespace gem
