#include "server/settings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

namespace gem {
namespace {

class ConfigFile : public testing::Test {
 protected:
  absl::Status Read(const std::string& text, ServerOptions& options) {
    std::ofstream(path_) << text;
    return ReadConfigFile(path_, options);
  }
  std::string Error(const std::string& text) {
    ServerOptions options;
    const absl::Status status = Read(text, options);
    EXPECT_FALSE(status.ok());
    const std::string message(status.message());
    // The path is the test's own.
    return message.rfind(path_, 0) == 0 ? message.substr(path_.size()) : message;
  }
  ~ConfigFile() override { std::remove(path_.c_str()); }

  const std::string path_ = testing::TempDir() + "/gem_config_" +
                            testing::UnitTest::GetInstance()->current_test_info()->name() + ".yaml";
};

TEST_F(ConfigFile, SetsNestedAndPlainOptions) {
  ServerOptions options;
  ASSERT_TRUE(Read("listen: 0.0.0.0:7\nmap:\n  cell_size_m: 0.1\nbackend: reference\n"
                   "reflection: false\nsessions_max: 3\n",
                   options)
                  .ok());
  EXPECT_EQ(options.listen, "0.0.0.0:7");
  EXPECT_EQ(options.map.cell_size_m, 0.1f);
  EXPECT_EQ(options.backend, LocalBackend::kReference);
  EXPECT_FALSE(options.reflection);
  EXPECT_EQ(options.sessions_max, 3);
}

TEST_F(ConfigFile, AnEmptyFileChangesNothing) {
  ServerOptions options;
  EXPECT_TRUE(Read("", options).ok());
  EXPECT_EQ(options.sessions_max, 64);
}

TEST_F(ConfigFile, NamesTheLineOfAnUnknownKey) {
  EXPECT_EQ(Error("listen: a:1\nmap:\n  cell_size: 0.1\n"),
            ":3: there is no option \"map.cell_size\"");
}

TEST_F(ConfigFile, NamesTheLineOfAWrongValue) {
  EXPECT_EQ(Error("\nsessions_max: many\n"), ":2: sessions_max is \"many\", want a whole number");
  EXPECT_EQ(Error("sessions_max: -1\nmap: 5\n"), ":2: there is no option \"map\"");
  EXPECT_EQ(Error("backend: gpu\n"), ":1: backend is \"gpu\", want auto, cpu, cuda or reference");
}

TEST_F(ConfigFile, NamesTheLineOfBrokenYaml) {
  EXPECT_THAT(Error("listen: a:1\nmap: [\n"), testing::StartsWith(":3: "));
  EXPECT_EQ(Error("- a\n- b\n"), ":1: want \"key: value\" lines");
}

TEST_F(ConfigFile, AMissingFileIsNamed) {
  ServerOptions options;
  EXPECT_EQ(std::string(ReadConfigFile("/nowhere/gem.yaml", options).message()),
            "/nowhere/gem.yaml: cannot be read");
}

/// The node of a setting in a file; undefined if it is not there.
YAML::Node Find(const YAML::Node& root, const std::string& name) {
  const std::size_t dot = name.find('.');
  if (dot == std::string::npos) return root[name];
  const YAML::Node level = root[name.substr(0, dot)];
  return level.IsDefined() ? level[name.substr(dot + 1)] : level;
}

TEST(ExampleFile, ShowsEveryOptionWithItsDefaultAndExplainsIt) {
  const std::string path = std::string(GEM_SOURCE_DIR) + "/deploy/gem_server.yaml";
  std::vector<std::string> lines = {""};  // lines count from 1
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) lines.push_back(line);
  const YAML::Node root = YAML::LoadFile(path);
  const ServerOptions defaults;
  for (const Setting& setting : Settings()) {
    const YAML::Node node = Find(root, setting.name);
    ASSERT_TRUE(node.IsDefined()) << setting.name << " is missing in " << path;
    EXPECT_EQ(node.as<std::string>(), setting.get(defaults)) << setting.name;
    const auto line = static_cast<std::size_t>(node.Mark().line) + 1;
    EXPECT_TRUE(lines[line].find('#') != std::string::npos || lines[line - 1].rfind("#", 0) == 0)
        << path << ":" << line << " does not say what it is";
  }
}

TEST(ExampleFile, IsReadWithoutChangingAnything) {
  ServerOptions options;
  options.sessions_max = 1;
  const absl::Status read =
      ReadConfigFile(std::string(GEM_SOURCE_DIR) + "/deploy/gem_server.yaml", options);
  ASSERT_TRUE(read.ok()) << read;
  for (const Setting& setting : Settings())
    EXPECT_EQ(setting.get(options), setting.get(ServerOptions())) << setting.name;
}

TEST(Settings, GiveBackWhatTheyWereSetTo) {
  // Every setting accepts its own default, and names are unique.
  const ServerOptions defaults;
  for (const Setting& setting : Settings()) {
    ServerOptions options;
    EXPECT_TRUE(setting.set(setting.get(defaults), options).ok()) << setting.name;
    EXPECT_EQ(setting.get(options), setting.get(defaults)) << setting.name;
    EXPECT_EQ(FindSetting(setting.name), &setting);
  }
  EXPECT_EQ(FindSetting("nonsense"), nullptr);
}

TEST(ServerOptions, DefaultsAreValidAndLimitsAreNamed) {
  ServerOptions options;
  EXPECT_TRUE(Validate(options).ok()) << Validate(options);
  options.sessions_max = 0;
  EXPECT_EQ(std::string(Validate(options).message()), "sessions_max is 0, want [1, 10000]");
  options = {};
  options.message_bytes_max = options.scan_bytes_max;
  EXPECT_THAT(std::string(Validate(options).message()),
              testing::StartsWith("message_bytes_max is 16777216, want [16777217,"));
  options = {};
  options.publish_hz = 0;
  EXPECT_THAT(std::string(Validate(options).message()), testing::StartsWith("publish_hz is 0"));
}

}  // namespace
}  // namespace gem
