#include "client/simulation/scenes.h"

#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/simulation/scene_builders.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

struct Scene {
  SceneInfo info;
  absl::StatusOr<Simulation> (*build)(const SceneOptions&);
  bool wants_terrain_file = false;
};

template <Simulation (*kBuild)(const SceneOptions&)>
absl::StatusOr<Simulation> Built(const SceneOptions& options) {
  return kBuild(options);
}

const std::vector<Scene>& Scenes() {
  static const std::vector<Scene> scenes = {
      {{"block", "round a city block and 25 m on: hills, cubes, walls, a pedestrian; drift"},
       &Built<BuildBlock>},
      {{"flat", "50 m straight over flat ground; drift"}, &Built<BuildFlat>},
      {{"cubes", "six 0.5 m cubes on flat ground, slowly passing sensor; no drift"},
       &Built<BuildCubes>},
      {{"crowd", "20 m through 30 walkers on flat ground; no drift"}, &Built<BuildCrowd>},
      {{"segments", "110 m straight; odometry jumps by 1.2 m every 20.5 m and is exact between"},
       &Built<BuildSegments>},
      {{"terrain", "a round over an ESRI ASCII grid of heights; drift"}, &BuildTerrain, true},
  };
  return scenes;
}

template <typename T>
absl::Status CheckRange(const char* field, T value, T low, T high) {
  if (value >= low && value <= high) return absl::OkStatus();  // NaN fails both
  return absl::InvalidArgumentError(
      absl::StrCat("scene.", field, " is ", value, ", want [", low, ", ", high, "]"));
}

absl::Status Validate(const SceneOptions& options, const Scene& scene) {
  GEM_RETURN_IF_ERROR(CheckRange("rings", options.rings, 1, 256));
  GEM_RETURN_IF_ERROR(CheckRange("azimuths", options.azimuths, 8, 8192));
  GEM_RETURN_IF_ERROR(CheckRange("scans_max", options.scans_max, 0, 1'000'000));
  if (options.scan_spacing_m)
    GEM_RETURN_IF_ERROR(CheckRange("scan_spacing_m", *options.scan_spacing_m, 0.0, 10.0));
  GEM_RETURN_IF_ERROR(CheckRange("drift_scale", options.drift_scale, 0.0, 100.0));
  GEM_RETURN_IF_ERROR(CheckRange("noise_scale", options.noise_scale, 0.0, 20.0));
  if (scene.wants_terrain_file && options.terrain_file.empty()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "scene.terrain_file is empty, want an ESRI ASCII grid for scene %s", options.name));
  }
  if (!scene.wants_terrain_file && !options.terrain_file.empty()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "scene.terrain_file is %s, want none for scene %s", options.terrain_file, options.name));
  }
  return absl::OkStatus();
}

}  // namespace

const std::vector<SceneInfo>& SceneList() {
  static const std::vector<SceneInfo> list = [] {
    std::vector<SceneInfo> infos;
    for (const Scene& scene : Scenes()) infos.push_back(scene.info);
    return infos;
  }();
  return list;
}

absl::StatusOr<std::unique_ptr<SimulatedSource>> MakeScene(const SceneOptions& options) {
  for (const Scene& scene : Scenes()) {
    if (scene.info.name != options.name) continue;
    GEM_RETURN_IF_ERROR(Validate(options, scene));
    GEM_ASSIGN_OR_RETURN(Simulation simulation, scene.build(options));
    return SimulatedSource::Make(std::move(simulation));
  }
  const auto name = [](std::string* out, const SceneInfo& info) { out->append(info.name); };
  return absl::InvalidArgumentError(absl::StrFormat("scene.name is \"%s\", want one of %s",
                                                    options.name,
                                                    absl::StrJoin(SceneList(), ", ", name)));
}

}  // namespace gem
