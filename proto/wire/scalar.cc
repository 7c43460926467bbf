#include "proto/wire/scalar.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "proto/wire/refusal.h"

namespace gem::wire {
namespace {

constexpr std::size_t kIdChars_max = 64;

bool IdCharacter(char c) {
  return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '.' || c == '-';
}

}  // namespace

absl::Status CheckId(const std::string& id, const FieldPath& field) {
  if (!id.empty() && id.size() <= kIdChars_max &&
      absl::ascii_isalnum(static_cast<unsigned char>(id.front())) &&
      std::all_of(id.begin(), id.end(), IdCharacter))
    return absl::OkStatus();
  // What a stranger wrote goes into logs and terminals: escaped and cut.
  const std::string shown = absl::CEscape(id.substr(0, kIdChars_max));
  return Refuse(field, absl::StrCat("\"", shown, id.size() > kIdChars_max ? "...\"" : "\""),
                "1 to 64 characters of [A-Za-z0-9_.-], the first a letter or digit");
}

absl::Status CheckRequestId(const std::string& id, const FieldPath& field) {
  return id.empty() ? absl::OkStatus() : CheckId(id, field);
}

absl::Status CheckStamp(std::int64_t stamp_ns, const FieldPath& field) {
  if (stamp_ns >= 0 && stamp_ns <= kStamp_nsMax) return absl::OkStatus();
  return Refuse(field, absl::StrCat(stamp_ns), absl::StrCat("0 to ", kStamp_nsMax));
}

absl::Status CheckFinite(double value, const FieldPath& field) {
  if (std::isfinite(value)) return absl::OkStatus();
  return Refuse(field, value, "a finite number");
}

}  // namespace gem::wire
