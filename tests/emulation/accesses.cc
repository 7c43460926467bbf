#include "tests/emulation/accesses.h"

#include <cstdint>

#include "absl/container/flat_hash_map.h"
#include "tests/emulation/device_memory.h"
#include "tests/emulation/emulation.h"
#include "tests/emulation/execution.h"

namespace gem::gpu::emulation {
namespace {

// The last accesses of one kind to one place.
struct Last {
  static constexpr std::uint32_t kMany = 0xffffffffu;
  std::uint32_t thread = 0, block = 0;  // kMany: of more than one
  std::uint32_t phase = 0;              // the latest
  bool any = false;

  /// True if they may come at the same time as something that `now` does.
  bool MayMeet(const ThreadPlace& now) const {
    if (!any || thread == now.thread) return false;
    return block != now.block || phase == now.phase;
  }
  void Add(const ThreadPlace& now) {
    const bool before = any && block == now.block && phase < now.phase;
    if (!any || before) {
      *this = {now.thread, now.block, now.phase, true};
      return;
    }
    if (thread != now.thread) thread = kMany;
    if (block != now.block) block = kMany;
    if (phase < now.phase) phase = now.phase;
  }
};

struct Place {
  Last reads, writes, atomics;
};

using Places = absl::flat_hash_map<std::uintptr_t, Place>;

Places& GlobalPlaces() {
  static auto* const places = new Places;
  return *places;
}
Places& SharedPlaces() {
  static auto* const places = new Places;
  return *places;
}

enum class Kind { kRead, kWrite, kAtomic };

void Note(std::uintptr_t address, Kind kind) {
  const ThreadPlace now = RunningThread();
  Place& place = (IsShared(address) ? SharedPlaces() : GlobalPlaces())[address];
  const bool races = place.writes.MayMeet(now) ||
                     (kind != Kind::kRead && place.reads.MayMeet(now)) ||
                     (kind != Kind::kAtomic && place.atomics.MayMeet(now));
  if (races) Report("two threads race for one place in memory");
  (kind == Kind::kRead    ? place.reads
   : kind == Kind::kWrite ? place.writes
                          : place.atomics)
      .Add(now);
}

// Wide accesses are told apart by words; narrow ones keep their address, so that neighbours in one
// word do not race.
[[maybe_unused]] void NoteAll(const void* memory, std::size_t size_bytes, Kind kind) {
  if (!InDeviceRange(memory) || !InKernel()) return;
  const auto address = reinterpret_cast<std::uintptr_t>(memory);
  for (std::size_t i = 0; i < size_bytes; i += 4) Note(address + i, kind);
  // After the access was noted and before it happens: a value may change between read and write.
  MaybeSwitch(97);
}

}  // namespace

void BeginKernelAccesses() { GlobalPlaces().clear(); }
void BeginBlockAccesses() { SharedPlaces().clear(); }

void NoteAtomic(const void* memory) {
  if (SeesEveryAccess()) Note(reinterpret_cast<std::uintptr_t>(memory), Kind::kAtomic);
}

#if defined(GEM_SEES_EVERY_ACCESS)
bool SeesEveryAccess() { return true; }
#else
bool SeesEveryAccess() { return false; }
#endif

}  // namespace gem::gpu::emulation

#if defined(GEM_SEES_EVERY_ACCESS)
// The interface between compilers and ThreadSanitizer, as far as kernels need it.
using gem::gpu::emulation::Kind;
using gem::gpu::emulation::NoteAll;

#define GEM_ACCESS(bytes)                                                                    \
  void __tsan_read##bytes(void* memory) { NoteAll(memory, bytes, Kind::kRead); }             \
  void __tsan_write##bytes(void* memory) { NoteAll(memory, bytes, Kind::kWrite); }           \
  void __tsan_unaligned_read##bytes(void* memory) { NoteAll(memory, bytes, Kind::kRead); }   \
  void __tsan_unaligned_write##bytes(void* memory) { NoteAll(memory, bytes, Kind::kWrite); } \
  void __tsan_volatile_read##bytes(void* memory) { NoteAll(memory, bytes, Kind::kRead); }    \
  void __tsan_volatile_write##bytes(void* memory) { NoteAll(memory, bytes, Kind::kWrite); }

extern "C" {
GEM_ACCESS(1)
GEM_ACCESS(2)
GEM_ACCESS(4)
GEM_ACCESS(8)
GEM_ACCESS(16)
void __tsan_read_range(void* memory, std::size_t size) { NoteAll(memory, size, Kind::kRead); }
void __tsan_write_range(void* memory, std::size_t size) { NoteAll(memory, size, Kind::kWrite); }
void __tsan_init() {}
void __tsan_func_entry(void*) {}
void __tsan_func_exit() {}
void __tsan_vptr_update(void**, void*) {}
void __tsan_vptr_read(void**) {}
}
#endif
