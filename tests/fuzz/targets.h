// All fuzzers by name. Each is a binary, a folder of seeds, and a case of the test that runs the
// seeds everywhere.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace gem::fuzz {

struct Target {
  std::string name;
  /// Ends the process only if something of ours is wrong.
  void (*run)(const std::uint8_t* data, std::size_t size) = nullptr;
  /// Small good inputs to start from.
  std::vector<std::string> (*seeds)() = nullptr;
  /// Damages of each seed that the test tries: as many as are done in about a second.
  int damages_each = 0;
};

const std::vector<Target>& Targets();

/// A programming error if there is none of the name.
const Target& TargetOf(const std::string& name);

}  // namespace gem::fuzz
