// Messages that gRPC neither parses nor writes for us.
#pragma once

#include <grpcpp/impl/codegen/proto_utils.h>
#include <grpcpp/support/byte_buffer.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "proto/wire/spliced_message.h"

namespace gem {

/// Shares what the message shares.
grpc::ByteBuffer ToByteBuffer(const wire::SplicedMessage& message);

/// INVALID_ARGUMENT if the bytes are no such message.
template <typename Request>
absl::StatusOr<Request> Parse(const grpc::ByteBuffer& bytes) {
  grpc::ByteBuffer buffer = bytes;  // parsing empties it
  Request request;
  if (!grpc::SerializationTraits<Request>::Deserialize(&buffer, &request).ok())
    return absl::InvalidArgumentError("the bytes are not a message of this method");
  return request;
}

}  // namespace gem
