// Requests of one kind that are answered later: whoever repeats one that is on its way waits for
// the same answer, whoever repeats one that is done gets the answer from before. Not thread-safe.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "absl/container/btree_map.h"
#include "absl/status/statusor.h"
#include "server/answer_memory.h"

namespace gem {

template <typename Answer>
class RequestBook {
 public:
  using Callback = std::function<void(const absl::StatusOr<Answer>&)>;

  explicit RequestBook(std::size_t answers_max) : answers_(answers_max) {}

  /// Requests without an answer, repeated ones included.
  int num_waiting() const { return num_waiting_; }

  /// The answer of an earlier request with the id. Null if there is none.
  const Answer* Find(const std::string& of, const std::string& request_id) const {
    return answers_.Find(of, request_id);
  }
  /// Counts a request. True: it repeats one that is on its way, whose answer `done` will get.
  /// False: `done` is left to the caller, who calls Close() when it has an answer.
  bool JoinOrOpen(const std::string& of, const std::string& request_id, Callback& done) {
    ++num_waiting_;
    if (request_id.empty()) return false;
    auto [repeats, is_new] = on_their_way_.try_emplace({of, request_id});
    if (!is_new) repeats->second.push_back(std::move(done));
    return !is_new;
  }
  /// The request has its answer, which is remembered unless it is an error. Returns those who
  /// repeated it: they are to be told.
  std::vector<Callback> Close(const std::string& of, const std::string& request_id,
                              const absl::StatusOr<Answer>& answer) {
    if (answer.ok()) answers_.Remember(of, request_id, *answer);
    std::vector<Callback> repeats;
    const auto found = on_their_way_.find({of, request_id});
    if (found != on_their_way_.end()) {
      repeats = std::move(found->second);
      on_their_way_.erase(found);
    }
    num_waiting_ -= 1 + static_cast<int>(repeats.size());
    return repeats;
  }

 private:
  AnswerMemory<Answer> answers_;
  absl::btree_map<std::pair<std::string, std::string>, std::vector<Callback>> on_their_way_;
  int num_waiting_ = 0;
};

}  // namespace gem
