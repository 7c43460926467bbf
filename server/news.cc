#include "server/news.h"

#include <atomic>

namespace gem {

NewsSource NewNewsSource() {
  static std::atomic<std::uint64_t> last{0};
  return NewsSource{last.fetch_add(1, std::memory_order_relaxed) + 1};
}

}  // namespace gem
