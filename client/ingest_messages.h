// Domain types of the ingest client -> gem.v1 messages. Private to the library.
#pragma once

#include "absl/status/status.h"
#include "client/ingest_client.h"

namespace gem::v1 {
class OpenSession;
class Scan;
class ScanProblem;
}  // namespace gem::v1

namespace gem::client {

void ToProto(const SessionSetup& setup, v1::OpenSession* proto);

/// Everything but the sequence number, not compressed. INVALID_ARGUMENT for a point that is not
/// finite, time offsets that do not belong to the points, and a depth image that is none.
absl::Status ToProto(const OutgoingScan& scan, const IngestOptions& options, v1::Scan* proto);
/// What ToProto() wrote.
void Compress(ScanCompression compression, v1::Scan* proto);

IngestProblem FromProto(const v1::ScanProblem& proto);

}  // namespace gem::client
