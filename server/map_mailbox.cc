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

const CorrectionAnswer* AnswerMemory::Find(const std::string& session,
                                           const std::string& request_id) const {
  if (request_id.empty()) return nullptr;
  const auto found = answers_.find(Key(session, request_id));
  return found == answers_.end() ? nullptr : &found->second;
}

void AnswerMemory::Remember(const std::string& session, const std::string& request_id,
                            const CorrectionAnswer& answer) {
  if (request_id.empty()) return;
  Key key(session, request_id);
  if (!answers_.emplace(key, answer).second) return;
  order_.push_back(std::move(key));
  if (order_.size() <= answers_max_) return;
  answers_.erase(order_.front());
  order_.pop_front();
}

}  // namespace gem
