// Makes a map of a file that comes in piece by piece; all of it or nothing. Knows no calls.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "core/base/cancel_token.h"
#include "server/map_file/reader.h"
#include "server/options.h"
#include "server/registry.h"
#include "server/transfer_slots.h"

namespace gem {

class MapImport {
 public:
  /// All outlive it. options are valid.
  MapImport(Registry& registry, const ServerOptions& options, TransferSlots& slots);

  /// Once, first. The map that the same request made before, or null: the file is to be fed.
  /// INVALID_ARGUMENT names the field; ALREADY_EXISTS, FAILED_PRECONDITION and RESOURCE_EXHAUSTED
  /// as with Registry::CreateMap; RESOURCE_EXHAUSTED if too many maps are on their way.
  absl::StatusOr<std::shared_ptr<MapActor>> Begin(const std::string& map,
                                                  const std::string& request_id);
  /// The next bytes of the file. An error is final and names the place in the file.
  absl::Status Feed(absl::string_view bytes);
  /// The file is complete: makes the map, which takes as long as its tiles take to render.
  /// CANCELLED if `cancel` is raised meanwhile.
  absl::StatusOr<std::shared_ptr<MapActor>> Finish(const CancelToken& cancel);

 private:
  Registry& registry_;
  const ServerOptions& options_;
  TransferSlots& slots_;
  std::unique_ptr<TransferSlots::Slot> slot_;  ///< from Begin() on
  std::string map_;
  std::string request_id_;
  std::optional<map_file::Reader> reader_;  ///< from Begin() on
};

}  // namespace gem
