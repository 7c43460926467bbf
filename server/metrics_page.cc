#include "server/metrics_page.h"

#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <exception>
#include <thread>
#include <utility>

namespace gem {
namespace {

constexpr int kThreads = 1;
constexpr std::chrono::milliseconds kKnockPeriod(5);

std::string HostOf(const std::string& address) {
  std::string host = address.substr(0, address.rfind(':'));
  if (host.size() > 2 && host.front() == '[') host = host.substr(1, host.size() - 2);
  return host;
}

int PortOf(const prometheus::Exposer& exposer) {
  const std::vector<int> ports = exposer.GetListeningPorts();
  return ports.empty() ? 0 : ports.front();
}

}  // namespace

absl::StatusOr<std::unique_ptr<MetricsPage>> MetricsPage::Start(const std::string& address) {
  try {
    auto exposer = std::make_unique<prometheus::Exposer>(address, kThreads);
    return std::unique_ptr<MetricsPage>(new MetricsPage(HostOf(address), std::move(exposer)));
  } catch (const std::exception& error) {
    return absl::UnavailableError(error.what());
  }
}

MetricsPage::MetricsPage(std::string host, std::unique_ptr<prometheus::Exposer> exposer)
    : host_(std::move(host)), exposer_(std::move(exposer)), port_(PortOf(*exposer_)) {}

MetricsPage::~MetricsPage() {
  // The web server looks whether it shall stop only when somebody connects, or every two seconds:
  // longer than the whole shutdown may take.
  std::atomic<bool> gone{false};
  std::thread closer([&] {
    exposer_.reset();
    gone = true;
  });
  while (!gone) {
    Knock();
    std::this_thread::sleep_for(kKnockPeriod);
  }
  closer.join();
}

void MetricsPage::Knock() const {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_NUMERICHOST | AI_NUMERICSERV;
  addrinfo* found = nullptr;
  if (getaddrinfo(host_.c_str(), std::to_string(port_).c_str(), &hints, &found) != 0) return;
  const int socket = ::socket(found->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (socket >= 0) {
    // Whether it succeeds does not matter: without it the page is gone two seconds later.
    (void)::connect(socket, found->ai_addr, found->ai_addrlen);
    ::close(socket);
  }
  freeaddrinfo(found);
}

}  // namespace gem
