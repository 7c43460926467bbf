// Writes the seeds as files for libFuzzer: write_seeds DIR makes DIR/NAME for every target.
#include <cstdio>
#include <filesystem>
#include <fstream>

#include "tests/fuzz/targets.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: write_seeds DIR\n");
    return 2;
  }
  for (const gem::fuzz::Target& target : gem::fuzz::Targets()) {
    const std::filesystem::path folder = std::filesystem::path(argv[1]) / target.name;
    std::filesystem::create_directories(folder);
    const std::vector<std::string> seeds = target.seeds();
    for (std::size_t i = 0; i < seeds.size(); ++i)
      std::ofstream(folder / std::to_string(i), std::ios::binary) << seeds[i];
  }
  return 0;
}
