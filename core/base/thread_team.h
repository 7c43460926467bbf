// A few threads that work together for fractions of a millisecond, again and again. For work of
// many milliseconds, ParallelFor is simpler.
#pragma once

#include <atomic>
#include <cstdint>
#include <thread>
#include <vector>

namespace gem {

class ThreadTeam {
 public:
  /// Starts size - 1 threads; the caller of Run() is the first of the team. size >= 1.
  explicit ThreadTeam(int size);
  ~ThreadTeam();
  ThreadTeam(const ThreadTeam&) = delete;
  ThreadTeam& operator=(const ThreadTeam&) = delete;

  int size() const { return static_cast<int>(threads_.size()) + 1; }

  /// Work is to come within a tenth of a millisecond: those who sleep wake up meanwhile. For the
  /// caller of Run().
  void Wake();

  /// Calls work(i) for i in [0, size()), each on a thread of its own, and returns when all are
  /// done. Allocates nothing. One caller at a time; work must not throw or call Run().
  template <typename Work>
  void Run(const Work& work) {
    RunErased([](const void* erased, int i) { (*static_cast<const Work*>(erased))(i); }, &work);
  }

 private:
  using Erased = void (*)(const void*, int);

  void RunErased(Erased call, const void* work);
  void Serve(int i);

  // Written by the caller of Run() while the others wait for the next round.
  Erased call_ = nullptr;  // null: the team is dismissed
  const void* work_ = nullptr;

  std::atomic<std::uint32_t> round_{0};
  std::atomic<std::uint32_t> num_busy_{0};
  std::vector<std::jthread> threads_;
};

/// Piece i of `pieces` nearly equal pieces of [0, count).
struct Piece {
  std::size_t begin, end;
};
inline Piece PieceOf(std::size_t count, int i, int pieces) {
  const auto at = [&](int k) {
    return count * static_cast<std::size_t>(k) / static_cast<std::size_t>(pieces);
  };
  return {at(i), at(i + 1)};
}

}  // namespace gem
