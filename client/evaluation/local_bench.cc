#include "client/evaluation/local_bench.h"

#include <algorithm>
#include <memory>
#include <span>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/status_macros.h"
#include "core/base/stopwatch.h"

namespace gem::evaluation {
namespace {

// The yardstick: memory is read, next to nothing is computed. Four sums, so that the pass does not
// wait for the adder.
float SumOf(std::span<const ScanPoint> points) {
  float sums[4] = {};
  for (std::size_t i = 0; i < points.size(); ++i) {
    sums[i & 3] += points[i].x_m + points[i].y_m + points[i].z_m;
  }
  return sums[0] + sums[1] + sums[2] + sums[3];
}

}  // namespace

Distribution_ms DistributionOf(std::vector<double> values_ms) {
  if (values_ms.empty()) return {};
  std::sort(values_ms.begin(), values_ms.end());
  const auto at = [&](double fraction) {
    return values_ms[static_cast<std::size_t>(fraction *
                                              static_cast<double>(values_ms.size() - 1))];
  };
  return {at(0.5), at(0.95), at(0.99)};
}

absl::StatusOr<std::vector<ScanTiming>> TimeScans(ScanSource& source, LocalBackend backend,
                                                  const LocalMapOptions& options,
                                                  std::size_t num_scans_max, int threads) {
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<LocalMapper> mapper,
                       MakeLocalMapper(backend, options, threads));
  SourceScan from;
  Scan scan;
  scan.T_B_S = source.T_B_S();
  scan.noise = source.noise();
  std::vector<EvictedCell> evicted;
  std::vector<ScanTiming> scans;
  volatile float consumed = 0;  // or the compiler would leave the read pass out
  while (scans.size() < num_scans_max) {
    GEM_ASSIGN_OR_RETURN(const bool has_scan, source.Next(from));
    if (!has_scan) break;
    ++scan.seq;
    scan.stamp_ns = from.stamp_ns;
    scan.T_O_B = from.T_O_B;
    scan.points = from.points;
    mapper->Expect();  // as a session does before it decodes
    Stopwatch stopwatch;
    consumed = SumOf(scan.points);
    const double read_pass_s = stopwatch.Lap();
    evicted.clear();
    scans.push_back({read_pass_s, mapper->FuseScan(scan, evicted)});
  }
  static_cast<void>(consumed);
  if (scans.empty()) return absl::NotFoundError(absl::StrCat(source.name(), " has no scans"));
  return scans;
}

LocalBench Summarise(LocalBackend backend, const LocalMapOptions& options,
                     const std::vector<ScanTiming>& scans) {
  const auto side_cells = static_cast<std::size_t>(SideCells(options));
  const auto distribution = [&](auto value_of) {
    std::vector<double> values;
    values.reserve(scans.size());
    for (const ScanTiming& scan : scans) values.push_back(static_cast<double>(value_of(scan)));
    return DistributionOf(std::move(values));
  };
  const auto stage = [&](double LocalStageSeconds::*seconds) {
    return distribution(
        [&](const ScanTiming& scan) { return 1e3 * (scan.report.seconds.*seconds); });
  };
  LocalBench bench;
  bench.backend = std::string(NameOf(backend));
  bench.num_scans = scans.size();
  bench.cells = side_cells * side_cells;
  bench.points = static_cast<std::size_t>(
      distribution([](const ScanTiming& scan) { return scan.report.points; }).median);
  bench.points_in_window =
      static_cast<std::size_t>(distribution([](const ScanTiming& scan) {
                                 return scan.report.points_fused + scan.report.points_gated;
                               }).median);
  bench.read_pass_ms =
      distribution([](const ScanTiming& scan) { return 1e3 * scan.read_pass_s; }).median;
  bench.total =
      distribution([](const ScanTiming& scan) { return 1e3 * scan.report.seconds.total(); });
  bench.move = stage(&LocalStageSeconds::move);
  bench.measure = stage(&LocalStageSeconds::measure);
  bench.fuse = stage(&LocalStageSeconds::fuse);
  bench.annotate = stage(&LocalStageSeconds::annotate);
  bench.clear = stage(&LocalStageSeconds::clear);
  return bench;
}

absl::StatusOr<LocalBench> BenchLocal(ScanSource& source, LocalBackend backend,
                                      const LocalMapOptions& options, std::size_t num_scans_max,
                                      int threads) {
  GEM_ASSIGN_OR_RETURN(const std::vector<ScanTiming> scans,
                       TimeScans(source, backend, options, num_scans_max, threads));
  return Summarise(backend, options, scans);
}

}  // namespace gem::evaluation
