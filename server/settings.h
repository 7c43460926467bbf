// Names of the options for people: one table for flags and the configuration file.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "server/options.h"

namespace gem {

struct Setting {
  std::string name;  ///< flag --name; in the file the dots are levels
  std::string help;
  /// INVALID_ARGUMENT: "sessions_max is \"many\", want a whole number".
  std::function<absl::Status(const std::string& value, ServerOptions& options)> set;
  std::function<std::string(const ServerOptions& options)> get;
};

const std::vector<Setting>& Settings();

/// Null for an unknown name.
const Setting* FindSetting(const std::string& name);

/// Reads a YAML file over `options`. Errors name the file and the line; unknown keys are errors.
absl::Status ReadConfigFile(const std::string& path, ServerOptions& options);

}  // namespace gem
