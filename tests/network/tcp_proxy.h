// Hands bytes between clients and one server, and does to each connection what radio links do.
// Knows nothing of what the bytes mean.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <string>
#include <thread>
#include <vector>

namespace gem::test {

/// What becomes of one connection once so many bytes have been passed on.
struct Fault {
  enum class Kind {
    kNone,
    kCut,        ///< both ends are closed
    kHalfClose,  ///< the server sees the end of what the client says, the client notices nothing
    kStall,      ///< nothing passes for a while; then it is cut
    /// As kStall for the server. The client is cut off first; what it said meanwhile reaches the
    /// server when the next connection is well under way, or broken: a half-dead stream that speaks
    /// up late.
    kLate,
  };
  Kind kind = Kind::kNone;
  std::size_t after_bytes = 0;
  /// Whose bytes are counted.
  enum class Counts { kClient, kServer };
  Counts counts = Counts::kClient;
};

class TcpProxy {
 public:
  /// `plan` says what becomes of connection 0, 1, 2, ...; it is called on the proxy's thread.
  TcpProxy(const std::string& server, std::function<Fault(int connection)> plan);
  ~TcpProxy();
  TcpProxy(const TcpProxy&) = delete;
  TcpProxy& operator=(const TcpProxy&) = delete;

  const std::string& address() const { return address_; }
  int num_connections() const { return num_connections_; }
  /// Faults that have struck.
  int num_faults() const { return num_faults_; }
  /// From clients to the server.
  std::size_t bytes_passed() const { return bytes_passed_; }

 private:
  struct Link;
  void Run();
  void Accept();
  void PassUp(Link& link);
  void PassDown(Link& link);
  void Strike(Link& link);
  void ServeTimers();
  bool WaitsForTimers() const;
  void SpeakUpLate();

  const std::string server_;
  const std::function<Fault(int)> plan_;
  int listener_ = -1;
  int wake_[2] = {-1, -1};
  std::string address_;
  std::vector<Link> links_;
  int newest_under_way_ = -1;
  std::atomic<int> num_connections_{0};
  std::atomic<int> num_faults_{0};
  std::atomic<std::size_t> bytes_passed_{0};
  std::thread thread_;
};

}  // namespace gem::test
