// Early return on a failed absl::Status or absl::StatusOr.
#pragma once

#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#define GEM_RETURN_IF_ERROR(expression)                                              \
  do {                                                                               \
    if (absl::Status gem_status = (expression); !gem_status.ok()) return gem_status; \
  } while (false)

#define GEM_CONCAT_INNER(a, b) a##b
#define GEM_CONCAT(a, b) GEM_CONCAT_INNER(a, b)

/// GEM_ASSIGN_OR_RETURN(const Pose<Odom, Base> T_O_B, FromProto(...));
#define GEM_ASSIGN_OR_RETURN(declaration, expression) \
  GEM_ASSIGN_OR_RETURN_INNER(GEM_CONCAT(gem_status_or_, __LINE__), declaration, expression)

// The declaration may hold a comma inside template arguments: pass it in parentheses-free form with
// `auto`.
#define GEM_ASSIGN_OR_RETURN_INNER(status_or, declaration, expression) \
  auto status_or = (expression);                                       \
  if (!status_or.ok()) return std::move(status_or).status();           \
  declaration = *std::move(status_or)
