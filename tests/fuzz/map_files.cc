#include "tests/fuzz/map_files.h"

#include <cmath>
#include <memory>
#include <optional>
#include <string_view>

#include "core/base/check.h"
#include "core/global/global_mapper.h"
#include "proto/wire/zstd_frame.h"
#include "server/map_file/reader.h"
#include "server/map_file/writer.h"
#include "tests/core/global/scenes.h"
#include "tests/fuzz/framed_messages.h"

namespace gem::fuzz {
namespace {

using map_file::Assembly;
using map_file::Limits;
using map_file::Reader;
using map_file::SectionType;
using map_file::Writer;

constexpr std::uint64_t kTilesMax = 16;

Limits SmallLimits() {
  Limits limits;
  limits.memory_bytes_max = 16 << 20;
  limits.sessions_max = 16;
  limits.odometry_poses_max = 1000;
  limits.compose_threads = 1;
  return limits;
}

absl::StatusOr<MapState> ReadFile(absl::string_view file) {
  Reader reader(SmallLimits());
  if (const absl::Status fed = reader.Feed(file); !fed.ok()) {
    GEM_CHECK(fed.message().substr(0, 4) == "data");
    return fed;
  }
  return reader.Finish();
}

absl::StatusOr<MapState> Assemble(std::string_view bytes) {
  Assembly assembly(SmallLimits());
  for (const std::string_view section : FramedMessages(bytes)) {
    if (section.empty()) continue;
    const absl::string_view raw(section.data(), section.size());
    const absl::Status taken =
        assembly.Take(static_cast<SectionType>(1 + static_cast<unsigned char>(raw[0]) %
                                                       (map_file::kNumSectionTypes - 1)),
                      raw.substr(1));
    if (!taken.ok()) return taken;
  }
  return assembly.Finish();
}

std::string FileOf(const GlobalMapper& mapper) {
  Writer writer(std::make_shared<const MapState>(mapper.State()));
  std::string file;
  while (const std::optional<std::string> piece = writer.Next()) file += *piece;
  return file;
}

std::unique_ptr<GlobalMapper> SmallMap() {
  auto mapper = std::make_unique<GlobalMapper>(GlobalMapOptions{}, 1);
  for (const std::string session : {"a", "b"}) {
    GEM_CHECK(mapper->AddSession(session, "r", {}).ok());
    SessionUpdate update;
    update.odometry = {{1, {}}, {2'000'000'000, Pose<Odom, Base>::FromYaw(1, {1, 0, 0})}};
    update.finished = {test::MakeSubmap(session, session == "a" ? 1 : 2, test::AtCells(0, 0),
                                        {{-3, 0}, {3, 4}}, test::Flat(1))};
    update.active = test::MakeSubmap(session, 1'000'000'000, test::AtCells(9, 0), {{0, 0}, {2, 2}},
                                     test::Flat(1));
    update.local_map = test::MakeLocalMap({9, 0}, 5, 1, 2'000'000'000);
    GEM_CHECK(mapper->Update(session, std::move(update)).ok());
    CommitReport report;
    mapper->Commit(CancelToken(), report);
  }
  GEM_CHECK(mapper->Retract("b", false).ok());
  GEM_CHECK(mapper->Correct("a", {{1, Pose<Global, Base>::FromTranslation(0, 1, 0)}}).ok());
  CommitReport report;
  mapper->Commit(CancelToken(), report);
  return mapper;
}

/// The sections of a file without their headers, framed.
std::string SectionsOf(const std::string& file) {
  std::vector<std::string> sections;
  std::size_t at = map_file::kFileHeaderBytes;
  while (at < file.size()) {
    map_file::ByteReader header(absl::string_view(file).substr(at));
    const auto type = header.Number<std::uint32_t>("type");
    const auto stored_bytes = header.Number<std::uint32_t>("stored_bytes");
    const auto raw_bytes = header.Number<std::uint32_t>("raw_bytes");
    const auto raw = wire::Inflated(
        absl::string_view(file).substr(at + map_file::kSectionHeaderBytes, stored_bytes), raw_bytes,
        wire::FieldPath("raw"));
    GEM_CHECK(raw.ok());
    sections.push_back(std::string(1, static_cast<char>(type - 1)) + *raw);
    at += map_file::kSectionHeaderBytes + stored_bytes;
  }
  GEM_CHECK(sections.size() <= kFramedMessagesMax);
  return Frame(sections);
}

}  // namespace

void MapFile(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return;
  const std::string_view bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  const absl::StatusOr<MapState> state =
      data[0] % 2 == 0 ? ReadFile({bytes.data(), bytes.size()}) : Assemble(bytes);
  if (!state.ok()) return;
  auto mapper = GlobalMapper::FromState(*state, 2, kTilesMax);
  if (!mapper.ok()) return;
  CommitReport report;
  const auto snapshot = (*mapper)->Commit(CancelToken(), report);
  for (const auto& [index, tile] : snapshot->tiles)
    for (const CellBelief& cell : tile->cells)
      GEM_CHECK(std::isfinite(cell.elevation_m) && std::isfinite(cell.variance_m2));
  // What was good enough once is so again.
  GEM_CHECK(ReadFile(FileOf(**mapper)).ok());
  for (const SessionInfo& session : snapshot->sessions) {
    GEM_CHECK((*mapper)->Retract(session.session, session.retracted).ok());
    (*mapper)->Commit(CancelToken(), report);
  }
}

std::vector<std::string> MapFileSeeds() {
  const std::string file = FileOf(*SmallMap());
  const std::string empty = FileOf(GlobalMapper(GlobalMapOptions{}, 1));
  return {'\0' + file, '\0' + empty, '\1' + SectionsOf(file), '\1' + SectionsOf(empty)};
}

}  // namespace gem::fuzz
