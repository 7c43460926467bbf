// How a failed call reaches the user of the library: grpc::Status -> absl::Status. Private to the
// library.
#pragma once

#include <optional>
#include <string>

#include "absl/status/status.h"

namespace grpc {
class Status;
}

namespace gem::client {

/// The server's code and text. Fields that the server names in google.rpc.BadRequest and that its
/// text lacks are appended, as is the address if the server was not reached. The reason of
/// google.rpc.ErrorInfo is kept for programs.
absl::Status ToStatus(const grpc::Status& status, const std::string& address);

/// Of a server that sends bytes which are no message; UNAVAILABLE: another one may do better.
absl::Status DamageError(const std::string& address);

/// True if the server does not keep the version any more that was asked for.
bool IsRevisionExpired(const absl::Status& status);

/// What google.rpc.RetryInfo asks for, seconds.
std::optional<double> RetryAfter_s(const grpc::Status& status);

/// True if a stream may be opened again: the server was away, busy or shutting down. Not ABORTED:
/// another client has taken the session over, and taking it back would never end.
bool IsTransient(const absl::Status& status);

}  // namespace gem::client
