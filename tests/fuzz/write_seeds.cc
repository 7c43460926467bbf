// Writes the seeds as files for libFuzzer: write_seeds DIR makes DIR/ingest_request and DIR/tile.
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "tests/fuzz/fuzz_targets.h"

namespace {

void Write(const std::filesystem::path& folder, const std::vector<std::string>& seeds) {
  std::filesystem::create_directories(folder);
  for (std::size_t i = 0; i < seeds.size(); ++i)
    std::ofstream(folder / std::to_string(i), std::ios::binary) << seeds[i];
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: write_seeds DIR\n");
    return 2;
  }
  const std::filesystem::path folder = argv[1];
  Write(folder / "ingest_request", gem::fuzz::IngestRequestSeeds());
  Write(folder / "tile", gem::fuzz::TileSeeds());
  return 0;
}
