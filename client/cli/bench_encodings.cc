#include "client/cli/bench_encodings.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>

#include "client/datasets/kitti_source.h"
#include "client/evaluation/encodings_bench.h"
#include "core/base/status_macros.h"

namespace gem::client {
namespace {

struct BenchEncodingsFlags {
  KittiOptions kitti;
  evaluation::EncodingsBenchOptions bench;
  bool json = false;
};

absl::Status RunBenchEncodings(const BenchEncodingsFlags& flags) {
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<KittiSource> source, KittiSource::Open(flags.kitti));
  GEM_ASSIGN_OR_RETURN(const evaluation::EncodingsBench bench,
                       evaluation::BenchEncodings(*source, flags.bench));
  std::fputs((flags.json ? EncodingsBenchJson(bench) : EncodingsBenchTable(bench)).c_str(), stdout);
  return absl::OkStatus();
}

}  // namespace

void AddBenchEncodingsCommand(CLI::App& bench, std::function<absl::Status()>& run) {
  CLI::App* encodings = bench.add_subcommand(
      "encodings",
      "Bytes a cell and a point on a KITTI directory: velodyne/*.bin, times.txt, poses");
  const auto flags = std::make_shared<BenchEncodingsFlags>();
  encodings->add_option("DIR", flags->kitti.dir, "Directory of the recording")->required();
  encodings->add_option("--poses", flags->kitti.poses,
                        "Poses, relative to DIR (default: poses.txt, or the only poses*.txt)");
  encodings->add_option("--color_images", flags->kitti.color_images,
                        "Colours the points: a directory with images, image_0 to image_3");
  encodings->add_option("--cell_size_m", flags->bench.map.cell_size_m, "Edge of a cell")
      ->capture_default_str();
  encodings->add_option("--local_size_m", flags->bench.map.side_m, "Edge of the window")
      ->capture_default_str();
  encodings->add_option("--int16_step_m", flags->bench.int16_step_m, "Of points in INT16")
      ->capture_default_str();
  encodings->add_option("--scans", flags->bench.num_scans_max, "At most so many scans")
      ->capture_default_str();
  encodings->add_flag("--json", flags->json, "For programs");
  encodings->callback([flags, &run] { run = [flags] { return RunBenchEncodings(*flags); }; });
}

}  // namespace gem::client
