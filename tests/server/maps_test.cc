// Maps over the wire: made, listed, deleted; their sessions page by page.
#include <gmock/gmock.h>

#include <set>
#include <string>

#include "tests/server/test_server.h"

namespace gem {
namespace {

v1::CreateMapRequest Creation(const std::string& map, const std::string& request_id = "") {
  v1::CreateMapRequest request;
  request.set_map(map);
  request.set_request_id(request_id);
  return request;
}

grpc::Status Create(TestServer& server, const v1::CreateMapRequest& request,
                    v1::CreateMapResponse& response) {
  return TestServer::Call(server.maps(), &v1::MapService::Stub::CreateMap, request, response);
}

grpc::Status Delete(TestServer& server, const std::string& map, bool force = false,
                    const std::string& request_id = "") {
  v1::DeleteMapRequest request;
  v1::DeleteMapResponse response;
  request.set_map(map);
  request.set_force(force);
  request.set_request_id(request_id);
  return TestServer::Call(server.maps(), &v1::MapService::Stub::DeleteMap, request, response);
}

grpc::Status List(TestServer& server, const std::string& map, std::uint32_t page_size,
                  const std::string& token, v1::ListSessionsResponse& response) {
  v1::ListSessionsRequest request;
  request.set_map(map);
  request.set_page_size(page_size);
  request.set_page_token(token);
  response.Clear();
  return TestServer::Call(server.maps(), &v1::MapService::Stub::ListSessions, request, response);
}

/// Drives a few metres in map "site" and ends.
void Drive(TestServer& server, const std::string& robot, const std::string& session) {
  TestStream stream(server.ingest(), TestOpen(robot, session));
  for (std::uint64_t seq = 1; seq <= 5; ++seq)
    ASSERT_TRUE(stream.Send(FlatScan(seq, static_cast<double>(seq))));
  ASSERT_TRUE(stream.SendClose());
  ASSERT_TRUE(stream.ReadUntilClosed());
}

TEST(Maps, AreMadeAsTheSetupSaysAndOnlyOnce) {
  TestServer server;
  v1::CreateMapRequest request = Creation("hall", "r1");
  request.mutable_setup()->set_cell_size_m(0.25f);
  request.mutable_setup()->set_submap_length_m(7);
  v1::CreateMapResponse made;
  ASSERT_TRUE(Create(server, request, made).ok());
  EXPECT_EQ(made.map().id(), "hall");
  EXPECT_EQ(made.map().cell_size_m(), 0.25);
  EXPECT_EQ(made.map().submap_length_m(), 7);
  EXPECT_EQ(made.map().num_tiles(), 0u);

  v1::CreateMapResponse again;
  ASSERT_TRUE(Create(server, request, again).ok());
  EXPECT_EQ(again.map().version().epoch(), made.map().version().epoch());
  EXPECT_EQ(Create(server, Creation("hall", "r2"), again).error_code(),
            grpc::StatusCode::ALREADY_EXISTS);
}

TEST(Maps, RefusedFieldsAreNamed) {
  TestServer server;
  v1::CreateMapResponse response;
  v1::CreateMapRequest request = Creation("hall");
  request.mutable_setup()->set_cell_size_m(99);
  grpc::Status status = Create(server, request, response);
  EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT);
  EXPECT_THAT(status.error_message(), testing::StartsWith("setup.cell_size_m is 99, want"));
  EXPECT_THAT(Create(server, Creation("no spaces"), response).error_message(),
              testing::StartsWith("map is \"no spaces\""));
  EXPECT_THAT(Create(server, Creation("hall", "?"), response).error_message(),
              testing::StartsWith("request_id is \"?\""));
  EXPECT_EQ(Delete(server, "nowhere").error_code(), grpc::StatusCode::NOT_FOUND);
}

TEST(Maps, AFullServerSaysSo) {
  ServerOptions options = TestOptions();
  options.maps_max = 2;
  TestServer server(options);
  v1::CreateMapResponse response;
  ASSERT_TRUE(Create(server, Creation("a"), response).ok());
  ASSERT_TRUE(Create(server, Creation("b"), response).ok());
  EXPECT_EQ(Create(server, Creation("c"), response).error_code(),
            grpc::StatusCode::RESOURCE_EXHAUSTED);
  ASSERT_TRUE(Delete(server, "a").ok());
  EXPECT_TRUE(Create(server, Creation("c"), response).ok());
}

TEST(Maps, ADeletedMapTakesItsMetricsAndItsStreamsAlong) {
  TestServer server;
  TestStream stream(server.ingest(), TestOpen("r1", "s1"));
  ASSERT_TRUE(stream.Send(FlatScan(1, 0)));
  ASSERT_TRUE(stream.ReadUntilFused(1));
  EXPECT_GE(server.Metric("gem_tiles{map=\"site\"}"), 0);

  const grpc::Status refused = Delete(server, "site");
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::FAILED_PRECONDITION);
  EXPECT_THAT(refused.error_message(), testing::HasSubstr("s1"));
  ASSERT_TRUE(Delete(server, "site", true, "d1").ok());
  EXPECT_TRUE(Delete(server, "site", true, "d1").ok()) << "sent again";

  const grpc::Status end = stream.Finish();
  EXPECT_EQ(end.error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_THAT(end.error_message(), testing::HasSubstr("site, which has been deleted"));
  EXPECT_EQ(server.Metric("gem_tiles{map=\"site\"}"), -1);
  EXPECT_EQ(server.Metric("gem_map_staleness_seconds{map=\"site\"}"), -1);
  EXPECT_EQ(server.Metric("gem_sessions{state=\"connected\"}"), 0);
}

TEST(Maps, AMapThatIsMadeAgainHasAnotherEpochAndNothingOfTheOld) {
  TestServer server;
  Drive(server, "r1", "s1");
  const TestMap before = FetchMap(server, "site");
  EXPECT_FALSE(before.tiles.empty());
  ASSERT_TRUE(Delete(server, "site").ok());
  v1::CreateMapResponse made;
  ASSERT_TRUE(Create(server, Creation("site"), made).ok());
  EXPECT_GT(made.map().version().epoch(), before.version.epoch);
  EXPECT_EQ(made.map().num_points(), 0u);
  EXPECT_EQ(made.map().num_sessions(), 0u);
}

TEST(Maps, ListSessionsInOrderOfArrivalPageByPage) {
  TestServer server;
  // Not in the order of their names.
  const std::vector<std::string> ids = {"z", "a", "m", "b"};
  for (const std::string& id : ids) Drive(server, "robot-" + id, id);
  TestStream still_there(server.ingest(), TestOpen("late", "c"));

  std::vector<std::string> listed;
  std::string token;
  v1::ListSessionsResponse page;
  do {
    ASSERT_TRUE(List(server, "site", 2, token, page).ok());
    ASSERT_LE(page.sessions_size(), 2);
    for (const v1::Session& session : page.sessions()) {
      listed.push_back(session.id());
      EXPECT_EQ(session.active(), session.id() == "c");
      EXPECT_EQ(session.robot(), session.id() == "c" ? "late" : "robot-" + session.id());
      EXPECT_EQ(session.map_from_odom().qw(), 1);
    }
    token = page.next_page_token();
  } while (!token.empty());
  EXPECT_THAT(listed, testing::ElementsAre("z", "a", "m", "b", "c"));
}

TEST(Maps, SessionsSayWhatHangsOnThem) {
  TestServer server;
  Drive(server, "r1", "s1");
  v1::ListSessionsResponse page;
  ASSERT_TRUE(List(server, "site", 0, "", page).ok());
  ASSERT_EQ(page.sessions_size(), 1);
  EXPECT_EQ(page.sessions(0).num_submaps(), 1u);
  EXPECT_EQ(static_cast<double>(page.sessions(0).num_points()),
            server.Metric("gem_points{map=\"site\"}"));
  EXPECT_GT(page.sessions(0).num_points(), 100u);
}

grpc::Status Retract(TestServer& server, const std::string& session, bool restore,
                     v1::RetractSessionResponse& response, const std::string& request_id = "") {
  v1::RetractSessionRequest request;
  request.set_map("site");
  request.set_session(session);
  request.set_restore(restore);
  request.set_request_id(request_id);
  response.Clear();
  return TestServer::Call(server.maps(), &v1::MapService::Stub::RetractSession, request, response);
}

v1::ListSubmapsResponse Submaps(TestServer& server) {
  v1::ListSubmapsRequest request;
  v1::ListSubmapsResponse response;
  request.set_map("site");
  EXPECT_TRUE(
      TestServer::Call(server.maps(), &v1::MapService::Stub::ListSubmaps, request, response).ok());
  return response;
}

TEST(Maps, ARetractedSessionLeavesTheMapAndComesBack) {
  TestServer server;
  Drive(server, "r1", "s1");
  const TestMap before = FetchMap(server, "site");
  v1::RetractSessionResponse retracted;
  ASSERT_TRUE(Retract(server, "s1", false, retracted, "a").ok());
  EXPECT_EQ(retracted.num_submaps(), 1u);
  EXPECT_EQ(retracted.num_merged_points(), 0u);
  EXPECT_EQ(retracted.num_touched_tiles(), before.tiles.size());
  EXPECT_EQ(retracted.version().revision(), before.version.revision + 1);
  EXPECT_TRUE(FetchMap(server, "site").Cells().empty());
  v1::ListSessionsResponse page;
  ASSERT_TRUE(List(server, "site", 0, "", page).ok());
  EXPECT_TRUE(page.sessions(0).retracted());
  EXPECT_EQ(page.sessions(0).num_submaps(), 0u);

  v1::RetractSessionResponse restored;
  ASSERT_TRUE(Retract(server, "s1", true, restored).ok());
  EXPECT_EQ(restored.num_submaps(), 1u);
  EXPECT_EQ(FetchMap(server, "site").Cells(), before.Cells());
  v1::RetractSessionResponse repeated;
  ASSERT_TRUE(Retract(server, "s1", false, repeated, "a").ok());
  EXPECT_EQ(repeated.version().revision(), retracted.version().revision());
  EXPECT_EQ(FetchMap(server, "site").Cells(), before.Cells()) << "sent again, done once";
}

TEST(Maps, RetractionsAreValidated) {
  TestServer server;
  Drive(server, "r1", "s1");
  v1::RetractSessionResponse response;
  EXPECT_EQ(Retract(server, "s2", false, response).error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_THAT(Retract(server, "", false, response).error_message(),
              testing::StartsWith("session is \"\""));
  EXPECT_THAT(Retract(server, "s1", false, response, "?").error_message(),
              testing::StartsWith("request_id is \"?\""));
}

TEST(Maps, SubmapsSayWhereTheyAreAndWhoMadeThem) {
  TestServer server;
  Drive(server, "r1", "s1");
  Drive(server, "r2", "s2");
  const v1::ListSubmapsResponse merged = Submaps(server);
  ASSERT_EQ(merged.submaps_size(), 1) << "they drove the same way";
  const v1::Submap& submap = merged.submaps(0);
  EXPECT_THAT(submap.robots(), testing::ElementsAre("r1", "r2"));
  EXPECT_THAT(submap.sessions(), testing::ElementsAre("s1", "s2"));
  EXPECT_EQ(submap.session(), "s1");
  double x_min = 1e9, x_max = -1e9;
  for (const auto& [cell, height] : FetchMap(server, "site").Cells()) {
    x_min = std::min(x_min, cell.x * 0.5);
    x_max = std::max(x_max, (cell.x + 1) * 0.5);
  }
  EXPECT_EQ(submap.extent().x_min(), x_min);
  EXPECT_EQ(submap.extent().x_max(), x_max);
  v1::RetractSessionResponse response;
  ASSERT_TRUE(Retract(server, "s2", false, response).ok());
  EXPECT_GT(response.num_merged_points(), 0u);
  const v1::ListSubmapsResponse without = Submaps(server);
  for (const v1::Submap& each : without.submaps())
    EXPECT_THAT(each.robots(), testing::ElementsAre("r1"));
}

TEST(Maps, SessionPagesAreValidated) {
  TestServer server;
  Drive(server, "r1", "s1");
  v1::ListSessionsResponse page;
  EXPECT_EQ(List(server, "nowhere", 0, "", page).error_code(), grpc::StatusCode::NOT_FOUND);
  EXPECT_THAT(List(server, "site", 1001, "", page).error_message(),
              testing::StartsWith("page_size is 1001, want at most 1000"));
  EXPECT_THAT(List(server, "site", 0, "s2", page).error_message(),
              testing::StartsWith("page_token is not one of this server's"));
  EXPECT_TRUE(List(server, "site", 0, "s1", page).ok());
  EXPECT_EQ(page.sessions_size(), 0);
}

TEST(Maps, NameTheirNewestSessionsOnly) {
  TestServer server;
  for (int i = 0; i < 103; ++i) {
    v1::OpenSession open = TestOpen("r", "s" + std::to_string(i));
    TestStream stream(server.ingest(), open);
    ASSERT_TRUE(stream.SendClose());
    ASSERT_TRUE(stream.ReadUntilClosed());
  }
  v1::GetMapRequest request;
  v1::GetMapResponse response;
  request.set_map("site");
  ASSERT_TRUE(
      TestServer::Call(server.maps(), &v1::MapService::Stub::GetMap, request, response).ok());
  ASSERT_EQ(response.map().sessions_size(), 100);
  EXPECT_EQ(response.map().sessions(0), "s3");
  EXPECT_EQ(response.map().sessions(99), "s102");
  EXPECT_EQ(response.map().num_sessions(), 103u);
}

}  // namespace
}  // namespace gem
