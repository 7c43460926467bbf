// absl::Status -> grpc::Status with google.rpc details: which field is wrong, when to try again, a
// reason for programs.
#pragma once

#include <grpcpp/support/status.h>

#include <string>

#include "absl/status/status.h"

namespace gem {

grpc::Status ToGrpc(const absl::Status& status);
/// "OK", "INVALID_ARGUMENT", ...
std::string CodeName(const absl::Status& status);

}  // namespace gem
