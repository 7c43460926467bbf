// How those who wait for something new learn of it, without those who make it waiting for them.
#pragma once

#include <cstdint>

namespace gem {

/// What has news from time to time: a map, a robot's local maps. Unique in this process.
enum class NewsSource : std::uint64_t {};
NewsSource NewNewsSource();

class NewsListener {
 public:
  virtual ~NewsListener() = default;
  /// There is something new. Called from the threads of mappers: returns at once, and thread-safe.
  virtual void OnNews(NewsSource source) = 0;
};

}  // namespace gem
