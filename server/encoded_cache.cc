#include "server/encoded_cache.h"

namespace gem {
namespace {

/// What an entry occupies besides its bytes, about.
constexpr std::uint64_t kBooksOfEntryBytes = 256;

std::uint64_t BytesOf(const wire::EncodedCells& encoded) {
  return encoded.bytes.size() + kBooksOfEntryBytes;
}

}  // namespace

EncodedCache::Encoded EncodedCache::Get(const EncodedKey& key,
                                        const std::function<wire::EncodedCells()>& encode) {
  std::shared_ptr<Flight> flight;
  {
    MutexLock lock(mutex_);
    if (const auto found = index_.find(key); found != index_.end()) {
      ++stats_.num_hits;
      entries_.splice(entries_.begin(), entries_, found->second);
      return found->second->encoded;
    }
    auto [ours, is_new] = flights_.try_emplace(key);
    if (!is_new) {
      ++stats_.num_hits;
      flight = ours->second;
      while (flight->encoded == nullptr) landed_.Wait(mutex_);
      return flight->encoded;
    }
    ++stats_.num_misses;
    ours->second = flight = std::make_shared<Flight>();
  }
  auto encoded = std::make_shared<const wire::EncodedCells>(encode());
  std::vector<Encoded> evicted;  // destroyed after the lock is released
  MutexLock lock(mutex_);
  InsertLocked(key, encoded, evicted);
  flight->encoded = encoded;
  flights_.erase(key);
  landed_.NotifyAll();
  return encoded;
}

void EncodedCache::InsertLocked(const EncodedKey& key, Encoded encoded,
                                std::vector<Encoded>& evicted) {
  if (BytesOf(*encoded) > bytes_max_) return;
  stats_.bytes += BytesOf(*encoded);
  entries_.push_front({key, std::move(encoded)});
  index_[key] = entries_.begin();
  while (stats_.bytes > bytes_max_) {
    Entry& oldest = entries_.back();
    stats_.bytes -= BytesOf(*oldest.encoded);
    ++stats_.num_evicted;
    index_.erase(oldest.key);
    evicted.push_back(std::move(oldest.encoded));
    entries_.pop_back();
  }
}

EncodedCache::Stats EncodedCache::stats() const {
  MutexLock lock(mutex_);
  return stats_;
}

}  // namespace gem
