// libFuzzer's entry; GEM_FUZZ_TARGET names the target.
#include "tests/fuzz/targets.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const gem::fuzz::Target& target = gem::fuzz::TargetOf(GEM_FUZZ_TARGET);
  target.run(data, size);
  return 0;
}
