// Streams a source of scans to a server, corrects the trajectory when the plan says so, and ends
// the session: what `gem replay` and `gem simulate` do.
#pragma once

#include "absl/status/status.h"
#include "client/cli/stream_flags.h"
#include "client/scan_source.h"

namespace gem::client {

/// Returns when everything that was sent is in the published map. Shows progress on stderr and a
/// summary on stdout. An error if the server refused a scan.
absl::Status StreamToServer(ScanSource& source, const StreamFlags& flags);

}  // namespace gem::client
