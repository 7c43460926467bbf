// Answers by request id, so that a request that is sent again changes nothing. Bounded: the oldest
// are forgotten first. Not thread-safe.
#pragma once

#include <cstddef>
#include <deque>
#include <string>
#include <utility>

#include "absl/container/flat_hash_map.h"

namespace gem {

template <typename Answer>
class AnswerMemory {
 public:
  explicit AnswerMemory(std::size_t answers_max) : answers_max_(answers_max) {}

  /// Null if there is none, or if the request id is empty. of: what the request is about; the same
  /// id may be used for two things.
  const Answer* Find(const std::string& of, const std::string& request_id) const {
    if (request_id.empty()) return nullptr;
    const auto found = answers_.find(Key(of, request_id));
    return found == answers_.end() ? nullptr : &found->second;
  }

  /// Nothing for an empty request id.
  void Remember(const std::string& of, const std::string& request_id, const Answer& answer) {
    if (request_id.empty()) return;
    Key key(of, request_id);
    if (!answers_.emplace(key, answer).second) return;
    order_.push_back(std::move(key));
    if (order_.size() <= answers_max_) return;
    answers_.erase(order_.front());
    order_.pop_front();
  }

 private:
  using Key = std::pair<std::string, std::string>;
  const std::size_t answers_max_;
  absl::flat_hash_map<Key, Answer> answers_;
  std::deque<Key> order_;
};

}  // namespace gem
