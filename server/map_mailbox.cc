#include "server/map_mailbox.h"

#include <iterator>

namespace gem {

void Coalesce(PendingSession& pending, SessionUpdate update) {
  SessionUpdate& waiting = pending.update;
  waiting.odometry.insert(waiting.odometry.end(), update.odometry.begin(), update.odometry.end());
  waiting.finished.insert(waiting.finished.end(), std::make_move_iterator(update.finished.begin()),
                          std::make_move_iterator(update.finished.end()));
  waiting.active = std::move(update.active);
  waiting.local_map = std::move(update.local_map);
  waiting.ended = waiting.ended || update.ended;
  pending.has_update = true;
}

}  // namespace gem
