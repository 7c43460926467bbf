// What every command needs to write JSON by hand. Not a library for JSON: objects are put together
// where they are written.
#pragma once

#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/string_view.h"

namespace gem::client {

/// "text", with what must be escaped.
std::string JsonText(absl::string_view text);

/// null if it is not finite: JSON knows no infinity and no NaN.
std::string JsonNumber(double value);

inline absl::string_view JsonBool(bool value) { return value ? "true" : "false"; }

/// [to_json(item), ...].
template <typename Items, typename ToJson>
std::string JsonArray(const Items& items, ToJson to_json) {
  return absl::StrCat("[",
                      absl::StrJoin(items, ",",
                                    [&](std::string* out, const auto& item) {
                                      absl::StrAppend(out, to_json(item));
                                    }),
                      "]");
}

}  // namespace gem::client
