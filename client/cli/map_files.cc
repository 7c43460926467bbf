#include "client/cli/map_files.h"

#include <cerrno>
#include <cstdio>
#include <fstream>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

absl::Status FileError(const std::string& path, const char* what) {
  return absl::InvalidArgumentError(
      absl::StrCat(path, ": cannot be ", what, ": ", std::generic_category().message(errno)));
}

}  // namespace

absl::StatusOr<std::uint64_t> ExportMapFile(const MapClient& client, const std::string& map,
                                            const std::string& path) {
  const std::string part = path + ".part";
  std::uint64_t size_bytes = 0;
  absl::Status exported;
  {
    std::ofstream file(part, std::ios::binary | std::ios::trunc);
    if (!file) return FileError(part, "written");
    exported = client.ExportMap(map, [&](absl::string_view bytes) {
      size_bytes += bytes.size();
      if (file.write(bytes.data(), static_cast<std::streamsize>(bytes.size())))
        return absl::OkStatus();
      return FileError(part, "written");
    });
    if (exported.ok() && !file.flush()) exported = FileError(part, "written");
  }
  if (exported.ok() && std::rename(part.c_str(), path.c_str()) != 0)
    exported = FileError(path, "written");
  if (exported.ok()) return size_bytes;
  std::remove(part.c_str());
  return exported;
}

absl::StatusOr<MapInfo> ImportMapFile(const MapClient& client, const std::string& map,
                                      const std::string& path, const std::string& request_id) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return FileError(path, "read");
  return client.ImportMap(
      map,
      [&](std::size_t size_max) -> absl::StatusOr<std::string> {
        std::string bytes(size_max, '\0');
        file.read(bytes.data(), static_cast<std::streamsize>(size_max));
        if (file.bad()) return FileError(path, "read");
        bytes.resize(static_cast<std::size_t>(file.gcount()));
        return bytes;
      },
      request_id);
}

}  // namespace gem::client
