// Exports and imports without calls: ThreadSanitizer sees the map's thread, the one that sends and
// the one that renders.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <thread>

#include "server/map_export.h"
#include "server/map_import.h"
#include "tests/core/global/scenes.h"

namespace gem {
namespace {

using test::kSecond_ns;

/// Wakes whoever waits for the state of a map.
class Listener : public NewsListener {
 public:
  void OnNews(NewsSource /*source*/) override {
    MutexLock lock(mutex_);
    ++num_news_;
    changed_.NotifyAll();
  }
  void WaitForNews() {
    MutexLock lock(mutex_);
    while (num_news_ == 0) changed_.Wait(mutex_);
    --num_news_;
  }

 private:
  Mutex mutex_;
  CondVar changed_;
  int num_news_ ABSL_GUARDED_BY(mutex_) = 0;
};

class MapTransferTest : public testing::Test {
 protected:
  static ServerOptions Options() {
    ServerOptions options;
    options.publish_hz = 100;
    options.transfers_max = 1;
    return options;
  }

  std::shared_ptr<MapActor> MakeMap(const std::string& id) {
    auto map = registry_.CreateMap(id, {}, "");
    EXPECT_TRUE(map.ok()) << map.status();
    EXPECT_TRUE((*map)->AddSession("s", "r", {}).ok());
    return *map;
  }
  static void Drive(MapActor& map, std::int64_t from_s, std::int64_t to_s) {
    for (std::int64_t s = from_s; s < to_s; ++s) {
      SessionUpdate update;
      update.odometry = {{s * kSecond_ns, {}}};
      update.finished = {test::MakeSubmap("s", s * kSecond_ns,
                                          test::AtCells(static_cast<std::int32_t>(30 * s), 0),
                                          {{0, 0}, {30, 30}}, test::Flat(1))};
      map.Update("s", std::move(update), nullptr);
    }
  }

  /// The messages' bytes are those of the file but for a header each.
  absl::StatusOr<std::size_t> Export(MapActor& map, std::string* file = nullptr) {
    absl::StatusOr<std::unique_ptr<TransferSlots::Slot>> slot = slots_.Take();
    if (!slot.ok()) return slot.status();
    MapExport source(map, *std::move(slot), &listener_);
    std::size_t num_messages = 0;
    listener_.WaitForNews();
    while (true) {
      const MessageSource::Next next = source.TakeNext(Clock::now());
      if (next.end.has_value()) {
        if (!next.end->ok()) return *next.end;
        return num_messages;
      }
      EXPECT_TRUE(next.message.has_value());
      EXPECT_LT(next.message->size_bytes(), std::size_t{1} << 20);
      ++num_messages;
      if (file != nullptr) *file += DataOf(next.message->Flattened());
    }
  }
  /// Without the field's number and length.
  static std::string DataOf(const std::string& message) {
    std::size_t at = 1;
    while ((static_cast<unsigned char>(message[at]) & 0x80) != 0) ++at;
    return message.substr(at + 1);
  }
  absl::StatusOr<std::shared_ptr<MapActor>> Import(const std::string& map, const std::string& file,
                                                   const CancelToken& cancel = {}) {
    MapImport import(registry_, options_, slots_);
    const auto earlier = import.Begin(map, "");
    if (!earlier.ok()) return earlier.status();
    if (const absl::Status fed = import.Feed(file); !fed.ok()) return fed;
    return import.Finish(cancel);
  }

  const ServerOptions options_ = Options();
  Metrics metrics_;
  Listener listener_;
  TransferSlots slots_{1};
  Registry registry_{options_, 1, metrics_};
};

TEST_F(MapTransferTest, AMapIsTakenWhileItGrows) {
  const std::shared_ptr<MapActor> map = MakeMap("site");
  Drive(*map, 1, 3);
  std::thread robot([&] { Drive(*map, 3, 40); });
  for (int i = 0; i < 3; ++i) {
    std::string file;
    ASSERT_TRUE(Export(*map, &file).ok());
    const auto copy = Import("copy" + std::to_string(i), file);
    ASSERT_TRUE(copy.ok()) << copy.status();
    EXPECT_GE((*copy)->snapshot()->submaps.size(), 1u);
    EXPECT_LE((*copy)->snapshot()->submaps.size(), 39u);
  }
  robot.join();
  std::string file;
  ASSERT_TRUE(Export(*map, &file).ok());
  const auto copy = Import("whole", file);
  ASSERT_TRUE(copy.ok()) << copy.status();
  EXPECT_TRUE(test::SameLevels(*(*copy)->snapshot(), *map->snapshot()));
}

TEST_F(MapTransferTest, AnExportOfAMapThatIsDeletedSaysSo) {
  const std::shared_ptr<MapActor> map = MakeMap("site");
  ASSERT_TRUE(registry_.DeleteMap("site", "", true).ok());
  EXPECT_TRUE(absl::IsNotFound(Export(*map).status()));
  EXPECT_TRUE(slots_.Take().ok()) << "its place is free again";
}

TEST_F(MapTransferTest, AnImportThatIsGivenUpLeavesNothing) {
  const std::shared_ptr<MapActor> map = MakeMap("site");
  Drive(*map, 1, 10);
  std::string file;
  ASSERT_TRUE(Export(*map, &file).ok());
  CancelToken cancel;
  cancel.Cancel();
  EXPECT_TRUE(absl::IsCancelled(Import("copy", file, cancel).status()));
  EXPECT_TRUE(absl::IsNotFound(registry_.FindMap("copy").status()));
  EXPECT_TRUE(Import("copy", file).ok());
}

TEST_F(MapTransferTest, AMapMadeMeanwhileWins) {
  const std::shared_ptr<MapActor> map = MakeMap("site");
  std::string file;
  ASSERT_TRUE(Export(*map, &file).ok());
  MapImport import(registry_, options_, slots_);
  ASSERT_TRUE(import.Begin("copy", "").ok());
  EXPECT_THAT(std::string(slots_.Take().status().message()),
              testing::HasSubstr("want at most 1 (transfers_max)"));
  ASSERT_TRUE(import.Feed(file).ok());
  MakeMap("copy");
  EXPECT_TRUE(absl::IsAlreadyExists(import.Finish(CancelToken()).status()));
}

}  // namespace
}  // namespace gem
