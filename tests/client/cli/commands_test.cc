// Every command by its definition, none left out: whoever adds one is held to what all have.
#include "client/cli/commands.h"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <functional>
#include <set>
#include <string>

namespace gem::client {
namespace {

/// Calls visit(command, "maps list") for all commands that do something.
void ForEachCommand(const CLI::App& app, const std::string& prefix,
                    const std::function<void(const CLI::App&, const std::string&)>& visit) {
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    const std::string name = prefix + command->get_name();
    if (command->get_subcommands([](const CLI::App*) { return true; }).empty())
      visit(*command, name);
    ForEachCommand(*command, name + " ", visit);
  }
}

class Commands : public testing::Test {
 protected:
  Commands() { AddCommands(app_, run_, exit_code_); }

  std::set<std::string> Names() const {
    std::set<std::string> names;
    ForEachCommand(app_, "", [&](const CLI::App&, const std::string& name) { names.insert(name); });
    return names;
  }

  std::function<absl::Status()> run_;
  int exit_code_ = 0;
  CLI::App app_;
};

TEST_F(Commands, AreFoundAtEveryDepth) {
  const std::set<std::string> names = Names();
  for (const char* name : {"status", "replay kitti", "bench local", "maps import", "sessions list",
                           "submaps list", "watch"})
    EXPECT_TRUE(names.contains(name)) << name;
}

/// For gem itself: the server that `bench serving` starts and compares with.
constexpr const char* kInternal = "bench bare_server";

TEST_F(Commands, AllSpeakJson) {
  ForEachCommand(app_, "", [](const CLI::App& command, const std::string& name) {
    if (name == kInternal) return;
    EXPECT_NE(command.get_option_no_throw("--json"), nullptr) << name;
  });
}

TEST_F(Commands, AllSayWhatTheyAreFor) {
  ForEachCommand(app_, "", [](const CLI::App& command, const std::string& name) {
    if (name == kInternal) return;
    EXPECT_FALSE(command.get_description().empty()) << name;
    for (const CLI::Option* option : command.get_options())
      EXPECT_FALSE(option->get_description().empty()) << name << " " << option->get_name();
  });
}

}  // namespace
}  // namespace gem::client
