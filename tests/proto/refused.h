// What every refusal of the wire must say: the field, for programs and for people.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "proto/wire/refusal.h"

namespace gem::wire {

inline absl::Status StatusOf(const absl::Status& status) { return status; }
template <typename T>
absl::Status StatusOf(const absl::StatusOr<T>& result) {
  return result.status();
}

/// INVALID_ARGUMENT that carries the field and whose text is "field is ..., want ...".
MATCHER_P2(Refused, field, text, "") {
  const absl::Status status = StatusOf(arg);
  *result_listener << status.ToString();
  return status.code() == absl::StatusCode::kInvalidArgument && FieldOf(status) == field &&
         std::string(status.message()) == text;
}

}  // namespace gem::wire
