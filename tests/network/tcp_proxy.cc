#include "tests/network/tcp_proxy.h"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <utility>

#include "core/base/check.h"

namespace gem::test {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kStall(10);
/// The next connection is well under way: its session is open.
constexpr std::size_t kUnderWay_bytes = 3000;
/// More than what a stalled client writes before its credit or its buffers are full.
constexpr std::size_t kHeld_bytes_max = 1 << 20;

sockaddr_in Resolve(const std::string& address) {
  sockaddr_in result{};
  result.sin_family = AF_INET;
  const std::size_t colon = address.rfind(':');
  result.sin_port = htons(static_cast<std::uint16_t>(std::stoi(address.substr(colon + 1))));
  GEM_CHECK(inet_pton(AF_INET, address.substr(0, colon).c_str(), &result.sin_addr) == 1);
  return result;
}

bool SendAll(int to, const char* data, std::size_t size_bytes) {
  while (size_bytes > 0) {
    const ssize_t sent = ::send(to, data, size_bytes, MSG_NOSIGNAL);
    if (sent <= 0) return false;
    data += sent;
    size_bytes -= static_cast<std::size_t>(sent);
  }
  return true;
}

void Close(int& socket) {
  if (socket >= 0) ::close(socket);
  socket = -1;
}

}  // namespace

struct TcpProxy::Link {
  int number = 0;
  int client = -1;
  int server = -1;
  Fault fault;
  std::size_t up_bytes = 0;
  std::size_t down_bytes = 0;
  bool struck = false;
  bool up_ended = false;  ///< nothing more is read from the client
  std::string held;       ///< what the client said, for later
  bool spoke_up = false;  ///< it was passed on
  Clock::time_point stalled_until;

  bool waits_to_strike(Fault::Counts whose) const {
    return !struck && fault.kind != Fault::Kind::kNone && fault.counts == whose;
  }
  bool stalls() const {
    return struck && (fault.kind == Fault::Kind::kStall || fault.kind == Fault::Kind::kLate) &&
           client >= 0;
  }
  bool is_late() const { return struck && fault.kind == Fault::Kind::kLate && client < 0; }
  void CloseBoth() {
    Close(client);
    Close(server);
  }
};

TcpProxy::TcpProxy(const std::string& server, std::function<Fault(int connection)> plan)
    : server_(server), plan_(std::move(plan)) {
  listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in any = Resolve("127.0.0.1:0");
  GEM_CHECK(::bind(listener_, reinterpret_cast<sockaddr*>(&any), sizeof(any)) == 0);
  GEM_CHECK(::listen(listener_, 64) == 0);
  socklen_t size = sizeof(any);
  ::getsockname(listener_, reinterpret_cast<sockaddr*>(&any), &size);
  address_ = "127.0.0.1:" + std::to_string(ntohs(any.sin_port));
  GEM_CHECK(::pipe2(wake_, O_CLOEXEC) == 0);
  thread_ = std::thread([this] { Run(); });
}

TcpProxy::~TcpProxy() {
  Close(wake_[1]);
  thread_.join();
  Close(wake_[0]);
  Close(listener_);
}

void TcpProxy::Run() {
  while (true) {
    std::vector<pollfd> files = {{wake_[0], POLLIN, 0}, {listener_, POLLIN, 0}};
    for (const Link& link : links_) {
      // Who stalls is not heard, except for what is to be late.
      const bool hears_client =
          !link.up_ended && (!link.stalls() || link.fault.kind == Fault::Kind::kLate);
      files.push_back({hears_client ? link.client : -1, POLLIN, 0});
      files.push_back({link.stalls() ? -1 : link.server, POLLIN, 0});
    }
    ::poll(files.data(), files.size(), WaitsForTimers() ? 1 : -1);
    if (files[0].revents != 0) break;
    for (std::size_t i = 0; i < links_.size(); ++i) {
      if (files[2 + 2 * i].revents != 0) PassUp(links_[i]);
      if (files[3 + 2 * i].revents != 0 && links_[i].server >= 0) PassDown(links_[i]);
    }
    ServeTimers();
    SpeakUpLate();
    std::erase_if(links_, [](const Link& link) { return link.server < 0; });
    if (files[1].revents != 0) Accept();
  }
  for (Link& link : links_) link.CloseBoth();
}

void TcpProxy::Accept() {
  Link link;
  link.client = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
  link.server = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_in to = Resolve(server_);
  if (::connect(link.server, reinterpret_cast<const sockaddr*>(&to), sizeof(to)) != 0)
    return link.CloseBoth();
  link.number = num_connections_++;
  link.fault = plan_(link.number);
  links_.push_back(std::move(link));
}

void TcpProxy::PassUp(Link& link) {
  std::array<char, 16 << 10> buffer;
  std::size_t wanted = buffer.size();
  const bool may_strike = link.waits_to_strike(Fault::Counts::kClient);
  if (may_strike) wanted = std::min(wanted, link.fault.after_bytes - link.up_bytes);
  const ssize_t got = wanted == 0 ? 0 : ::recv(link.client, buffer.data(), wanted, 0);
  if (wanted > 0 && got <= 0) {
    // The client has hung up: the server hears it, unless it is to hear it late.
    if (!link.stalls()) return link.CloseBoth();
    link.up_ended = true;
    return;
  }
  const auto size_bytes = static_cast<std::size_t>(got);
  if (link.stalls()) {
    link.held.append(buffer.data(), size_bytes);
    link.up_ended = link.held.size() > kHeld_bytes_max;
    return;
  }
  if (!SendAll(link.server, buffer.data(), size_bytes)) return link.CloseBoth();
  link.up_bytes += size_bytes;
  bytes_passed_ += size_bytes;
  if (may_strike && link.up_bytes >= link.fault.after_bytes) Strike(link);
}

void TcpProxy::PassDown(Link& link) {
  std::array<char, 16 << 10> buffer;
  std::size_t wanted = buffer.size();
  const bool may_strike = link.waits_to_strike(Fault::Counts::kServer);
  if (may_strike) wanted = std::min(wanted, link.fault.after_bytes - link.down_bytes);
  const ssize_t got = wanted == 0 ? 0 : ::recv(link.server, buffer.data(), wanted, 0);
  if (wanted > 0 && got <= 0) return link.CloseBoth();
  // Nobody is there to hear the answers to what comes late.
  if (link.client < 0) return;
  const auto size_bytes = static_cast<std::size_t>(got);
  if (!SendAll(link.client, buffer.data(), size_bytes)) return link.CloseBoth();
  link.down_bytes += size_bytes;
  if (may_strike && link.down_bytes >= link.fault.after_bytes) Strike(link);
}

void TcpProxy::Strike(Link& link) {
  link.struck = true;
  ++num_faults_;
  link.stalled_until = Clock::now() + kStall;
  if (link.fault.kind == Fault::Kind::kCut) link.CloseBoth();
  if (link.fault.kind == Fault::Kind::kHalfClose) {
    ::shutdown(link.server, SHUT_WR);
    link.up_ended = true;
  }
}

bool TcpProxy::WaitsForTimers() const {
  return std::any_of(links_.begin(), links_.end(), [](const Link& link) { return link.stalls(); });
}

void TcpProxy::ServeTimers() {
  for (Link& link : links_) {
    if (!link.stalls() || Clock::now() < link.stalled_until) continue;
    Close(link.client);
    if (link.fault.kind == Fault::Kind::kStall) Close(link.server);
  }
}

void TcpProxy::SpeakUpLate() {
  for (const Link& link : links_)
    if (link.up_bytes >= kUnderWay_bytes || link.server < 0)
      newest_under_way_ = std::max(newest_under_way_, link.number);
  for (Link& link : links_) {
    if (!link.is_late() || link.spoke_up || newest_under_way_ <= link.number) continue;
    link.spoke_up = true;
    if (!SendAll(link.server, link.held.data(), link.held.size())) return link.CloseBoth();
    ::shutdown(link.server, SHUT_WR);
  }
}

}  // namespace gem::test
