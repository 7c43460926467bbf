// A map, its file, and the map of its file: the same. What is not a file of a map is refused with
// its place.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "core/global/global_mapper.h"
#include "server/map_file/reader.h"
#include "server/map_file/writer.h"
#include "tests/core/global/scenes.h"

namespace gem::map_file {
namespace {

using test::AtCells;
using test::kSecond_ns;
using test::MakeLocalMap;
using test::MakeSubmap;

float Rough(CellIndex c) { return 0.1f * static_cast<float>((c.x * 7 + c.y * 3) % 11); }

/// Two sessions on the same ground, merged; a third one that is retracted; corrections; a growing
/// submap and a local map.
std::unique_ptr<GlobalMapper> SomeMap() {
  auto mapper = std::make_unique<GlobalMapper>(GlobalMapOptions{}, 7);
  for (const std::string session : {"a", "b", "c"}) {
    EXPECT_TRUE(
        mapper->AddSession(session, "robot-" + session, Pose<Global, Odom>::FromYaw(0.1, {1, 2, 0}))
            .ok());
    SessionUpdate update;
    for (std::int64_t s = 1; s <= 100; ++s)
      update.odometry.push_back(
          {s * kSecond_ns, Pose<Odom, Base>::FromYaw(0.01 * static_cast<double>(s),
                                                     {static_cast<double>(s), 0, 0.1})});
    const std::int64_t first_s = session[0] - 'a' + 1;
    for (const std::int64_t s : {0, 30})
      update.finished.push_back(MakeSubmap(session, (s + first_s) * kSecond_ns,
                                           AtCells(static_cast<std::int32_t>(s), 0),
                                           {{-20, -15}, {25, 30}}, Rough));
    update.active = MakeSubmap(session, (60 + first_s) * kSecond_ns, AtCells(150, 3),
                               {{0, 0}, {10, 10}}, Rough);
    update.local_map = MakeLocalMap({150, 10}, 40, 0.5f, 100 * kSecond_ns);
    EXPECT_TRUE(mapper->Update(session, std::move(update)).ok());
  }
  CommitReport report;
  mapper->Commit(CancelToken(), report);
  EXPECT_GT(report.num_merged_submaps, 0u);
  EXPECT_TRUE(mapper->Retract("c", false).ok());
  EXPECT_TRUE(mapper
                  ->Correct("a", {{2 * kSecond_ns, Pose<Global, Base>::FromYaw(0.2, {3, 2, 0.3})},
                                  {90 * kSecond_ns, Pose<Global, Base>::FromYaw(0.9, {70, 40, 0})}})
                  .ok());
  mapper->Commit(CancelToken(), report);
  return mapper;
}

std::string FileOf(const GlobalMapper& mapper) {
  Writer writer(std::make_shared<const MapState>(mapper.State()));
  std::string file;
  while (const std::optional<std::string> piece = writer.Next()) file += *piece;
  return file;
}

absl::StatusOr<MapState> Read(const std::string& file, const Limits& limits = {},
                              std::size_t step = 1'000'000) {
  Reader reader(limits);
  for (std::size_t at = 0; at < file.size(); at += step)
    if (const absl::Status fed = reader.Feed(absl::string_view(file).substr(at, step)); !fed.ok())
      return fed;
  return reader.Finish();
}

std::unique_ptr<GlobalMapper> MapOf(const std::string& file) {
  const absl::StatusOr<MapState> state = Read(file);
  EXPECT_TRUE(state.ok()) << state.status();
  auto mapper = GlobalMapper::FromState(*state, 8, 1000);
  EXPECT_TRUE(mapper.ok()) << mapper.status();
  CommitReport report;
  (*mapper)->Commit(CancelToken(), report);
  return *std::move(mapper);
}

/// Offsets of all sections, and of the end.
std::vector<std::size_t> Boundaries(const std::string& file) {
  std::vector<std::size_t> boundaries;
  std::size_t at = kFileHeaderBytes;
  while (at < file.size()) {
    boundaries.push_back(at);
    ByteReader header(absl::string_view(file).substr(at));
    header.Number<std::uint32_t>("type");
    at += kSectionHeaderBytes + header.Number<std::uint32_t>("stored_bytes");
  }
  EXPECT_EQ(at, file.size());
  boundaries.push_back(at);
  return boundaries;
}

TEST(MapFile, HoldsTheMapBitForBit) {
  const auto mapper = SomeMap();
  const std::string file = FileOf(*mapper);
  const auto copy = MapOf(file);
  EXPECT_TRUE(test::SameLevels(*mapper->snapshot(), *copy->snapshot()));
  EXPECT_GT(test::NumKnown(*copy->snapshot()), 3000u);
  ASSERT_EQ(copy->snapshot()->sessions.size(), 3u);
  EXPECT_EQ(copy->snapshot()->sessions[1].robot, "robot-b");
  EXPECT_TRUE(copy->snapshot()->sessions[2].retracted);
  EXPECT_TRUE(copy->snapshot()->sessions[0].ended);
}

// What was written, hidden or corrected must not have lost what later changes need.
TEST(MapFile, GoesOnLikeTheMap) {
  const auto mapper = SomeMap();
  const auto copy = MapOf(FileOf(*mapper));
  CommitReport report;
  const auto compare = [&](const char* after) {
    EXPECT_TRUE(test::SameLevels(*mapper->Commit(CancelToken(), report),
                                 *copy->Commit(CancelToken(), report)))
        << after;
  };
  const CorrectedTrajectory correction = {
      {5 * kSecond_ns, Pose<Global, Base>::FromYaw(-0.2, {3, 9, 0})},
      {80 * kSecond_ns, Pose<Global, Base>::FromYaw(0.4, {60, 1, 0.5})}};
  for (GlobalMapper* each : {mapper.get(), copy.get()})
    ASSERT_TRUE(each->Correct("b", correction).ok());
  compare("correcting b");
  for (GlobalMapper* each : {mapper.get(), copy.get()}) ASSERT_TRUE(each->Retract("c", true).ok());
  compare("restoring c");
  for (GlobalMapper* each : {mapper.get(), copy.get()}) ASSERT_TRUE(each->Retract("a", false).ok());
  compare("retracting a");
}

TEST(MapFile, IsTheSameHoweverOftenItIsReadAndWritten) {
  const std::string file = FileOf(*SomeMap());
  const std::string again = FileOf(*MapOf(file));
  const std::string once_more = FileOf(*MapOf(again));
  EXPECT_EQ(again, once_more);
}

TEST(MapFile, CanComeInPiecesOfAnySize) {
  const std::string file = FileOf(*SomeMap());
  for (const std::size_t step : {std::size_t{1}, std::size_t{7}, std::size_t{4096}})
    EXPECT_TRUE(Read(file, {}, step).ok());
}

// Lists that are longer than a section go on in the next one.
TEST(MapFile, MayHaveListsOfManySections) {
  GlobalMapper mapper(GlobalMapOptions{}, 1);
  ASSERT_TRUE(mapper.AddSession("s", "r", {}).ok());
  SessionUpdate update;
  for (std::int64_t i = 1; i <= 20'000; ++i)
    update.odometry.push_back({i, Pose<Odom, Base>::FromTranslation(static_cast<double>(i), 0, 0)});
  update.finished = {
      MakeSubmap("s", 1, AtCells(0, 0), {{-150, -100}, {100, 100}}, Rough, 5 * kSecond_ns)};
  update.local_map = MakeLocalMap({0, 0}, 200, 1, 9);
  ASSERT_TRUE(mapper.Update("s", std::move(update)).ok());
  CommitReport report;
  mapper.Commit(CancelToken(), report);
  const std::string file = FileOf(mapper);
  // MAP, SESSION, 3 ODOMETRY, LOCAL_MAP, 3 LOCAL_CELLS, SUBMAP, SOURCES, 5 CELLS, END.
  EXPECT_EQ(Boundaries(file).size(), 17u + 1);
  const auto copy = MapOf(file);
  EXPECT_TRUE(test::SameLevels(*mapper.snapshot(), *copy->snapshot()));
  EXPECT_EQ(copy->State().sessions[0].trajectory.odometry.size(), 20'000u);
}

TEST(MapFile, OfAnEmptyMapIsAFile) {
  const GlobalMapper mapper(GlobalMapOptions{}, 1);
  EXPECT_EQ(MapOf(FileOf(mapper))->snapshot()->tiles.size(), 0u);
}

TEST(MapFile, CutOffAnywhereIsRefused) {
  const std::string file = FileOf(*SomeMap());
  for (const std::size_t at : Boundaries(file)) {
    for (const std::size_t cut : {at - 1, at, at + 1, at + kSectionHeaderBytes}) {
      if (cut >= file.size()) continue;
      EXPECT_TRUE(absl::IsInvalidArgument(Read(file.substr(0, cut)).status())) << cut;
    }
  }
  EXPECT_EQ(Read(file.substr(0, file.size() - 1)).status().message().substr(0, 12), "data at byte");
  EXPECT_TRUE(absl::IsInvalidArgument(Read(file + "x").status()));
}

TEST(MapFile, WithASectionLeftOutDoubledOrSwappedIsRefused) {
  const std::string file = FileOf(*SomeMap());
  const std::vector<std::size_t> at = Boundaries(file);
  for (std::size_t i = 0; i + 1 < at.size(); ++i) {
    const std::string section = file.substr(at[i], at[i + 1] - at[i]);
    EXPECT_FALSE(Read(file.substr(0, at[i]) + file.substr(at[i + 1])).ok()) << "without " << i;
    EXPECT_FALSE(Read(file.substr(0, at[i]) + section + file.substr(at[i])).ok()) << "twice " << i;
  }
}

TEST(MapFile, WithAnyBitFlippedIsRefused) {
  const std::string file = FileOf(*SomeMap());
  std::mt19937 random(20261127);
  for (int i = 0; i < 500; ++i) {
    std::string flipped = file;
    const std::size_t at = i < 300 ? random() % file.size() : static_cast<std::size_t>(i) - 300;
    flipped[at] = static_cast<char>(flipped[at] ^ (1 << (random() % 8)));
    const absl::Status status = Read(flipped).status();
    EXPECT_FALSE(status.ok()) << at;
    EXPECT_EQ(status.message().substr(0, 12), "data at byte") << status;
  }
}

/// A file of these sections, checksums and all: what only the values can give away.
std::string Forged(const std::vector<std::pair<SectionType, std::string>>& sections) {
  ByteWriter header;
  header.Number(kFormatVersion);
  header.Number(std::uint32_t{0});
  std::string file = std::string(kMagic) + header.bytes();
  for (const auto& [type, raw] : sections) file += SectionOf(type, raw);
  return file;
}

std::string MapSection(float cell_size_m, std::uint32_t num_sessions, std::uint32_t num_submaps) {
  ByteWriter map;
  map.Number(std::uint64_t{1});
  map.Number(std::uint64_t{1});
  for (const float value : {cell_size_m, 10.0f}) map.Number(value);
  map.Number(std::uint8_t{0});
  for (const float value : {0.7f, 3.0f, 0.5f}) map.Number(value);
  map.Number(300.0);
  map.Number(0.3f);
  map.Number(std::uint64_t{9});
  map.Number(num_sessions);
  map.Number(num_submaps);
  return map.bytes();
}

std::string SessionSection(std::uint8_t flags, std::uint64_t num_odometry, double qw = 1) {
  ByteWriter session;
  session.Text("s");
  session.Text("r");
  session.Number(flags);
  for (const double number : {0.0, 0.0, 0.0, qw, 0.0, 0.0, 0.0}) session.Number(number);
  session.Number(num_odometry);
  session.Number(std::uint64_t{0});
  return session.bytes();
}

TEST(MapFile, NamesThePlaceTheFieldTheValueAndTheLimit) {
  const auto message = [](const std::vector<std::pair<SectionType, std::string>>& sections) {
    return std::string(Read(Forged(sections)).status().message());
  };
  EXPECT_EQ(message({{SectionType::kMap, MapSection(-1, 0, 0)}}),
            "data at byte 16, section 0 (MAP): map.cell_size_m is -1, want [0.01, 10]");
  EXPECT_EQ(message({{SectionType::kSession, SessionSection(0, 0)}}),
            "data at byte 16, section 0 (SESSION): the section is SESSION, want MAP");
  const std::string map = MapSection(0.2f, 1, 0);
  EXPECT_THAT(message({{SectionType::kMap, map}, {SectionType::kSession, SessionSection(99, 0)}}),
              testing::HasSubstr("section 1 (SESSION): flags is 99, want 0 to 15"));
  EXPECT_THAT(message({{SectionType::kMap, map}, {SectionType::kSession, SessionSection(0, 0, 2)}}),
              testing::HasSubstr("map_from_odom is a quaternion of norm 2, want a norm of 1"));
  EXPECT_THAT(
      message({{SectionType::kMap, map}, {SectionType::kSession, SessionSection(0, 1'000'001)}}),
      testing::HasSubstr("num_odometry is 1000001, want 0 to 1000000"));
  EXPECT_THAT(
      message({{SectionType::kMap, map}, {SectionType::kSession, SessionSection(0, 0) + "x"}}),
      testing::HasSubstr("its end is 1 bytes later, want none"));
  EXPECT_EQ(Read("GIF89a..........").status().message(),
            "data at byte 0, section 0: magic is something else, want GEMMAP");
}

// A count costs nothing until what it counts is there.
TEST(MapFile, AllocatesNothingForWhatIsOnlyClaimed) {
  ByteWriter odometry;
  odometry.Number(std::uint32_t{60'000});
  const absl::Status status = Read(Forged({{SectionType::kMap, MapSection(0.2f, 1, 0)},
                                           {SectionType::kSession, SessionSection(0, 1'000'000)},
                                           {SectionType::kOdometry, odometry.bytes()}}))
                                  .status();
  EXPECT_THAT(
      std::string(status.message()),
      testing::HasSubstr("(ODOMETRY): stamp_ns is cut off after 0 bytes, want 60000 times 8"));
}

// Bits of a megabyte, which compress to nothing, would be millions of cells.
TEST(MapFile, ExpandsNoCellsThatAreNotThere) {
  ByteWriter submap;
  submap.Number(std::uint64_t{1});
  submap.Number(std::uint8_t{1});
  submap.Number(std::uint32_t{0});
  submap.Number(std::int64_t{1});
  submap.Transform(Pose<Odom, Submap>());
  submap.Number(std::uint8_t{0});
  submap.Number(std::uint32_t{1});
  for (const double number : {0.0, 0.0, 0.0, 0.0, 1.0}) submap.Number(number);
  submap.Number(std::int64_t{1});
  submap.Number(std::uint32_t{1});
  submap.Number(std::uint64_t{1} << 28);
  ByteWriter sources;
  for (const std::uint32_t number : {1u, 1u, 0u}) sources.Number(number);
  ByteWriter cells;
  cells.Number(std::uint32_t{20'000});
  cells.Column(20'000, [](std::size_t i) { return 16 * static_cast<std::int32_t>(i % 1000); });
  cells.Column(20'000, [](std::size_t i) { return 16 * static_cast<std::int32_t>(i / 1000); });
  for (int word = 0; word < 4; ++word)
    cells.Column(20'000, [](std::size_t) { return ~std::uint64_t{0}; });
  const absl::Status status = Read(Forged({{SectionType::kMap, MapSection(0.2f, 1, 1)},
                                           {SectionType::kSession, SessionSection(0, 0)},
                                           {SectionType::kSubmap, submap.bytes()},
                                           {SectionType::kSources, sources.bytes()},
                                           {SectionType::kCells, cells.bytes()}}))
                                  .status();
  EXPECT_THAT(std::string(status.message()),
              testing::HasSubstr("group.occupied[0] is cell 256, want the 0 that are there"));
}

TEST(MapFile, LargerThanTheLimitsIsRefused) {
  const std::string file = FileOf(*SomeMap());
  Limits limits;
  limits.file_bytes_max = file.size();
  EXPECT_TRUE(Read(file, limits).ok());
  --limits.file_bytes_max;
  EXPECT_TRUE(absl::IsResourceExhausted(Read(file, limits).status()));

  // Sections inflate to much more than they are stored in.
  limits = {};
  limits.memory_bytes_max = 100'000;
  const absl::Status status = Read(file, limits).status();
  EXPECT_TRUE(absl::IsResourceExhausted(status));
  EXPECT_THAT(std::string(status.message()),
              testing::HasSubstr("larger than 100000 bytes of memory, want at most import_memory"));
  limits = {};
  limits.odometry_poses_max = 99;
  EXPECT_TRUE(absl::IsInvalidArgument(Read(file, limits).status()));
  limits = {};
  limits.sessions_max = 2;
  EXPECT_TRUE(absl::IsInvalidArgument(Read(file, limits).status()));
}

}  // namespace
}  // namespace gem::map_file
