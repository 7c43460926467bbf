// A channel to a server, shared by the clients of its services. Not a session: it reconnects by
// itself and holds no state of the mapping.
#pragma once

#include <memory>
#include <string>

namespace grpc {
class Channel;
}

namespace gem::client {

struct ConnectionOptions {
  /// "host:port" or any other name that gRPC resolves.
  std::string address = "127.0.0.1:50051";
  /// A silent peer is asked this often whether it lives, seconds. Servers answer pings that come
  /// more often than every 10 s with GOAWAY. Range [10, 3600].
  double keepalive_s = 30;
  /// Largest message in either direction; gRPC's own default of 4 MiB is smaller than a batch of
  /// tiles.
  int message_bytes_max = 256 << 20;
  /// True: a TCP connection of its own, also where another Connection to the same address is open.
  bool exclusive = false;
};

/// Thread-safe. Connects when it is first used.
class Connection {
 public:
  explicit Connection(const ConnectionOptions& options);

  const std::string& address() const { return address_; }
  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }

 private:
  const std::string address_;
  const std::shared_ptr<grpc::Channel> channel_;
};

}  // namespace gem::client
