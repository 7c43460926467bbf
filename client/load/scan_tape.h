// Scans as messages that are ready to be sent, again and again: whoever loads a server with them
// spends no time on making them. Forwards, backwards, forwards: the robot never jumps.
#pragma once

#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/slice.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/ingest_client.h"
#include "client/scan_source.h"
#include "gem/v1/types.pb.h"

namespace gem::load {

/// Between two scans of a tape, whatever they were recorded with.
inline constexpr std::int64_t kScanPeriod_ns = 100'000'000;

/// Constant once it is recorded.
class ScanTape {
 public:
  /// INVALID_ARGUMENT if the source gives no scan.
  static absl::StatusOr<std::unique_ptr<const ScanTape>> Record(
      ScanSource& source, const client::IngestOptions& options, std::size_t num_scans_max);

  /// The same scans without poses: a server that waits for none refuses each once it has decoded
  /// it.
  std::unique_ptr<const ScanTape> WithoutPoses() const;

  const std::string& name() const { return name_; }
  std::size_t num_scans() const { return scans_.size(); }
  const std::vector<client::SensorSetup>& sensors() const { return sensors_; }
  double mean_points() const;
  double mean_payload_bytes() const;

  /// What the credit of the scan costs. seq: from 1, as often round the tape as it takes.
  std::uint64_t PayloadBytes(std::uint64_t seq) const { return At(seq).payload.size(); }
  /// A serialised IngestRequest with the scan. Shares the tape's memory: the tape must outlive it.
  grpc::ByteBuffer Message(std::uint64_t seq) const;

 private:
  struct Recorded {
    v1::Scan head;  ///< without its points
    std::string payload;
  };

  const Recorded& At(std::uint64_t seq) const;

  std::string name_;
  std::vector<client::SensorSetup> sensors_;
  std::vector<Recorded> scans_;
};

}  // namespace gem::load
