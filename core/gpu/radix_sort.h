// A stable sort of 32-bit keys with their positions, least significant digit first, and the prefix
// sum that it takes. Integers and fixed orders only: the same result whatever order threads run in.
#pragma once

#include <cstdint>

#include "core/gpu/buffer.h"

namespace gem::gpu {

/// values[i] becomes the sum of all before it. One block does it: for short arrays.
void EnqueueExclusiveScan(std::uint32_t* values, std::uint32_t count, Stream& stream);

/// The key of an item that is left out.
inline constexpr std::uint32_t kNoKey = 0xffffffffu;

/// Keys and what a sort needs beside them.
class SortBuffers {
 public:
  /// For up to `count` items; forgets what is there.
  absl::Status Grow(std::uint32_t count);

  /// keys(): to be filled before EnqueueSort, and in order after it. positions(): where the keys
  /// were before, in the order of the keys; equal keys stay in their order. num_items(): how many
  /// are left of both, one number of the device.
  std::uint32_t* keys() const { return keys_[now_].data(); }
  std::uint32_t* positions() const { return positions_[now_].data(); }
  const std::uint32_t* num_items() const { return num_items_.data(); }

  /// Leaves out the items with kNoKey and sorts the others. Their keys are below 2^key_bits. 1 <=
  /// count.
  void EnqueueSort(std::uint32_t count, std::uint32_t key_bits, Stream& stream);

 private:
  void EnqueueKeep(std::uint32_t count, std::uint32_t blocks, Stream& stream);

  DeviceBuffer<std::uint32_t> keys_[2], positions_[2];
  DeviceBuffer<std::uint32_t> digit_counts_, num_items_;
  int now_ = 0;
};

}  // namespace gem::gpu
