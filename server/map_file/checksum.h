// The checksum of a section: CRC-32 as in zip and PNG, over what is before it and what it is for.
#pragma once

#include <zlib.h>

#include <cstdint>

#include "absl/strings/string_view.h"

namespace gem::map_file {

inline std::uint32_t Checksum(absl::string_view header, absl::string_view stored) {
  const auto add = [](uLong crc, absl::string_view bytes) {
    return crc32(crc, reinterpret_cast<const Bytef*>(bytes.data()),
                 static_cast<uInt>(bytes.size()));
  };
  return static_cast<std::uint32_t>(add(add(0, header), stored));
}

}  // namespace gem::map_file
