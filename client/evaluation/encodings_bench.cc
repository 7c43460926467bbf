#include "client/evaluation/encodings_bench.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <utility>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "client/evaluation/bench_range.h"
#include "client/evaluation/mapping_robot.h"
#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/stopwatch.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/grid.h"
#include "proto/wire/map.h"
#include "proto/wire/scan.h"
#include "proto/wire/zstd_frame.h"

namespace gem::evaluation {
namespace {

constexpr int kZstdLevel = 1;  ///< the codecs'

using Histogram = std::map<std::uint32_t, std::size_t>;

/// Bytes a symbol of a coder that knows how often each comes.
double EntropyBytes(const Histogram& histogram) {
  double total = 0;
  for (const auto& [symbol, count] : histogram) total += static_cast<double>(count);
  double bits = 0;
  for (const auto& [symbol, count] : histogram)
    bits -= static_cast<double>(count) * std::log2(static_cast<double>(count) / total);
  return total == 0 ? 0 : bits / total / 8;
}

/// Counts the residuals of an encoded layer. A colour's channels are symbols of their own.
void CountResiduals(const v1::GridLayer& layer, std::size_t num_cells, Histogram& histogram) {
  const bool is_color = layer.type() == v1::PointField::TYPE_UINT32;
  const std::size_t width = is_color ? 4 : 2;
  const auto data = wire::Inflated(layer.data(), width * num_cells, wire::FieldPath("data"));
  GEM_CHECK(data.ok());
  const auto plane = [&](std::size_t which, std::size_t cell) {
    return static_cast<std::uint32_t>(static_cast<std::uint8_t>((*data)[which * num_cells + cell]));
  };
  for (std::size_t i = 0; i < num_cells; ++i) {
    std::uint32_t symbol = 0;
    for (std::size_t which = 0; which < width; ++which) symbol |= plane(which, i) << (8 * which);
    ++histogram[symbol];
  }
}

/// One layer of every tile, encoded and decoded.
LayerCost CostOf(Layer layer, const MapSnapshot& map) {
  LayerCost cost;
  cost.layer = layer;
  std::size_t raw = 0, raw_zstd = 0, compact = 0, bitmap = 0;
  Histogram residuals;
  std::vector<double> encode_ms, decode_ms;
  const std::array layers = {layer};
  for (const auto& [index, tile] : map.tiles) {
    const LayeredGrid grid = wire::GridOf(*tile, map.options.cell_size_m, layers);
    const auto& valid = grid.layers[0].valid;
    const auto num_cells = static_cast<std::size_t>(std::count(valid.begin(), valid.end(), 1));
    if (num_cells == 0) continue;
    ++cost.num_tiles;
    cost.num_cells += num_cells;
    v1::Grid plain, encoded;
    wire::ToProto(grid, wire::CellEncoding::kRaw, &plain);
    Stopwatch stopwatch;
    wire::ToProto(grid, wire::CellEncoding::kCompact, &encoded);
    encode_ms.push_back(1e3 * stopwatch.Lap());
    const auto decoded = wire::FromProto(encoded, kTileCells, wire::FieldPath("grid"));
    decode_ms.push_back(1e3 * stopwatch.Lap());
    GEM_CHECK(decoded.ok() && decoded->layers[0].valid == valid);
    const v1::GridLayer& plain_layer = plain.layers(0);
    const v1::GridLayer& layer_proto = encoded.layers(0);
    raw += plain_layer.data().size() + plain_layer.valid_bitmap().size();
    for (const std::string* bytes : {&plain_layer.data(), &plain_layer.valid_bitmap()})
      raw_zstd += wire::Compressed(*bytes, kZstdLevel).size();
    compact += layer_proto.data().size() + layer_proto.valid_bitmap().size();
    bitmap += layer_proto.valid_bitmap().size();
    CountResiduals(layer_proto, num_cells, residuals);
  }
  const auto of_cell = [&](std::size_t bytes) {
    return static_cast<double>(bytes) /
           static_cast<double>(std::max<std::size_t>(cost.num_cells, 1));
  };
  cost.raw_bytes = of_cell(raw);
  cost.raw_zstd_bytes = of_cell(raw_zstd);
  cost.compact_bytes = of_cell(compact);
  cost.bitmap_bytes = of_cell(bitmap);
  cost.entropy_bytes = EntropyBytes(residuals);
  cost.encode = DistributionOf(std::move(encode_ms));
  cost.decode = DistributionOf(std::move(decode_ms));
  return cost;
}

/// Tries one encoding on scan after scan.
class ScanTrial {
 public:
  ScanTrial(std::string encoding, double step_m, wire::ScanCompression compression)
      : encoding_(std::move(encoding)), step_m_(step_m), compression_(compression) {}

  absl::Status Try(std::span<const ScanPoint> points) {
    v1::Scan proto;
    proto.set_seq(1);
    proto.set_stamp_ns(1);
    proto.set_sensor("lidar");
    Stopwatch stopwatch;
    if (step_m_ > 0) {
      GEM_RETURN_IF_ERROR(wire::PointsToProtoInt16(points, step_m_, &proto));
    } else {
      wire::PointsToProto(points, &proto);
    }
    if (compression_ != wire::ScanCompression::kNone) wire::Compress(compression_, &proto);
    encode_ms_.push_back(1e3 * stopwatch.Lap());
    GEM_RETURN_IF_ERROR(wire::FromProto(proto, {}, wire::FieldPath("scan"), decoded_));
    decode_ms_.push_back(1e3 * stopwatch.Lap());
    num_bytes_ += wire::PayloadBytes(proto);
    num_points_ += points.size();
    return absl::OkStatus();
  }

  ScanCost Cost() && {
    return {encoding_,
            static_cast<double>(num_bytes_) /
                static_cast<double>(std::max<std::uint64_t>(num_points_, 1)),
            DistributionOf(std::move(encode_ms_)), DistributionOf(std::move(decode_ms_))};
  }

 private:
  const std::string encoding_;
  const double step_m_;  ///< 0: FLOAT32
  const wire::ScanCompression compression_;
  std::uint64_t num_bytes_ = 0;
  std::uint64_t num_points_ = 0;
  std::vector<double> encode_ms_, decode_ms_;
  wire::DecodedScan decoded_;
};

std::vector<ScanTrial> Trials(double step_m) {
  using wire::ScanCompression;
  std::vector<ScanTrial> trials;
  for (const auto& [type, step] : {std::pair("float32", 0.0), std::pair("int16", step_m)})
    for (const auto& [suffix, compression] :
         {std::pair("", ScanCompression::kNone), std::pair(" + zstd", ScanCompression::kZstd),
          std::pair(" + delta + zstd", ScanCompression::kDeltaZstd)})
      trials.emplace_back(absl::StrFormat("%s%s", type, suffix), step, compression);
  return trials;
}

std::string Json(const Distribution_ms& ms) {
  return absl::StrFormat("{\"median\":%.4f,\"p95\":%.4f}", ms.median, ms.p95);
}

}  // namespace

absl::StatusOr<EncodingsBench> BenchEncodings(ScanSource& source,
                                              const EncodingsBenchOptions& options) {
  GEM_RETURN_IF_ERROR(CheckRange("int16_step_m", options.int16_step_m, 1e-4, 1));
  RobotSetup setup;
  setup.local = options.map;
  setup.map.submap_length_m = options.submap_length_m;
  setup.T_B_S = source.T_B_S();
  setup.noise = source.noise();
  GEM_ASSIGN_OR_RETURN(const std::unique_ptr<MappingRobot> robot, MappingRobot::Make(setup));
  std::vector<ScanTrial> trials = Trials(options.int16_step_m);
  EncodingsBench bench;
  std::vector<std::size_t> points;
  SourceScan scan;
  while (bench.num_scans < options.num_scans_max) {
    GEM_ASSIGN_OR_RETURN(const bool there, source.Next(scan));
    if (!there) break;
    ++bench.num_scans;
    points.push_back(scan.points.size());
    for (ScanTrial& trial : trials) GEM_RETURN_IF_ERROR(trial.Try(scan.points));
    robot->Fuse(scan);
  }
  if (points.empty()) return absl::NotFoundError("the recording has no scans");
  robot->End();
  std::nth_element(points.begin(), points.begin() + points.size() / 2, points.end());
  bench.points = points[points.size() / 2];
  for (const Layer layer : wire::TileLayers())
    if (LayerCost cost = CostOf(layer, *robot->snapshot()); cost.num_cells > 0)
      bench.layers.push_back(std::move(cost));
  for (ScanTrial& trial : trials) bench.scans.push_back(std::move(trial).Cost());
  return bench;
}

std::string EncodingsBenchJson(const EncodingsBench& bench) {
  const auto layer = [](std::string* out, const LayerCost& cost) {
    absl::StrAppendFormat(
        out,
        "{\"layer\":\"%s\",\"tiles\":%d,\"cells\":%d,\"bytes_a_cell\":{\"raw\":%.4f,"
        "\"raw_zstd\":%.4f,\"compact\":%.4f,\"bitmap\":%.4f,\"entropy\":%.4f},"
        "\"encode_ms\":%s,\"decode_ms\":%s}",
        NameOf(cost.layer), cost.num_tiles, cost.num_cells, cost.raw_bytes, cost.raw_zstd_bytes,
        cost.compact_bytes, cost.bitmap_bytes, cost.entropy_bytes, Json(cost.encode),
        Json(cost.decode));
  };
  const auto scan = [](std::string* out, const ScanCost& cost) {
    absl::StrAppendFormat(
        out, "{\"encoding\":\"%s\",\"bytes_a_point\":%.4f,\"encode_ms\":%s,\"decode_ms\":%s}",
        cost.encoding, cost.bytes, Json(cost.encode), Json(cost.decode));
  };
  return absl::StrFormat("{\"scans\":%d,\"points\":%d,\"layers\":[%s],\"encodings\":[%s]}\n",
                         bench.num_scans, bench.points, absl::StrJoin(bench.layers, ",", layer),
                         absl::StrJoin(bench.scans, ",", scan));
}

std::string EncodingsBenchTable(const EncodingsBench& bench) {
  std::string table =
      absl::StrFormat("%d scans, %d points a scan\n\n%-15s %6s %9s %7s %7s %8s %7s %8s %9s %9s\n",
                      bench.num_scans, bench.points, "bytes a cell", "tiles", "cells", "raw",
                      "+ zstd", "compact", "bitmap", "entropy", "encode ms", "decode ms");
  for (const LayerCost& cost : bench.layers)
    absl::StrAppendFormat(&table, "%-15s %6d %9d %7.2f %7.2f %8.3f %7.3f %8.3f %9.3f %9.3f\n",
                          NameOf(cost.layer), cost.num_tiles, cost.num_cells, cost.raw_bytes,
                          cost.raw_zstd_bytes, cost.compact_bytes, cost.bitmap_bytes,
                          cost.entropy_bytes, cost.encode.median, cost.decode.median);
  absl::StrAppendFormat(&table, "\n%-24s %7s %10s %10s\n", "bytes a point", "", "encode ms",
                        "decode ms");
  for (const ScanCost& cost : bench.scans)
    absl::StrAppendFormat(&table, "%-24s %7.2f %10.2f %10.2f\n", cost.encoding, cost.bytes,
                          cost.encode.median, cost.decode.median);
  return table;
}

}  // namespace gem::evaluation
