#include "server/local_map_feed.h"

#include <utility>

namespace gem {

std::uint64_t LocalMapFeed::Begin(LocalMapOrigin origin) {
  auto shared = std::make_shared<const LocalMapOrigin>(std::move(origin));
  std::shared_ptr<const LocalMap> old;  // freed after the lock is released
  MutexLock lock(mutex_);
  old = std::exchange(newest_.map, nullptr);
  newest_.origin = std::move(shared);
  return ++last_ticket_;
}

void LocalMapFeed::Publish(std::uint64_t ticket, std::shared_ptr<const LocalMap> map) {
  {
    MutexLock lock(mutex_);
    if (ticket != last_ticket_) return;
    newest_.map.swap(map);
    ++newest_.number;
    newest_.since = Clock::now();
  }
  if (listener_ != nullptr) listener_->OnNews(source_);
}

LocalMapFeed::Newest LocalMapFeed::newest() const {
  MutexLock lock(mutex_);
  return newest_;
}

}  // namespace gem
