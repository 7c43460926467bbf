// What a fleet's backend does with the command line: every answer is parsed as JSON, as a program
// would.
#include <gmock/gmock.h>
#include <google/protobuf/struct.pb.h>
#include <google/protobuf/util/json_util.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <utility>
#include <vector>

#include "tests/end_to_end/process.h"

namespace gem::test {
namespace {

using google::protobuf::Struct;
using google::protobuf::Value;

/// Runs gem with --json against the server: one object.
class Fleet : public testing::Test {
 protected:
  Struct Json(std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--server", server_.address(), "--json"});
    const Finished run = Gem(arguments);
    EXPECT_EQ(run.exit_code, 0) << run.output;
    // Progress goes to stderr, which the test sees as well.
    const std::size_t begin = run.output.find('{');
    Struct json;
    const auto parsed = google::protobuf::util::JsonStringToMessage(
        begin == std::string::npos ? run.output : run.output.substr(begin), &json);
    EXPECT_TRUE(parsed.ok()) << arguments[0] << ": " << run.output;
    return json;
  }
  static double Number(const Struct& json, const std::string& key) {
    EXPECT_TRUE(json.fields().contains(key)) << json.ShortDebugString();
    return json.fields().contains(key) ? json.fields().at(key).number_value() : -1;
  }
  static const google::protobuf::RepeatedPtrField<Value>& List(const Struct& json,
                                                               const std::string& key) {
    return json.fields().at(key).list_value().values();
  }
  void Drive(const std::string& robot, const std::string& session, int num_scans) {
    const Struct summary = Json({"simulate", "flat", "--map", "site", "--robot", robot, "--session",
                                 session, "--scans", std::to_string(num_scans), "--rings", "16"});
    EXPECT_EQ(Number(summary, "num_scans_fused"), num_scans);
  }

  ServerProcess server_;
  ScratchDir scratch_;
};

std::string Contents(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST_F(Fleet, MakesListsRetractsExportsAndImportsMaps) {
  const Struct made = Json({"maps", "create", "--map", "site", "--cell_size_m", "0.4"});
  EXPECT_NEAR(Number(made, "cell_size_m"), 0.4, 1e-6);
  Drive("r1", "s1", 20);
  Drive("r2", "s2", 80);
  EXPECT_EQ(List(Json({"maps", "list"}), "maps").size(), 1);
  EXPECT_EQ(Number(Json({"maps", "show", "--map", "site"}), "num_sessions"), 2);
  EXPECT_EQ(List(Json({"sessions", "list", "--map", "site"}), "sessions").size(), 2);
  EXPECT_GT(List(Json({"submaps", "list", "--map", "site"}), "submaps").size(), 0);

  const std::string file = scratch_.File("site.gem");
  const Struct exported = Json({"maps", "export", "--map", "site", "--out", file});
  EXPECT_EQ(Number(exported, "size_bytes"), static_cast<double>(Contents(file).size()));
  EXPECT_FALSE(std::filesystem::exists(file + ".part"));
  EXPECT_EQ(Number(Json({"maps", "import", "--map", "copy", "--in", file}), "num_sessions"), 2);

  // Both maps, before and after a retraction, are the same picture byte for byte. Of what both
  // robots saw nothing is left then; the second one drove on.
  const auto picture = [&](const std::string& map) {
    const std::string out = scratch_.File(map + ".asc");
    EXPECT_GT(Number(Json({"export", "--map", map, "--out", out}), "columns"), 10);
    return Contents(out);
  };
  const std::string whole = picture("site");
  EXPECT_TRUE(picture("copy") == whole);
  for (const char* map : {"site", "copy"})
    EXPECT_GT(Number(Json({"sessions", "retract", "--map", map, "--session", "s1"}), "revision"),
              0);
  EXPECT_TRUE(picture("copy") == picture("site"));
  Json({"sessions", "restore", "--map", "copy", "--session", "s1"});
  EXPECT_TRUE(picture("copy") == whole);

  Json({"maps", "delete", "--map", "copy"});
  EXPECT_EQ(List(Json({"maps", "list"}), "maps").size(), 1);
}

TEST_F(Fleet, OtherCommandsSpeakJsonToo) {
  Drive("r1", "s1", 30);
  EXPECT_EQ(List(Json({"status"}), "maps").size(), 1);
  EXPECT_GT(
      Number(Json({"local", "--robot", "r1", "--out", scratch_.File("local.asc")}), "num_valid"),
      0);
  Json({"top", "--once", "--interval_s", "0.1"});
  EXPECT_EQ(List(Json({"sample", "--map", "site", "4,-1"}), "samples").size(), 1);
  std::ofstream(scratch_.File("poses")) << "1 0 0 1  0 1 0 0  0 0 1 0\n";
  std::ofstream(scratch_.File("times")) << "1e9\n";
  const Finished late =
      Gem({"correct", "--server", server_.address(), "--map", "site", "--session", "s1", "--poses",
           scratch_.File("poses"), "--times", scratch_.File("times"), "--json"});
  EXPECT_EQ(late.exit_code, 1) << "after the session ended";
}

TEST_F(Fleet, AFileThatIsNoMapIsNamedAndLeavesNothing) {
  std::ofstream(scratch_.File("no.gem")) << "GIF89a and what follows in such a file\n";
  const Finished run = Gem({"maps", "import", "--server", server_.address(), "--map", "copy",
                            "--in", scratch_.File("no.gem")});
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.output, testing::HasSubstr("data at byte 0, section 0: magic is"));
  EXPECT_EQ(List(Json({"maps", "list"}), "maps").size(), 0);
  const Finished nowhere = Gem({"maps", "export", "--server", server_.address(), "--map", "nowhere",
                                "--out", scratch_.File("x.gem")});
  EXPECT_EQ(nowhere.exit_code, 1);
  EXPECT_FALSE(std::filesystem::exists(scratch_.File("x.gem")));
  EXPECT_FALSE(std::filesystem::exists(scratch_.File("x.gem.part")));
}

}  // namespace
}  // namespace gem::test
