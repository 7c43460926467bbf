// The options that `gem replay` and `gem simulate` share: where to, as what, how fast, and when to
// correct.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/ingest_client.h"

namespace CLI {
class App;
}

namespace gem::client {

/// As typed; unset takes the server's default.
struct StreamFlags {
  std::string server = "127.0.0.1:50051";
  std::string map = "default";
  std::string robot = "robot";
  std::string session;  // empty: a new one
  std::string rate = "max";
  std::string correct_at;
  std::string encoding = "float32";
  std::string overload = "block";
  std::optional<std::size_t> scans;
  std::optional<float> cell_size_m;
  std::optional<float> submap_length_m;
  std::optional<float> local_size_m;
  std::optional<float> range_m_min, range_m_max;
  std::optional<float> height_m_min, height_m_max;
  std::vector<float> body;  // empty or six
  bool traversable_only = false;
  bool json = false;  // the summary
};

void AddStreamFlags(CLI::App& command, StreamFlags& flags);

/// When the corrected poses of all scans so far are sent.
struct CorrectionPlan {
  bool after_every_scan = false;
  bool at_end = false;                     ///< after the last scan, before the session is closed
  std::vector<std::uint64_t> after_scans;  ///< increasing, from 1

  bool any() const { return after_every_scan || at_end || !after_scans.empty(); }
  bool IsDueAfter(std::uint64_t num_scans) const;
};

/// "", "end", "every", "100", "100,200,end". A number beyond num_scans is refused.
absl::StatusOr<CorrectionPlan> ParseCorrectAt(const std::string& text, std::size_t num_scans);

/// Scans a second; nothing for "max".
absl::StatusOr<std::optional<double>> ParseRate(const std::string& text);

/// Sets how points travel. "float32"; "int16": in millimetres; "compact": in steps of 4 mm, like
/// the recordings of most LiDARs, and compressed.
absl::Status ParseEncoding(const std::string& text, IngestOptions& options);

absl::StatusOr<OverloadPolicy> ParseOverload(const std::string& text);

/// Everything but the sensors.
SessionSetup SetupOf(const StreamFlags& flags);

}  // namespace gem::client
