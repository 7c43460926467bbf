#include "client/load/watch_load.h"

#include <grpcpp/channel.h>

#include "client/call_status.h"
#include "gem/v1/tile_service.pb.h"

namespace gem::load {
namespace {

constexpr char kMethod[] = "/gem.v1.TileService/WatchTiles";

grpc::ByteBuffer RequestFor(const std::string& map) {
  v1::WatchTilesRequest request;
  request.set_map(map);
  const grpc::Slice slice(request.SerializeAsString());
  return {&slice, 1};
}

}  // namespace

WatchLoad::WatchLoad(const client::Connection& connection, const std::string& map, bool reads)
    : stub_(connection.channel()), request_(RequestFor(map)) {
  stub_.PrepareBidiStreamingCall(&context_, kMethod, {}, this);
  StartWriteLast(&request_, grpc::WriteOptions());
  if (reads) StartRead(&received_);
  StartCall();
}

WatchLoad::~WatchLoad() {
  context_.TryCancel();
  MutexLock lock(mutex_);
  while (!end_.has_value()) changed_.Wait(mutex_);
}

WatchReport WatchLoad::report() const {
  MutexLock lock(mutex_);
  return report_;
}

std::optional<absl::Status> WatchLoad::end() const {
  MutexLock lock(mutex_);
  return end_;
}

void WatchLoad::OnReadDone(bool ok) {
  if (!ok) return;
  {
    MutexLock lock(mutex_);
    ++report_.num_messages;
    report_.num_bytes += received_.Length();
  }
  StartRead(&received_);
}

void WatchLoad::OnDone(const grpc::Status& status) {
  MutexLock lock(mutex_);
  end_ = client::ToStatus(status, "the server");
  changed_.NotifyAll();
}

}  // namespace gem::load
