// Puts a map together from the sections of its file, in their order. Every count and every value is
// judged before it is acted on; what the map takes in memory is counted before it is allocated.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_set.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/global/map_state.h"
#include "server/map_file/byte_reader.h"
#include "server/map_file/format.h"
#include "server/map_file/limits.h"

namespace gem::map_file {

class Assembly {
 public:
  explicit Assembly(const Limits& limits) : limits_(limits) {}

  /// The next section. INVALID_ARGUMENT "field is value, want limit"; RESOURCE_EXHAUSTED.
  absl::Status Take(SectionType type, absl::string_view raw);

  /// After the section END. Only once.
  absl::StatusOr<MapState> Finish();

  std::uint64_t memory_bytes_left() const { return limits_.memory_bytes_max - memory_bytes_; }

 private:
  /// A submap whose sections are coming in.
  struct Piece {
    SubmapRole role{};
    SubmapId id{};
    SubmapOrigin origin;
    std::optional<Pose<Global, Submap>> left_T_G_K;
    std::vector<SubmapPart> parts;
    std::size_t num_sources = 0;
    std::size_t num_cells = 0;
    Sources sources;
    std::vector<KeyedSubmapCell> cells;
    CellRect groups;               ///< that hold cells, in groups
    CellIndex last_group;          ///< in groups
    std::uint64_t cell_bytes = 0;  ///< counted for `cells`
  };

  /// The section that must come next.
  SectionType Due() const;
  void TakeMap(ByteReader& from);
  void TakeSession(ByteReader& from);
  void TakeOdometry(ByteReader& from);
  void TakeCorrections(ByteReader& from);
  void TakeSubmap(ByteReader& from);
  void TakeParts(ByteReader& from);
  void TakeSources(ByteReader& from);
  void TakeCells(ByteReader& from);
  /// The cells of a section, in their order.
  std::vector<CellIndex> TakeGroups(ByteReader& from);
  bool TakeGroup(CellIndex group, ByteReader& from);
  void TakeLocalMap(ByteReader& from);
  void TakeLocalCells(ByteReader& from);
  void TakeEnd(ByteReader& from);
  void CheckPlace(const Piece& piece, ByteReader& from);
  /// The piece is complete.
  void FinishPiece(ByteReader& from);
  /// Counts memory before it is allocated.
  bool Spend(std::uint64_t bytes, ByteReader& from);

  const Limits limits_;
  MapState state_;
  bool has_map_ = false;
  bool complete_ = false;
  std::uint64_t num_sections_ = 0;
  std::uint32_t num_sessions_ = 0;
  std::uint32_t num_pieces_ = 0;  ///< still to come
  std::uint64_t memory_bytes_ = 0;
  bool too_much_ = false;

  // Of the session that is coming in.
  std::uint64_t odometry_left_ = 0;
  std::uint64_t corrections_left_ = 0;
  bool submap_left_ = false;
  bool local_map_left_ = false;
  std::shared_ptr<LocalMap> local_map_;  ///< null: none is coming in
  std::int32_t local_rows_ = 0;          ///< of it, that have come

  std::optional<Piece> piece_;
  absl::flat_hash_set<std::string> ids_;                    ///< of sessions
  absl::flat_hash_set<std::uint64_t> growing_;              ///< ids of growing submaps
  std::set<std::pair<std::int64_t, std::string>> anchors_;  ///< stamp and session of submaps
};

}  // namespace gem::map_file
