#include "server/map_export.h"

#include <algorithm>
#include <utility>

namespace gem {
namespace {

/// gem.v1.ExportMapResponse.data.
constexpr int kDataField = 1;
/// With the rest of the message less than 1 MiB.
constexpr std::size_t kDataBytes_max = (std::size_t{1} << 20) - 1024;

}  // namespace

MapExport::MapExport(MapActor& map, std::unique_ptr<TransferSlots::Slot> slot,
                     NewsListener* readers)
    : slot_(std::move(slot)) {
  map.TakeState([inbox = inbox_, readers,
                 news = news_](absl::StatusOr<std::shared_ptr<const MapState>> state) {
    {
      MutexLock lock(inbox->mutex);
      inbox->state = std::move(state);
    }
    if (readers != nullptr) readers->OnNews(news);
  });
}

MessageSource::Next MapExport::End(const absl::Status& status) {
  // Before the client is told: it may come back at once.
  slot_.reset();
  Next next;
  next.end = status;
  return next;
}

MessageSource::Next MapExport::TakeNext(Clock::time_point /*now*/) {
  Next next;
  if (!writer_.has_value()) {
    std::optional<absl::StatusOr<std::shared_ptr<const MapState>>> state;
    {
      MutexLock lock(inbox_->mutex);
      state = std::exchange(inbox_->state, std::nullopt);
    }
    if (!state.has_value()) return next;
    if (!state->ok()) return End(state->status());
    writer_.emplace(**std::move(state));
  }
  if (sent_ == written_.size()) {
    std::optional<std::string> more = writer_->Next();
    if (!more.has_value()) return End(absl::OkStatus());
    written_ = *std::move(more);
    sent_ = 0;
  }
  const std::size_t size = std::min(kDataBytes_max, written_.size() - sent_);
  next.message.emplace();
  next.message->AppendField(kDataField, absl::string_view(written_).substr(sent_, size));
  sent_ += size;
  return next;
}

}  // namespace gem
