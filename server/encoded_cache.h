// Encoded cells, ready to be sent: each encoded once, however many ask for it at the same time, and
// kept while there is room. Knows neither tiles nor encodings. Thread-safe.
#pragma once

#include <cstdint>
#include <functional>
#include <list>
#include <memory>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "core/base/mutex.h"
#include "core/grid/cell_index.h"
#include "proto/wire/tile_message.h"
#include "server/news.h"

namespace gem {

/// Everything that the bytes depend on.
struct EncodedKey {
  NewsSource source{};         ///< the map, or the robot
  std::uint64_t revision = 0;  ///< of the tile's last change; number of the local map
  TileAddress address;         ///< zero for a local map
  std::uint32_t layers = 0;    ///< a bit for each; they lie in the order of their numbers
  wire::CellEncoding encoding{};

  friend bool operator==(const EncodedKey&, const EncodedKey&) = default;
  template <typename H>
  friend H AbslHashValue(H h, const EncodedKey& k) {
    return H::combine(std::move(h), k.source, k.revision, k.address, k.layers, k.encoding);
  }
};

class EncodedCache {
 public:
  using Encoded = std::shared_ptr<const wire::EncodedCells>;

  explicit EncodedCache(std::uint64_t bytes_max) : bytes_max_(bytes_max) {}

  /// What is kept, or what `encode` makes. Whoever asks for what another thread is encoding waits
  /// for that thread, which waits for nobody.
  Encoded Get(const EncodedKey& key, const std::function<wire::EncodedCells()>& encode);

  struct Stats {
    std::uint64_t num_hits = 0;  ///< those who waited for another thread among them
    std::uint64_t num_misses = 0;
    std::uint64_t num_evicted = 0;
    std::uint64_t bytes = 0;
  };
  Stats stats() const;

 private:
  struct Entry {
    EncodedKey key;
    Encoded encoded;
  };
  /// Somebody is encoding.
  struct Flight {
    Encoded encoded;  ///< null until it has landed
  };

  void InsertLocked(const EncodedKey& key, Encoded encoded, std::vector<Encoded>& evicted)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const std::uint64_t bytes_max_;

  mutable Mutex mutex_;
  CondVar landed_;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);  ///< used last in front
  absl::flat_hash_map<EncodedKey, std::list<Entry>::iterator> index_ ABSL_GUARDED_BY(mutex_);
  absl::flat_hash_map<EncodedKey, std::shared_ptr<Flight>> flights_ ABSL_GUARDED_BY(mutex_);
  Stats stats_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace gem
