#include "server/byte_buffer.h"

#include <memory>
#include <string>
#include <vector>

namespace gem {
namespace {

using Shared = std::shared_ptr<const std::string>;

grpc::Slice ToSlice(const wire::SplicedMessage::Part& part) {
  if (part.shared == nullptr) return grpc::Slice(part.own);
  // The slice holds a reference of its own until the transport has sent it.
  return grpc::Slice(
      const_cast<char*>(part.shared->data()), part.shared->size(),
      [](void* held) { delete static_cast<Shared*>(held); }, new Shared(part.shared));
}

}  // namespace

grpc::ByteBuffer ToByteBuffer(const wire::SplicedMessage& message) {
  std::vector<grpc::Slice> slices;
  slices.reserve(message.parts().size());
  for (const wire::SplicedMessage::Part& part : message.parts()) slices.push_back(ToSlice(part));
  return {slices.data(), slices.size()};
}

}  // namespace gem
