// Planners that load a server: they ask for the tiles of one map, batch by batch, and note how long
// each answer took. Answers are not decoded: what a client does with them is not the server's time.
#pragma once

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "client/connection.h"
#include "client/map_client.h"

namespace gem::load {

struct ReadPlan {
  std::string map;
  std::vector<TileIndex> tiles;
  int num_readers = 1;
  int tiles_per_call = 1;
  /// Calls a second of all readers together; 0: each asks again as soon as it is answered.
  double calls_hz = 0;
  double seconds = 1;
};

struct ReadReport {
  double seconds = 0;
  std::uint64_t num_tiles = 0;
  std::uint64_t num_bytes = 0;
  /// From when a call was due (or made, without a rate) to its answer, in no order.
  std::vector<double> latencies_s;
};

absl::StatusOr<ReadReport> ReadTiles(const client::ConnectionOptions& server, const ReadPlan& plan);

}  // namespace gem::load
