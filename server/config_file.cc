#include <yaml-cpp/yaml.h>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "server/settings.h"

namespace gem {
namespace {

absl::Status At(const std::string& path, const YAML::Mark& mark, const std::string& text) {
  // Marks count from 0, people from 1.
  return absl::InvalidArgumentError(absl::StrCat(path, ":", mark.line + 1, ": ", text));
}

absl::Status Apply(const std::string& path, const std::string& prefix, const YAML::Node& node,
                   ServerOptions& options) {
  if (!node.IsMap()) return At(path, node.Mark(), "want \"key: value\" lines");
  for (const auto& entry : node) {
    const std::string key = prefix + entry.first.as<std::string>();
    if (entry.second.IsMap()) {
      GEM_RETURN_IF_ERROR(Apply(path, key + ".", entry.second, options));
      continue;
    }
    const Setting* setting = FindSetting(key);
    if (setting == nullptr)
      return At(path, entry.first.Mark(), absl::StrCat("there is no option \"", key, "\""));
    if (!entry.second.IsScalar())
      return At(path, entry.first.Mark(), absl::StrCat(key, " has no single value"));
    const absl::Status status = setting->set(entry.second.as<std::string>(), options);
    if (!status.ok()) return At(path, entry.second.Mark(), std::string(status.message()));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status ReadConfigFile(const std::string& path, ServerOptions& options) {
  try {
    const YAML::Node root = YAML::LoadFile(path);
    // An empty file changes nothing.
    return root.IsNull() ? absl::OkStatus() : Apply(path, "", root, options);
  } catch (const YAML::BadFile&) {
    return absl::NotFoundError(absl::StrCat(path, ": cannot be read"));
  } catch (const YAML::Exception& error) {
    return At(path, error.mark, error.msg);
  }
}

}  // namespace gem
