// The messages of ExportMap: a map's state, taken once between two of its revisions, written as it
// is sent. Whoever does not read holds that state and one message, and nobody up.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "core/base/mutex.h"
#include "server/map_actor.h"
#include "server/map_file/writer.h"
#include "server/message_source.h"
#include "server/news.h"
#include "server/transfer_slots.h"

namespace gem {

class MapExport final : public MessageSource {
 public:
  /// Asks the map for its state. readers: hears of news() when it is there, outlives the map; may
  /// be null.
  MapExport(MapActor& map, std::unique_ptr<TransferSlots::Slot> slot, NewsListener* readers);

  NewsSource news() const { return news_; }
  Next TakeNext(Clock::time_point now) override;
  /// A file is not late.
  std::optional<Clock::time_point> behind_since() const override { return std::nullopt; }

 private:
  /// Outlives the export until the map has answered.
  struct Inbox {
    Mutex mutex;
    std::optional<absl::StatusOr<std::shared_ptr<const MapState>>> state ABSL_GUARDED_BY(mutex);
  };

  Next End(const absl::Status& status);

  std::unique_ptr<TransferSlots::Slot> slot_;  ///< null once all is said
  const NewsSource news_ = NewNewsSource();
  const std::shared_ptr<Inbox> inbox_ = std::make_shared<Inbox>();
  std::optional<map_file::Writer> writer_;  ///< once the state is there
  std::string written_;                     ///< from sent_ on it is to be sent
  std::size_t sent_ = 0;
};

}  // namespace gem
