// Follows a map until the ground at a place is known: wait_for_ground SERVER MAP X Y
#include <cstdio>
#include <cstdlib>

#include "client/map_mirror.h"

int main(int argc, char** argv) {
  if (argc != 5) return 2;
  const gem::Place place{std::atof(argv[3]), std::atof(argv[4])};
  gem::client::MirrorOptions options;
  options.map = argv[2];
  options.region = {place.x_m - 10, place.y_m - 10, place.x_m + 10, place.y_m + 10};
  const gem::client::MapMirror mirror(
      std::make_shared<const gem::client::Connection>(gem::client::ConnectionOptions{argv[1]}),
      options);
  std::optional<gem::MapVersion> seen;
  while (true) {
    const auto map = mirror.WaitForOther(seen, /*timeout_s=*/30);
    if (!map.ok()) return std::fprintf(stderr, "%s\n", map.status().ToString().c_str()), 1;
    seen = (*map)->version;  // this snapshot never changes, whatever becomes of the map
    const auto height_m = (*map)->ValueAt(gem::Layer::kElevation, place);
    if (!height_m) continue;
    std::printf("%.2f m, %s\n", *height_m, (*map)->IsFree(place) ? "free" : "not free");
    return 0;
  }
}
