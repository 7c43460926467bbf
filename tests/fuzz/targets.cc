#include "tests/fuzz/targets.h"

#include <algorithm>

#include "core/base/check.h"
#include "tests/fuzz/client_answers.h"
#include "tests/fuzz/decoders.h"
#include "tests/fuzz/map_files.h"
#include "tests/fuzz/reader_messages.h"
#include "tests/fuzz/server_calls.h"

namespace gem::fuzz {

const std::vector<Target>& Targets() {
  static const auto* targets = new std::vector<Target>{
      {"ingest_request", IngestRequest, IngestRequestSeeds, 5000},
      {"tile", Tile, TileSeeds, 2000},
      {"local_map", LocalMap, LocalMapSeeds, 2000},
      {"map_file", MapFile, MapFileSeeds, 2000},
      {"reader_request", ReaderRequest, ReaderRequestSeeds, 5000},
      {"reader_answer", ReaderAnswer, ReaderAnswerSeeds, 5000},
      {"mirror", Mirror, MirrorSeeds, 1000},
      {"client_answer", ClientAnswer, ClientAnswerSeeds, 50},
      {"server_call", ServerCall, ServerCallSeeds, 50},
  };
  return *targets;
}

const Target& TargetOf(const std::string& name) {
  const auto found = std::find_if(Targets().begin(), Targets().end(),
                                  [&](const Target& target) { return target.name == name; });
  GEM_CHECK(found != Targets().end());
  return *found;
}

}  // namespace gem::fuzz
