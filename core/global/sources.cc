#include "core/global/sources.h"

#include <algorithm>
#include <iterator>

namespace gem {

ContributorSet AllContributors(const Sources& sources) {
  ContributorSet all;
  for (const ContributorSet& set : sources) all.insert(all.end(), set.begin(), set.end());
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

std::vector<bool> SourcesWithAny(const Sources& sources,
                                 const absl::flat_hash_set<std::string>& sessions) {
  std::vector<bool> with(sources.size());
  for (std::size_t i = 0; i < sources.size(); ++i)
    with[i] = std::any_of(sources[i].begin(), sources[i].end(),
                          [&](const Contributor& each) { return sessions.contains(each.session); });
  return with;
}

std::size_t SizeBytes(const Sources& sources) {
  std::size_t bytes = sources.capacity() * sizeof(ContributorSet);
  for (const ContributorSet& set : sources) {
    bytes += set.capacity() * sizeof(Contributor);
    for (const Contributor& each : set) bytes += each.session.capacity() + each.robot.capacity();
  }
  return bytes;
}

JoinedSources::JoinedSources(const Sources& older, const Sources& newer) {
  for (const ContributorSet& set : older) Add(set);
  of_newer_.reserve(newer.size());
  for (const ContributorSet& set : newer) of_newer_.push_back(Add(set));
}

SourceIndex JoinedSources::Union(SourceIndex a, SourceIndex b) {
  if (a == b) return a;
  const std::pair<SourceIndex, SourceIndex> key = std::minmax(a, b);
  const auto [found, is_new] = unions_.try_emplace(key);
  if (is_new) {
    ContributorSet both;
    std::set_union(sources_[a].begin(), sources_[a].end(), sources_[b].begin(), sources_[b].end(),
                   std::back_inserter(both));
    found->second = Add(std::move(both));
  }
  return found->second;
}

SourceIndex JoinedSources::Add(ContributorSet set) {
  const auto found = index_of_.find(set);
  if (found != index_of_.end()) return found->second;
  if (sources_.size() == kSources_max) {
    full_ = true;
    return 0;
  }
  const auto index = static_cast<SourceIndex>(sources_.size());
  sources_.push_back(set);
  index_of_.emplace(std::move(set), index);
  return index;
}

}  // namespace gem
