// The newest of a row of immutable values: one thread sets it, any thread takes it, and who takes
// it never waits. What std::atomic<std::shared_ptr> is for, which in libstdc++ 12 is a spin lock,
// and one that ThreadSanitizer finds a race in.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <memory>
#include <thread>
#include <utility>

namespace gem {

/// Left-right (Ramalhete and Correia, 2013): readers copy from one of two slots while the other one
/// is written, and say in one of two counters that they do.
template <typename T>
class Latest {
 public:
  Latest() = default;
  Latest(const Latest&) = delete;
  Latest& operator=(const Latest&) = delete;

  /// Null before the first Set(). Wait-free.
  std::shared_ptr<const T> Get() const {
    std::atomic<std::size_t>& readers = readers_[side_.load()];
    readers.fetch_add(1);
    std::shared_ptr<const T> value = slots_[front_.load()];
    readers.fetch_sub(1);
    return value;
  }

  /// By one thread at a time. Waits for readers that are copying a pointer at the moment.
  void Set(std::shared_ptr<const T> value) {
    const std::size_t old_front = front_.load();
    slots_[1 - old_front] = value;
    front_.store(1 - old_front);
    // Readers that came before that may still be at the old slot, and are in either counter.
    const std::size_t old_side = side_.load();
    WaitFor(readers_[1 - old_side]);
    side_.store(1 - old_side);
    WaitFor(readers_[old_side]);
    slots_[old_front] = std::move(value);
  }

 private:
  static void WaitFor(const std::atomic<std::size_t>& readers) {
    while (readers.load() != 0) std::this_thread::yield();
  }

  // All accesses are sequentially consistent: the proof needs one order of them.
  std::array<std::shared_ptr<const T>, 2> slots_;
  std::atomic<std::size_t> front_{0};  ///< the slot to copy from
  std::atomic<std::size_t> side_{0};   ///< the counter to enter
  mutable std::array<std::atomic<std::size_t>, 2> readers_{};
};

}  // namespace gem
