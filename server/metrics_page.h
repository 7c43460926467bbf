// Serves http://ADDR:PORT/metrics and goes away quickly.
#pragma once

#include <prometheus/exposer.h>

#include <memory>
#include <string>

#include "absl/status/statusor.h"

namespace gem {

class MetricsPage {
 public:
  /// Port 0 takes a free one. UNAVAILABLE says why the address cannot be had.
  static absl::StatusOr<std::unique_ptr<MetricsPage>> Start(const std::string& address);
  ~MetricsPage();
  MetricsPage(const MetricsPage&) = delete;
  MetricsPage& operator=(const MetricsPage&) = delete;

  int port() const { return port_; }
  /// Shows what `source` collects, as long as it lives.
  void Show(const std::shared_ptr<prometheus::Collectable>& source) {
    exposer_->RegisterCollectable(source);
  }

 private:
  MetricsPage(std::string host, std::unique_ptr<prometheus::Exposer> exposer);
  /// Connects to the page and hangs up at once.
  void Knock() const;

  const std::string host_;
  std::unique_ptr<prometheus::Exposer> exposer_;
  const int port_;
};

}  // namespace gem
