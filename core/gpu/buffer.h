// Owned memory of the device and pinned memory of the host, by the number of elements.
#pragma once

#include <algorithm>
#include <cstddef>
#include <type_traits>
#include <utility>

#include "core/base/status_macros.h"
#include "core/gpu/runtime.h"

namespace gem::gpu {

/// Grows and never shrinks; growing forgets the content. T is plain data.
template <typename T, absl::StatusOr<void*> (*Allocate)(std::size_t), void (*Release)(void*)>
class Buffer {
 public:
  static_assert(std::is_trivially_copyable_v<T>);

  Buffer() = default;
  Buffer(Buffer&& other) noexcept
      : data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}
  Buffer& operator=(Buffer&&) = delete;
  ~Buffer() { Reset(); }

  /// At least `size` elements. Nothing that still runs may use the buffer when it grows.
  absl::Status Grow(std::size_t size) {
    if (size <= size_) return absl::OkStatus();
    // Half as much again, so that scans that grow a little each time do not allocate each time.
    const std::size_t grown = size_ == 0 ? size : std::max(size, size_ + size_ / 2);
    Reset();
    GEM_ASSIGN_OR_RETURN(void* const memory, Allocate(grown * sizeof(T)));
    data_ = static_cast<T*>(memory);
    size_ = grown;
    return absl::OkStatus();
  }

  T* data() const { return data_; }
  std::size_t size() const { return size_; }

 private:
  void Reset() {
    if (data_ != nullptr) Release(data_);
    data_ = nullptr;
    size_ = 0;
  }

  T* data_ = nullptr;
  std::size_t size_ = 0;
};

template <typename T>
using DeviceBuffer = Buffer<T, Malloc, Free>;
template <typename T>
using PinnedBuffer = Buffer<T, HostAlloc, HostFree>;

}  // namespace gem::gpu
