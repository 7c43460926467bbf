// Reads the #include lines of the sources: who may include whom is a rule, not a wish.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace gem {
namespace {

namespace fs = std::filesystem;

const fs::path kRoot = GEM_SOURCE_DIR;

std::vector<std::string> Includes(const fs::path& file) {
  static const std::regex kInclude(R"(^\s*#include\s+["<]([^">]+)[">])");
  std::vector<std::string> found;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (std::smatch match; std::regex_search(line, match, kInclude)) found.push_back(match[1]);
  }
  return found;
}

/// All files and folders below a folder, but not what npm installed.
std::vector<fs::path> Below(const std::string& folder) {
  std::vector<fs::path> found;
  for (auto entry = fs::recursive_directory_iterator(kRoot / folder); entry != fs::end(entry);
       ++entry) {
    if (entry->path().filename() == "node_modules") {
      entry.disable_recursion_pending();
    } else {
      found.push_back(entry->path());
    }
  }
  return found;
}

/// All sources below a folder, as paths relative to the root.
std::vector<std::string> Sources(const std::string& folder) {
  std::vector<std::string> found;
  for (const fs::path& path : Below(folder)) {
    const std::string extension = path.extension();
    if (extension == ".h" || extension == ".cc" || extension == ".cu") {
      found.push_back(fs::relative(path, kRoot));
    }
  }
  return found;
}

bool StartsWithAny(const std::string& text, const std::vector<std::string>& prefixes) {
  for (const std::string& prefix : prefixes) {
    if (text.rfind(prefix, 0) == 0) return true;
  }
  return false;
}

/// What the sources of `folder` include of the project although `allowed` does not name it.
std::vector<std::string> Trespasses(const std::string& folder,
                                    const std::vector<std::string>& allowed) {
  const std::vector<std::string> project = {"core/",   "proto/", "server/",
                                            "client/", "tests/", "gem/v1/"};
  std::vector<std::string> found;
  for (const std::string& source : Sources(folder)) {
    for (const std::string& include : Includes(kRoot / source)) {
      if (StartsWithAny(include, project) && !StartsWithAny(include, allowed)) {
        found.push_back(source + " includes " + include);
      }
    }
  }
  return found;
}

TEST(Layers, CoreRoomsLookDownOnly) {
  EXPECT_THAT(Trespasses("core/base", {"core/base/"}), testing::IsEmpty());
  EXPECT_THAT(Trespasses("core/geometry", {"core/base/", "core/geometry/"}), testing::IsEmpty());
  EXPECT_THAT(Trespasses("core/grid", {"core/base/", "core/geometry/", "core/grid/"}),
              testing::IsEmpty());
  EXPECT_THAT(
      Trespasses("core/sensor", {"core/base/", "core/geometry/", "core/grid/", "core/sensor/"}),
      testing::IsEmpty());
  EXPECT_THAT(Trespasses("core/gpu", {"core/base/", "core/gpu/"}), testing::IsEmpty());
  EXPECT_THAT(Trespasses("core/local", {"core/base/", "core/geometry/", "core/grid/",
                                        "core/sensor/", "core/gpu/", "core/local/"}),
              testing::IsEmpty());
  EXPECT_THAT(Trespasses("core/global", {"core/"}), testing::IsEmpty());
}

TEST(Layers, CoreKnowsNoProtobufGrpcPrometheusOrFlags) {
  std::vector<std::string> found;
  for (const std::string& source : Sources("core")) {
    for (const std::string& include : Includes(kRoot / source)) {
      if (StartsWithAny(include,
                        {"google/protobuf", "grpc", "prometheus", "CLI/", "yaml-cpp", "spdlog"}) ||
          include.find(".pb.h") != std::string::npos) {
        found.push_back(source + " includes " + include);
      }
    }
  }
  EXPECT_THAT(found, testing::IsEmpty());
}

TEST(Layers, ServerNeverIncludesClientNorClientServer) {
  EXPECT_THAT(Trespasses("server", {"core/", "proto/", "server/", "gem/v1/"}), testing::IsEmpty());
  EXPECT_THAT(Trespasses("client", {"core/", "proto/", "client/", "gem/v1/"}), testing::IsEmpty());
  EXPECT_THAT(Trespasses("proto", {"core/", "proto/", "gem/v1/"}), testing::IsEmpty());
}

TEST(Layers, ThePublicClientShowsNoProtobufAndNoGrpc) {
  std::vector<std::string> found;
  for (const auto& entry : fs::directory_iterator(kRoot / "client")) {
    if (entry.path().extension() != ".h") continue;
    for (const std::string& include : Includes(entry.path())) {
      if (include.find(".pb.h") != std::string::npos ||
          StartsWithAny(include, {"grpc", "google/", "proto/"})) {
        found.push_back(entry.path().filename().string() + " includes " + include);
      }
    }
  }
  EXPECT_THAT(found, testing::IsEmpty());
}

/// Every file that `file` includes of the project, however far down, itself among them.
std::set<std::string> Reachable(const std::string& file) {
  std::set<std::string> seen;
  std::vector<std::string> todo = {file};
  while (!todo.empty()) {
    const std::string next = todo.back();
    todo.pop_back();
    if (!fs::exists(kRoot / next) || !seen.insert(next).second) continue;
    for (const std::string& include : Includes(kRoot / next)) todo.push_back(include);
  }
  return seen;
}

TEST(Layers, IncludesHaveNoCycle) {
  std::vector<std::string> cycles;
  for (const char* folder : {"core", "proto", "server", "client"}) {
    for (const std::string& source : Sources(folder)) {
      for (const std::string& include : Includes(kRoot / source)) {
        if (include != source && Reachable(include).count(source) > 0) {
          cycles.push_back(source + " <-> " + include);
        }
      }
    }
  }
  EXPECT_THAT(cycles, testing::IsEmpty());
}

/// The files below core and tests in which a text stands, but for this one.
std::vector<std::string> FilesWith(const std::string& text) {
  std::vector<std::string> found;
  for (const char* folder : {"core", "proto", "server", "client", "tests"}) {
    for (const std::string& source : Sources(folder)) {
      if (source == "tests/layers/layers_test.cc") continue;
      std::ifstream in(kRoot / source);
      const std::string content{std::istreambuf_iterator<char>(in), {}};
      if (content.find(text) != std::string::npos) found.push_back(source);
    }
  }
  return found;
}

// Else the emulation would not be told.
TEST(Layers, KernelsAreLaunchedInOnePlaceAndCudaIsCalledInOne) {
  EXPECT_THAT(FilesWith("<<<"), testing::ElementsAre("core/gpu/launch.h"));
  EXPECT_THAT(FilesWith("cuda_runtime_api.h"), testing::ElementsAre("core/gpu/cuda_runtime.cc"));
  EXPECT_THAT(FilesWith("cuda_runtime.h"), testing::IsEmpty());
  EXPECT_THAT(FilesWith("__syncthreads"), testing::ElementsAre("core/gpu/device.h"));
  EXPECT_THAT(FilesWith("threadIdx"), testing::ElementsAre("core/gpu/device.h"));
}

TEST(Layers, OnlyTheCudaBackendSeesTheGpu) {
  std::vector<std::string> found;
  for (const std::string& source : Sources("core")) {
    if (StartsWithAny(source, {"core/gpu/", "core/local/cuda/"})) continue;
    for (const std::string& include : Includes(kRoot / source)) {
      if (StartsWithAny(include, {"core/gpu/"})) found.push_back(source + " includes " + include);
    }
  }
  EXPECT_THAT(found, testing::IsEmpty());
}

TEST(Layers, TheReaderSeesTheIncludesItJudges) {
  EXPECT_THAT(Includes(kRoot / "core/grid/cell_belief.h"),
              testing::Contains("core/grid/cell_index.h"));
  EXPECT_THAT(Trespasses("core/local", {"core/base/"}), testing::Not(testing::IsEmpty()));
}

TEST(Style, NoDrawersAndNoTabs) {
  const std::set<std::string> kDrawers = {"utils", "util", "common", "misc", "helpers"};
  for (const char* folder : {"core", "proto", "server", "client", "tests"}) {
    for (const fs::path& path : Below(folder)) {
      EXPECT_EQ(kDrawers.count(path.filename()), 0u) << path;
    }
    for (const std::string& source : Sources(folder)) {
      std::ifstream in(kRoot / source);
      const std::string text{std::istreambuf_iterator<char>(in), {}};
      EXPECT_EQ(text.find('\t'), std::string::npos) << source;
      if (fs::path(source).extension() == ".h") {
        EXPECT_EQ(text.rfind("//", 0), 0u)
            << source << " does not say in its first line what it is";
      }
    }
  }
}

}  // namespace
}  // namespace gem
