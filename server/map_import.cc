#include "server/map_import.h"

#include <algorithm>
#include <thread>
#include <utility>

#include "core/base/status_macros.h"
#include "core/base/thread_name.h"
#include "core/base/thread_priority.h"
#include "core/grid/cell_belief.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scalar.h"

namespace gem {
namespace {

/// A tile with what submaps alone say of it, and its share of coarser ones, at most.
constexpr std::uint64_t kTileMemoryBytes =
    5 * sizeof(CellBelief) * std::uint64_t{kTileCells} * kTileCells / 2;

map_file::Limits LimitsOf(const ServerOptions& options) {
  return {options.import_bytes_max, options.import_memory_bytes_max,
          static_cast<std::uint64_t>(options.sessions_per_map_max), options.map.odometry_poses_max,
          options.map.compose_threads};
}

/// Renders the map behind whatever is due.
bool Render(GlobalMapper& mapper, const CancelToken& cancel) {
  CommitReport report;
  std::thread([&] {
    NameThread("import");
    RunBehindOthers();
    mapper.Commit(cancel, report);
  }).join();
  return !report.cancelled;
}

}  // namespace

MapImport::MapImport(Registry& registry, const ServerOptions& options, TransferSlots& slots)
    : registry_(registry), options_(options), slots_(slots) {}

absl::StatusOr<std::shared_ptr<MapActor>> MapImport::Begin(const std::string& map,
                                                           const std::string& request_id) {
  GEM_RETURN_IF_ERROR(wire::CheckId(map, wire::FieldPath("map")));
  GEM_RETURN_IF_ERROR(wire::CheckRequestId(request_id, wire::FieldPath("request_id")));
  absl::StatusOr<std::shared_ptr<MapActor>> earlier = registry_.CheckNewMap(map, request_id);
  if (!earlier.ok() || *earlier != nullptr) return earlier;
  absl::StatusOr<std::unique_ptr<TransferSlots::Slot>> slot = slots_.Take();
  if (!slot.ok()) return slot.status();
  slot_ = *std::move(slot);
  map_ = map;
  request_id_ = request_id;
  reader_.emplace(LimitsOf(options_));
  return nullptr;
}

absl::Status MapImport::Feed(absl::string_view bytes) { return reader_->Feed(bytes); }

absl::StatusOr<std::shared_ptr<MapActor>> MapImport::Finish(const CancelToken& cancel) {
  const std::uint64_t tiles_max = reader_->memory_bytes_left() / kTileMemoryBytes;
  std::unique_ptr<GlobalMapper> mapper;
  {
    absl::StatusOr<MapState> state = reader_->Finish();
    if (!state.ok()) return state.status();
    auto made = GlobalMapper::FromState(*state, registry_.NewEpoch(), tiles_max);
    if (!made.ok())
      return wire::WithField(
          absl::Status(made.status().code(),
                       absl::StrCat("data: ", made.status().message(),
                                    ": what import_memory_bytes_max leaves room for")),
          "data");
    mapper = *std::move(made);
  }
  if (!Render(*mapper, cancel)) return absl::CancelledError("the client has gone");
  return registry_.EnterMap(map_, std::move(mapper), request_id_);
}

}  // namespace gem
