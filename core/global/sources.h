// Who contributed to the cells of a submap: a few sets of sessions, each named by a small number,
// so that a cell remembers a byte or two. Values; knows nothing of cells.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/container/btree_map.h"
#include "absl/container/flat_hash_map.h"
#include "absl/container/flat_hash_set.h"

namespace gem {

/// A session whose scans are in a cell, and its robot.
struct Contributor {
  std::string session;
  std::string robot;
  friend bool operator==(const Contributor&, const Contributor&) = default;
  friend auto operator<=>(const Contributor&, const Contributor&) = default;
};

/// Sorted, without repeats. Several: what they saw was fused.
using ContributorSet = std::vector<Contributor>;

/// Which set of a submap's sources a cell comes from.
using SourceIndex = std::uint16_t;
/// Sets of one submap at most.
inline constexpr std::size_t kSources_max = std::size_t{1} << 16;

/// The sets by their numbers.
using Sources = std::vector<ContributorSet>;

/// Everybody in one of the sets, sorted.
ContributorSet AllContributors(const Sources& sources);
/// By set: whether one of `sessions` is in it.
std::vector<bool> SourcesWithAny(const Sources& sources,
                                 const absl::flat_hash_set<std::string>& sessions);
/// Bytes that the sets occupy, roughly.
std::size_t SizeBytes(const Sources& sources);

/// The sources of two submaps that become one. The older one's numbers stay what they are.
class JoinedSources {
 public:
  JoinedSources(const Sources& older, const Sources& newer);

  /// True if there are more sets than numbers: nothing may be joined.
  bool full() const { return full_; }
  /// The number of one of the newer one's sets.
  SourceIndex OfNewer(SourceIndex newer) const { return of_newer_[newer]; }
  /// The number of the union of two sets, both by the numbers here.
  SourceIndex Union(SourceIndex a, SourceIndex b);
  Sources Take() { return std::move(sources_); }

 private:
  SourceIndex Add(ContributorSet set);

  Sources sources_;
  absl::btree_map<ContributorSet, SourceIndex> index_of_;
  std::vector<SourceIndex> of_newer_;
  absl::flat_hash_map<std::pair<SourceIndex, SourceIndex>, SourceIndex> unions_;
  bool full_ = false;
};

}  // namespace gem
