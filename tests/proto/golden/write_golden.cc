// Writes the golden vectors: write_golden DIR. Only after ENCODINGS.md has changed: they are what
// decoders that were written from it are held against.
#include <cstdio>
#include <fstream>
#include <string>

#include "tests/proto/golden/golden_cases.h"
#include "tests/proto/golden/golden_file.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: write_golden DIR\n");
    return 2;
  }
  const auto write = [&](const char* name, const google::protobuf::Message& message,
                         bool with_zeros = false) {
    std::ofstream file(std::string(argv[1]) + "/" + name + ".json");
    file << gem::golden::ToText(message, with_zeros);
    return file.flush().good();
  };
  const bool ok = write("grids", gem::golden::MakeGrids()) &&
                  write("scans", gem::golden::MakeScans()) &&
                  write("refusals", gem::golden::MakeRefusals()) &&
                  write("places", gem::golden::MakePlaces(), /*with_zeros=*/true);
  if (!ok) std::fprintf(stderr, "write_golden: cannot write to %s\n", argv[1]);
  return ok ? 0 : 1;
}
