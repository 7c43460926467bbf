// Maps that leave as files and come back, over the wire.
#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <thread>

#include "core/global/global_mapper.h"
#include "proto/wire/pose.h"
#include "server/map_file/writer.h"
#include "tests/core/global/scenes.h"
#include "tests/server/test_server.h"

namespace gem {
namespace {

/// Drives along x, at y, and ends; a scan a metre.
void Drive(TestServer& server, const std::string& robot, const std::string& session, double y_m,
           int num_scans = 30) {
  TestStream stream(server.ingest(), TestOpen(robot, session));
  for (int seq = 1; seq <= num_scans; ++seq)
    ASSERT_TRUE(stream.Send(FlatScan(static_cast<std::uint64_t>(seq), seq, y_m)));
  ASSERT_TRUE(stream.SendClose());
  ASSERT_TRUE(stream.ReadUntilClosed());
}

struct Exported {
  grpc::Status status;
  std::string file;
  std::size_t message_bytes_max = 0;
};

Exported Export(TestServer& server, const std::string& map) {
  grpc::ClientContext context;
  context.set_deadline(TestDeadline());
  v1::ExportMapRequest request;
  request.set_map(map);
  const auto stream = server.maps().ExportMap(&context, request);
  Exported exported;
  v1::ExportMapResponse response;
  while (stream->Read(&response)) {
    exported.message_bytes_max = std::max(exported.message_bytes_max, response.ByteSizeLong());
    exported.file += response.data();
  }
  exported.status = stream->Finish();
  return exported;
}

grpc::Status Import(TestServer& server, const std::string& map, const std::string& file,
                    const std::string& request_id = "", v1::ImportMapResponse* made = nullptr,
                    std::size_t step = 100'000) {
  grpc::ClientContext context;
  context.set_deadline(TestDeadline());
  v1::ImportMapResponse response;
  const auto stream = server.maps().ImportMap(&context, made == nullptr ? &response : made);
  v1::ImportMapRequest request;
  request.set_map(map);
  request.set_request_id(request_id);
  for (std::size_t at = 0; at == 0 || at < file.size(); at += step) {
    request.set_data(file.substr(at, step));
    if (!stream->Write(request)) break;
    request.Clear();
  }
  stream->WritesDone();
  return stream->Finish();
}

/// Every tile of every level, raw: address and bytes.
std::map<std::string, std::string> TilesOf(TestServer& server, const std::string& map) {
  std::map<std::string, std::string> tiles;
  for (std::uint32_t level = 0; level <= 6; ++level) {
    v1::GetTileMatrixRequest ask;
    v1::GetTileMatrixResponse matrix;
    ask.set_map(map);
    ask.set_level(level);
    EXPECT_TRUE(
        TestServer::Call(server.tiles(), &v1::TileService::Stub::GetTileMatrix, ask, matrix).ok());
    for (const auto& address : matrix.tiles()) {
      v1::BatchGetTilesRequest request;
      v1::BatchGetTilesResponse response;
      request.set_map(map);
      *request.add_tiles() = address;
      request.set_encoding(v1::CELL_ENCODING_RAW);
      for (const int layer : matrix.layers()) request.add_layers(static_cast<v1::Layer>(layer));
      EXPECT_TRUE(
          TestServer::Call(server.tiles(), &v1::TileService::Stub::BatchGetTiles, request, response)
              .ok());
      tiles[address.SerializeAsString()] = response.tiles(0).grid().SerializeAsString();
    }
  }
  return tiles;
}

grpc::Status Correct(TestServer& server, const std::string& map, const std::string& session) {
  v1::CorrectTrajectoryRequest request;
  v1::CorrectTrajectoryResponse response;
  request.set_map(map);
  request.set_session(session);
  for (const std::uint64_t seq : {1u, 30u}) {
    auto* pose = request.add_poses();
    pose->set_stamp_ns(StampOf(seq));
    wire::ToProto(Pose<Global, Base>::FromYaw(0.1 * static_cast<double>(seq), {3, 4, 1}),
                  pose->mutable_map_from_base());
  }
  return TestServer::Call(server.ingest(), &v1::IngestService::Stub::CorrectTrajectory, request,
                          response);
}

grpc::Status Retract(TestServer& server, const std::string& map, const std::string& session) {
  v1::RetractSessionRequest request;
  v1::RetractSessionResponse response;
  request.set_map(map);
  request.set_session(session);
  return TestServer::Call(server.maps(), &v1::MapService::Stub::RetractSession, request, response);
}

bool HasMap(TestServer& server, const std::string& map) {
  v1::GetMapRequest request;
  v1::GetMapResponse response;
  request.set_map(map);
  return TestServer::Call(server.maps(), &v1::MapService::Stub::GetMap, request, response).ok();
}

TEST(Transfers, AMapComesBackBitForBitAndBendsAlike) {
  TestServer server;
  Drive(server, "r1", "s1", 0);
  Drive(server, "r2", "s2", 2);
  const Exported exported = Export(server, "site");
  ASSERT_TRUE(exported.status.ok()) << exported.status.error_message();
  TestServer other;
  v1::ImportMapResponse made;
  const grpc::Status imported = Import(other, "copy", exported.file, "", &made, 333);
  ASSERT_TRUE(imported.ok()) << imported.error_message();
  EXPECT_EQ(made.map().id(), "copy");
  EXPECT_EQ(made.map().num_sessions(), 2u);
  EXPECT_GT(TilesOf(server, "site").size(), 6u);
  EXPECT_TRUE(TilesOf(server, "site") == TilesOf(other, "copy"));

  ASSERT_TRUE(Correct(server, "site", "s1").ok());
  ASSERT_TRUE(Correct(other, "copy", "s1").ok());
  EXPECT_TRUE(TilesOf(server, "site") == TilesOf(other, "copy"));
  ASSERT_TRUE(Retract(server, "site", "s2").ok());
  ASSERT_TRUE(Retract(other, "copy", "s2").ok());
  EXPECT_TRUE(TilesOf(server, "site") == TilesOf(other, "copy"));
}

// What a robot has in hand is in the file as the map shows it; the robot goes on, where it is.
TEST(Transfers, AMapIsExportedWhileARobotStreams) {
  TestServer server;
  TestStream stream(server.ingest(), TestOpen("r1", "s1"));
  for (std::uint64_t seq = 1; seq <= 20; ++seq)
    ASSERT_TRUE(stream.Send(FlatScan(seq, static_cast<double>(seq))));
  ASSERT_TRUE(stream.ReadUntilFused(20));
  const Exported exported = Export(server, "site");
  ASSERT_TRUE(exported.status.ok()) << exported.status.error_message();
  ASSERT_TRUE(stream.Send(FlatScan(21, 21)));
  ASSERT_TRUE(stream.ReadUntilFused(21));
  ASSERT_TRUE(stream.SendClose());
  ASSERT_TRUE(stream.ReadUntilClosed());

  ASSERT_TRUE(Import(server, "copy", exported.file).ok());
  v1::ListSessionsRequest request;
  v1::ListSessionsResponse response;
  request.set_map("copy");
  ASSERT_TRUE(
      TestServer::Call(server.maps(), &v1::MapService::Stub::ListSessions, request, response).ok());
  ASSERT_EQ(response.sessions_size(), 1);
  EXPECT_FALSE(response.sessions(0).active());
  // Two exports of one map that does not change are equal.
  EXPECT_EQ(Export(server, "copy").file.size(), Export(server, "copy").file.size());
}

TEST(Transfers, ARobotBeginsANewSessionInAnImportedMap) {
  TestServer server;
  Drive(server, "r1", "s1", 0);
  const std::string file = Export(server, "site").file;
  TestServer other;
  ASSERT_TRUE(Import(other, "site", file).ok());
  TestStream again(other.ingest(), TestOpen("r1", "s1"));
  const grpc::Status refused = again.Finish();
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_THAT(refused.error_message(), testing::HasSubstr("s1, which has ended, want a new id"));
  Drive(other, "r1", "s2", 1);
}

TEST(Transfers, TheSameImportTwiceMakesOneMap) {
  TestServer server;
  Drive(server, "r1", "s1", 0, 5);
  const std::string file = Export(server, "site").file;
  v1::ImportMapResponse first, second;
  ASSERT_TRUE(Import(server, "copy", file, "i1", &first).ok());
  ASSERT_TRUE(Import(server, "copy", file, "i1", &second).ok());
  EXPECT_EQ(first.map().version().epoch(), second.map().version().epoch());
  EXPECT_EQ(Import(server, "copy", file, "i2").error_code(), grpc::StatusCode::ALREADY_EXISTS);
  EXPECT_EQ(Import(server, "copy", file).error_code(), grpc::StatusCode::ALREADY_EXISTS);

  // At the same time.
  v1::ImportMapResponse made[2];
  grpc::Status status[2];
  std::thread thread([&] { status[0] = Import(server, "twice", file, "i3", &made[0]); });
  status[1] = Import(server, "twice", file, "i3", &made[1]);
  thread.join();
  EXPECT_TRUE(status[0].ok() && status[1].ok());
  EXPECT_EQ(made[0].map().version().epoch(), made[1].map().version().epoch());
}

TEST(Transfers, WhatIsNoMapLeavesNone) {
  TestServer server;
  Drive(server, "r1", "s1", 0, 5);
  std::string file = Export(server, "site").file;
  const auto refused = [&](const std::string& bytes) {
    const grpc::Status status = Import(server, "copy", bytes);
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << status.error_message();
    EXPECT_FALSE(HasMap(server, "copy"));
    return status.error_message();
  };
  EXPECT_THAT(refused(""), testing::HasSubstr("data at byte 0, section 0: the file is cut off"));
  EXPECT_THAT(refused(file.substr(0, file.size() / 2)), testing::HasSubstr("the file is cut off"));
  EXPECT_THAT(refused(file + "x"), testing::HasSubstr("want none behind END"));
  file[file.size() / 2] = static_cast<char>(file[file.size() / 2] ^ 1);
  EXPECT_THAT(refused(file), testing::HasSubstr("data at byte"));
  EXPECT_EQ(Export(server, "nowhere").status.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_EQ(Import(server, "no spaces", file).error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  // A refused import has given its place back.
  for (int i = 0; i < 10; ++i) refused(file);
}

TEST(Transfers, LimitsAreNamed) {
  ServerOptions options = TestOptions();
  options.maps_max = 1;
  options.import_bytes_max = 100'000;
  TestServer full(options);
  Drive(full, "r1", "s1", 0, 5);
  const std::string file = Export(full, "site").file;
  EXPECT_THAT(Import(full, "copy", file).error_message(), testing::HasSubstr("want at most 1"));
  options.maps_max = 9;
  options.import_bytes_max = file.size() - 1;
  TestServer small(options);
  const grpc::Status longer = Import(small, "copy", file);
  EXPECT_EQ(longer.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_THAT(longer.error_message(), testing::HasSubstr("want at most import_bytes_max"));
  options.import_bytes_max = file.size();
  options.import_memory_bytes_max = 1'000'000;
  TestServer narrow(options);
  const grpc::Status larger = Import(narrow, "copy", file);
  EXPECT_EQ(larger.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_THAT(larger.error_message(), testing::HasSubstr("import_memory_bytes_max"));
  EXPECT_FALSE(HasMap(small, "copy") || HasMap(narrow, "copy"));
}

TEST(Transfers, AreFewAtATime) {
  ServerOptions options = TestOptions();
  options.transfers_max = 1;
  TestServer server(options);
  Drive(server, "r1", "s1", 0, 5);
  const std::string file = Export(server, "site").file;
  {
    // An import that has begun, and hangs.
    grpc::ClientContext context;
    context.set_deadline(TestDeadline());
    v1::ImportMapResponse response;
    const auto stream = server.maps().ImportMap(&context, &response);
    v1::ImportMapRequest request;
    request.set_map("half");
    request.set_data(file.substr(0, 20));
    std::size_t bytes = 0;
    for (int i = 0; i < 2; ++i) {
      ASSERT_TRUE(stream->Write(request));
      bytes += request.ByteSizeLong();
      request.Clear();
      request.set_data(file.substr(20, 1));
    }
    // The second message is read when the first has been taken in.
    while (server.Metric("gem_rpc_bytes_total{direction=\"received\",method=\"ImportMap\"}") <
           static_cast<double>(bytes)) {
    }
    EXPECT_EQ(Export(server, "site").status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    context.TryCancel();
    EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::CANCELLED);
  }
  while (!Export(server, "site").status.ok()) {
  }
  EXPECT_FALSE(HasMap(server, "half"));
}

/// A file of many megabytes: ground that nothing compresses.
std::string LargeFile() {
  std::mt19937 random(1);
  const auto noise = [&](CellIndex) { return static_cast<float>(random()) * 1e-9f; };
  GlobalMapper mapper(GlobalMapOptions{}, 1);
  EXPECT_TRUE(mapper.AddSession("old", "r", {}).ok());
  SessionUpdate update;
  update.odometry = {{1, {}}, {2, {}}};
  for (const int i : {0, 1, 2, 3, 4})
    update.finished.push_back(test::MakeSubmap("old", i + 1, test::AtCells(800 * i, 0),
                                               {{0, 0}, {800, 800}}, noise, 1'000'000 * random()));
  EXPECT_TRUE(mapper.Update("old", std::move(update)).ok());
  CommitReport report;
  mapper.Commit(CancelToken(), report);
  map_file::Writer writer(std::make_shared<const MapState>(mapper.State()));
  std::string file;
  while (const std::optional<std::string> piece = writer.Next()) file += *piece;
  return file;
}

// A reader that does not read holds its export up, and nobody else; what it gets in the end is the
// map of the moment at which it asked.
TEST(Transfers, AnExportThatIsNotReadHoldsNobodyUp) {
  TestServer server;
  ASSERT_TRUE(Import(server, "site", LargeFile(), "", nullptr, 3'000'000).ok());
  const Exported whole = Export(server, "site");
  ASSERT_TRUE(whole.status.ok());
  EXPECT_LT(whole.message_bytes_max, std::size_t{1} << 20);
  EXPECT_GT(whole.file.size(), std::size_t{4} << 20);

  const std::string sent = "gem_rpc_bytes_total{direction=\"sent\",method=\"ExportMap\"}";
  const double sent_before = server.Metric(sent);
  grpc::ClientContext context;
  context.set_deadline(TestDeadline());
  v1::ExportMapRequest request;
  request.set_map("site");
  const auto held_up = server.maps().ExportMap(&context, request);
  v1::ExportMapResponse response;
  ASSERT_TRUE(held_up->Read(&response));
  v1::OpenSession open = TestOpen("r1", "s1");
  open.clear_map_setup();
  TestStream stream(server.ingest(), open);
  for (std::uint64_t seq = 1; seq <= 20; ++seq)
    ASSERT_TRUE(stream.Send(FlatScan(seq, static_cast<double>(seq))));
  ASSERT_TRUE(stream.SendClose());
  ASSERT_TRUE(stream.ReadUntilClosed());
  ASSERT_TRUE(Correct(server, "site", "s1").ok());
  const double sent_meanwhile = server.Metric(sent) - sent_before;
  EXPECT_GT(sent_meanwhile, 0);
  EXPECT_LT(sent_meanwhile, 0.5 * static_cast<double>(whole.file.size()));

  std::string file = response.data();
  while (held_up->Read(&response)) file += response.data();
  EXPECT_TRUE(held_up->Finish().ok());
  EXPECT_EQ(file.size(), whole.file.size());
  EXPECT_TRUE(file == whole.file);
}

}  // namespace
}  // namespace gem
