#include "server/map_file/writer.h"

#include <algorithm>
#include <utility>

#include "core/base/check.h"
#include "proto/wire/zstd_frame.h"
#include "server/map_file/checksum.h"

namespace gem::map_file {
namespace {

constexpr int kCompressionLevel = 3;
constexpr std::int64_t kNsPerMs = 1'000'000;

std::string FileHeader() {
  ByteWriter header;
  header.Number(kFormatVersion);
  header.Number(std::uint32_t{0});
  return std::string(kMagic) + header.bytes();
}

template <typename Poses>
void WritePoses(const Poses& poses, std::size_t first, std::size_t last, ByteWriter& to) {
  const std::size_t n = last - first;
  to.Number(static_cast<std::uint32_t>(n));
  to.Column(n, [&](std::size_t i) { return poses[first + i].stamp_ns; });
  for (int k = 0; k < 4; ++k)
    to.Column(n, [&](std::size_t i) { return poses[first + i].T_A_B.rotation().coeffs()[k]; });
  for (int k = 0; k < 3; ++k)
    to.Column(n, [&](std::size_t i) { return poses[first + i].T_A_B.translation()[k]; });
}

void WriteParts(const std::vector<SubmapPart>& parts, ByteWriter& to) {
  to.Number(static_cast<std::uint32_t>(parts.size()));
  for (const SubmapPart& part : parts) {
    for (int k = 0; k < 3; ++k) to.Number(part.middle.xyz()[k]);
    to.Number(part.spread_m2);
    to.Number(part.num_cells);
    to.Number(part.stamp_ns);
  }
}

// Groups [first, last): their cells lie behind each other in the submap.
void WriteCells(const Submap& submap, std::size_t first, std::size_t last, ByteWriter& to) {
  const auto group = [&](std::size_t i) -> const Submap::Group& {
    return submap.groups()[first + i];
  };
  const std::size_t num_groups = last - first;
  const std::size_t begin = group(0).first;
  const std::size_t n = group(num_groups - 1).first + group(num_groups - 1).num_cells() - begin;
  to.Number(static_cast<std::uint32_t>(num_groups));
  to.Column(num_groups, [&](std::size_t i) { return group(i).origin.x; });
  to.Column(num_groups, [&](std::size_t i) { return group(i).origin.y; });
  for (std::size_t word = 0; word < 4; ++word)
    to.Column(num_groups, [&](std::size_t i) { return group(i).occupied[word]; });
  to.Column(n, [&](std::size_t i) { return submap.elevation_m(begin + i); });
  for (std::size_t k = 0; k < 6; ++k)
    to.Column(n, [&](std::size_t i) { return submap.covariance_m2(begin + i)[k]; });
  to.Column(n, [&](std::size_t i) {
    const SubmapCell cell = submap.At(begin + i);
    return (cell.rgba & 0xffffffu) | static_cast<std::uint32_t>(cell.state) << 24;
  });
  to.Column(n, [&](std::size_t i) {
    return static_cast<std::uint8_t>(submap.At(begin + i).traversability * 255.0f + 0.5f);
  });
  to.Column(n, [&](std::size_t i) { return submap.At(begin + i).stamp_ns / kNsPerMs; });
  if (submap.sources().size() > 1)
    to.Column(n, [&](std::size_t i) { return submap.source(begin + i); });
}

void WriteLocalMap(const LocalMap& map, ByteWriter& to) {
  to.Number(map.stamp_ns);
  to.Number(map.seq);
  to.Transform(map.T_O_B);
  to.Number(map.origin.x);
  to.Number(map.origin.y);
  to.Number(map.side_cells);
  to.Number(map.traversability_free);
}

// Rows [first, last).
void WriteLocalCells(const LocalMap& map, std::size_t first, std::size_t last, ByteWriter& to) {
  const auto side = static_cast<std::size_t>(map.side_cells);
  const std::size_t begin = first * side;
  const std::size_t n = (last - first) * side;
  to.Number(static_cast<std::uint32_t>(last - first));
  const auto column = [&](const auto& layer) {
    to.Column(n, [&](std::size_t i) { return layer[begin + i]; });
  };
  column(map.state);
  column(map.elevation_m);
  column(map.variance_m2);
  column(map.slope_rad);
  column(map.roughness_m);
  column(map.traversability);
  column(map.rgba);
  column(map.observed_ns);
}

}  // namespace

std::string SectionOf(SectionType type, absl::string_view raw) {
  GEM_CHECK(raw.size() <= kRawBytes_max);
  const std::string stored = wire::Compressed(raw, kCompressionLevel);
  ByteWriter header;
  header.Number(static_cast<std::uint32_t>(type));
  header.Number(static_cast<std::uint32_t>(stored.size()));
  header.Number(static_cast<std::uint32_t>(raw.size()));
  header.Number(Checksum(header.bytes(), stored));
  return header.bytes() + stored;
}

Writer::Writer(std::shared_ptr<const MapState> state) : state_(std::move(state)) {
  steps_.push_back({.type = SectionType::kMap});
  for (const SessionState& session : state_->sessions) {
    place_of_.emplace(session.session, static_cast<std::uint32_t>(place_of_.size()));
    PlanSession(session);
  }
  for (const FinishedSubmapState& finished : state_->submaps) {
    for (const auto* piece : {finished.seen.get(), finished.hidden.get()}) {
      if (piece == nullptr) continue;
      ++num_pieces_;
      PlanSubmap(*piece, nullptr, &finished);
    }
  }
  steps_.push_back({.type = SectionType::kEnd});
}

void Writer::PlanSession(const SessionState& session) {
  steps_.push_back({.type = SectionType::kSession, .session = &session});
  constexpr std::size_t kPoses = kRawBytes_aim / kPoseBytes - 1;
  PlanList({.type = SectionType::kOdometry, .session = &session},
           session.trajectory.odometry.size(), kPoses);
  PlanList({.type = SectionType::kCorrections, .session = &session},
           session.trajectory.corrections.size(), kPoses);
  if (session.active != nullptr) PlanSubmap(*session.active, &session, nullptr);
  if (session.local_map == nullptr) return;
  steps_.push_back({.type = SectionType::kLocalMap, .session = &session});
  const auto side = static_cast<std::size_t>(session.local_map->side_cells);
  PlanList({.type = SectionType::kLocalCells, .session = &session}, side,
           std::max<std::size_t>(1, kRawBytes_aim / (side * kLocalCellBytes)));
}

void Writer::PlanSubmap(const Submap& submap, const SessionState* session,
                        const FinishedSubmapState* finished) {
  Step step{
      .type = SectionType::kSubmap, .session = session, .submap = &submap, .finished = finished};
  steps_.push_back(step);
  // A list is closed before what would make it too long.
  const auto plan = [&](SectionType type, std::size_t num_entries, const auto& bytes_of) {
    step.type = type;
    step.first = 0;
    std::size_t bytes = 0;
    for (std::size_t i = 0; i < num_entries; ++i) {
      if (i > step.first && bytes + bytes_of(i) > kRawBytes_aim) {
        step.last = i;
        steps_.push_back(step);
        step.first = i;
        bytes = 0;
      }
      bytes += bytes_of(i);
    }
    step.last = num_entries;
    if (step.last > step.first) steps_.push_back(step);
  };
  plan(SectionType::kSources, submap.sources().size(),
       [&](std::size_t i) { return sizeof(std::uint32_t) * (1 + submap.sources()[i].size()); });
  plan(SectionType::kCells, submap.groups().size(),
       [&](std::size_t i) { return kGroupBytes + kCellBytes * submap.groups()[i].num_cells(); });
}

void Writer::PlanList(Step step, std::size_t num_entries, std::size_t count) {
  for (step.first = 0; step.first < num_entries; step.first = step.last) {
    step.last = std::min(num_entries, step.first + count);
    steps_.push_back(step);
  }
}

std::optional<std::string> Writer::Next() {
  if (next_ == steps_.size()) return std::nullopt;
  std::string bytes = next_ == 0 ? FileHeader() : std::string();
  for (std::size_t raw = 0; next_ < steps_.size() && raw < kRawBytes_aim;) {
    const Step& step = steps_[next_++];
    const ByteWriter section = Write(step);
    raw += section.size();
    bytes += SectionOf(step.type, section.bytes());
  }
  return bytes;
}

ByteWriter Writer::Write(const Step& step) const {
  ByteWriter to;
  switch (step.type) {
    case SectionType::kMap:
      WriteMap(to);
      break;
    case SectionType::kSession:
      WriteSession(*step.session, to);
      break;
    case SectionType::kOdometry:
      WritePoses(step.session->trajectory.odometry, step.first, step.last, to);
      break;
    case SectionType::kCorrections:
      WritePoses(step.session->trajectory.corrections, step.first, step.last, to);
      break;
    case SectionType::kSubmap:
      WriteSubmap(step, to);
      break;
    case SectionType::kSources:
      WriteSources(step, to);
      break;
    case SectionType::kCells:
      WriteCells(*step.submap, step.first, step.last, to);
      break;
    case SectionType::kLocalMap:
      WriteLocalMap(*step.session->local_map, to);
      break;
    case SectionType::kLocalCells:
      WriteLocalCells(*step.session->local_map, step.first, step.last, to);
      break;
    case SectionType::kEnd:
      to.Number(static_cast<std::uint64_t>(steps_.size()));
      break;
  }
  return to;
}

void Writer::WriteMap(ByteWriter& to) const {
  const GlobalMapOptions& options = state_->options;
  to.Number(state_->version.epoch);
  to.Number(state_->version.revision);
  to.Number(options.cell_size_m);
  to.Number(options.submap_length_m);
  to.Number(static_cast<std::uint8_t>(options.traversable_only));
  to.Number(options.traversability_free);
  to.Number(options.gate_sigmas);
  to.Number(options.merge_overlap_min);
  to.Number(options.merge_fuse_time_s_max);
  to.Number(options.merge_height_difference_m_max);
  to.Number(state_->last_submap_id);
  to.Number(static_cast<std::uint32_t>(state_->sessions.size()));
  to.Number(num_pieces_);
}

void Writer::WriteSession(const SessionState& session, ByteWriter& to) const {
  to.Text(session.session);
  to.Text(session.robot);
  std::uint8_t flags = 0;
  if (session.ended) flags |= kSessionEnded;
  if (session.retracted) flags |= kSessionRetracted;
  if (session.active != nullptr) flags |= kSessionHasSubmap;
  if (session.local_map != nullptr) flags |= kSessionHasLocalMap;
  to.Number(flags);
  to.Transform(session.trajectory.initial_T_G_O);
  to.Number(static_cast<std::uint64_t>(session.trajectory.odometry.size()));
  to.Number(static_cast<std::uint64_t>(session.trajectory.corrections.size()));
}

void Writer::WriteSubmap(const Step& step, ByteWriter& to) const {
  const Submap& submap = *step.submap;
  const SubmapOrigin& origin = submap.origin();
  const bool grows = step.finished == nullptr;
  const bool is_hidden = !grows && step.finished->hidden.get() == &submap;
  const SubmapRole role = grows       ? SubmapRole::kGrowing
                          : is_hidden ? SubmapRole::kHidden
                                      : SubmapRole::kSeen;
  to.Number(static_cast<std::uint64_t>(grows ? step.session->active_id : step.finished->id));
  to.Number(static_cast<std::uint8_t>(role));
  to.Number(place_of_.at(origin.session));
  to.Number(origin.anchor_stamp_ns);
  to.Transform(origin.T_O_K);
  const bool has_left = is_hidden && step.finished->left_T_G_K.has_value();
  to.Number(static_cast<std::uint8_t>(has_left));
  if (has_left) to.Transform(*step.finished->left_T_G_K);
  WriteParts(submap.parts(), to);
  to.Number(static_cast<std::uint32_t>(submap.sources().size()));
  to.Number(static_cast<std::uint64_t>(submap.num_cells()));
}

void Writer::WriteSources(const Step& step, ByteWriter& to) const {
  to.Number(static_cast<std::uint32_t>(step.last - step.first));
  for (std::size_t i = step.first; i < step.last; ++i) {
    const ContributorSet& set = step.submap->sources()[i];
    to.Number(static_cast<std::uint32_t>(set.size()));
    for (const Contributor& each : set) to.Number(place_of_.at(each.session));
  }
}

}  // namespace gem::map_file
