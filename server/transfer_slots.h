// How many maps are exported and imported at once: each holds the state of a map. Thread-safe.
#pragma once

#include <memory>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "core/base/mutex.h"
#include "server/retry.h"

namespace gem {

class TransferSlots {
 public:
  explicit TransferSlots(int slots_max) : slots_max_(slots_max) {}

  /// Given back when it is destroyed. The slots outlive it.
  class Slot {
   public:
    explicit Slot(TransferSlots& slots) : slots_(slots) {}
    ~Slot() { slots_.GiveBack(); }
    Slot(const Slot&) = delete;
    Slot& operator=(const Slot&) = delete;

   private:
    TransferSlots& slots_;
  };

  /// RESOURCE_EXHAUSTED, with when to retry, if all are taken.
  absl::StatusOr<std::unique_ptr<Slot>> Take() {
    constexpr double kRetryAfter_s = 5;
    MutexLock lock(mutex_);
    if (num_taken_ >= slots_max_)
      return WithRetry(
          absl::ResourceExhaustedError(absl::StrCat(num_taken_,
                                                    " maps are being exported or imported, want at "
                                                    "most ",
                                                    slots_max_, " (transfers_max)")),
          kRetryAfter_s);
    ++num_taken_;
    return std::make_unique<Slot>(*this);
  }

 private:
  void GiveBack() {
    MutexLock lock(mutex_);
    --num_taken_;
  }

  const int slots_max_;
  Mutex mutex_;
  int num_taken_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace gem
