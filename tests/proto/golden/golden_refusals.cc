#include <cmath>
#include <functional>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "core/base/check.h"
#include "gem/v1/types.pb.h"
#include "proto/wire/depth_image.h"
#include "proto/wire/grid.h"
#include "proto/wire/refusal.h"
#include "proto/wire/scan.h"
#include "proto/wire/zstd_frame.h"
#include "tests/proto/golden/golden_cases.h"

namespace gem::golden {
namespace {

v1::Grid GoodGrid(wire::CellEncoding encoding) {
  const GridLayer heights{Layer::kElevation, {1, 0, 1, 1, 1, 1}, {1, 0, 2, 3, 4, 5}, {}};
  v1::Grid proto;
  wire::ToProto(LayeredGrid{3, 2, 0.2, {heights}, 0}, encoding, &proto);
  return proto;
}

v1::Scan GoodScan(wire::ScanCompression compression) {
  const std::vector<ScanPoint> points = {{1, 2, 3, 0}, {4, 5, 6, 0}};
  v1::Scan scan;
  scan.set_seq(1);
  scan.set_stamp_ns(1);
  scan.set_sensor("top");
  wire::PointsToProto(points, &scan);
  wire::Compress(compression, &scan);
  return scan;
}

void SetFloat(std::size_t index, float value, std::string* bytes) {
  bytes->replace(4 * index, 4, reinterpret_cast<const char*>(&value), 4);
}

/// Of what a decoder of ours says.
void Finish(const std::string& name, const absl::Status& status, RefusalCase* refusal) {
  GEM_CHECK(!status.ok());
  refusal->set_name(name);
  refusal->set_field(wire::FieldOf(status));
  refusal->set_text(std::string(status.message()));
}

class Collector {
 public:
  void Grid(const std::string& name, wire::CellEncoding encoding,
            const std::function<void(v1::Grid&, v1::GridLayer&)>& damage) {
    RefusalCase& refusal = *refusals_.add_cases();
    *refusal.mutable_grid() = GoodGrid(encoding);
    damage(*refusal.mutable_grid(), *refusal.mutable_grid()->mutable_layers(0));
    Finish(name,
           wire::FromProto(refusal.grid(), wire::kGridCells_max, wire::FieldPath("grid")).status(),
           &refusal);
  }
  void Scan(const std::string& name, wire::ScanCompression compression,
            const std::function<void(v1::Scan&)>& damage) {
    RefusalCase& refusal = *refusals_.add_cases();
    *refusal.mutable_scan() = GoodScan(compression);
    damage(*refusal.mutable_scan());
    wire::DecodedScan decoded;
    Finish(name, wire::FromProto(refusal.scan(), {}, wire::FieldPath("scan"), decoded), &refusal);
  }
  Refusals Take() && { return std::move(refusals_); }

 private:
  Refusals refusals_;
};

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

void AddGrids(Collector& collector) {
  using Grid = v1::Grid;
  using Layer = v1::GridLayer;
  const auto raw = wire::CellEncoding::kRaw;
  const auto compact = wire::CellEncoding::kCompact;
  collector.Grid("nan", raw, [](Grid&, Layer& l) { SetFloat(2, kNan, l.mutable_data()); });
  collector.Grid("infinite", raw,
                 [](Grid&, Layer& l) { SetFloat(0, -kInfinity, l.mutable_data()); });
  collector.Grid("scale_that_overflows", compact, [](Grid&, Layer& l) { l.set_scale(1e300); });
  collector.Grid("scale_zero", compact, [](Grid&, Layer& l) { l.set_scale(0); });
  collector.Grid("data_too_short", raw, [](Grid&, Layer& l) { l.mutable_data()->pop_back(); });
  collector.Grid("bitmap_too_long", raw,
                 [](Grid&, Layer& l) { l.mutable_valid_bitmap()->push_back('\1'); });
  collector.Grid("frame_of_another_size", compact, [](Grid&, Layer& l) {
    l.set_data(wire::Compressed(std::string(1'000'000, '\0'), 1));
  });
  collector.Grid("frame_of_all_cells_with_predictor", compact,
                 [](Grid&, Layer& l) { l.set_data(wire::Compressed(std::string(12, '\0'), 1)); });
  collector.Grid("no_frame", compact, [](Grid&, Layer& l) { l.set_data("no frame"); });
  collector.Grid("frame_cut_short", compact, [](Grid&, Layer& l) { l.mutable_data()->pop_back(); });
  collector.Grid("bytes_behind_the_frame", compact,
                 [](Grid&, Layer& l) { l.mutable_data()->push_back('\0'); });
  collector.Grid("type_unknown", raw, [](Grid&, Layer& l) { l.clear_type(); });
  collector.Grid("predictor_unknown", compact, [](Grid&, Layer& l) {
    l.set_predictor(static_cast<v1::GridLayer::Predictor>(2));
  });
  collector.Grid("predictor_of_float32", raw,
                 [](Grid&, Layer& l) { l.set_predictor(v1::GridLayer::PREDICTOR_MEDIAN); });
  collector.Grid("layer_twice", raw, [](Grid& g, Layer& l) { *g.add_layers() = Layer(l); });
  collector.Grid("no_columns", raw, [](Grid& g, Layer&) { g.set_columns(0); });
  collector.Grid("too_many_rows", compact, [](Grid& g, Layer&) { g.set_rows(1025); });
}

void AddScans(Collector& collector) {
  using wire::ScanCompression;
  const auto none = ScanCompression::kNone;
  const auto delta = ScanCompression::kDeltaZstd;
  collector.Scan("point_that_is_nan", none,
                 [](v1::Scan& s) { SetFloat(4, kNan, s.mutable_points()); });
  collector.Scan("points_too_short", none, [](v1::Scan& s) { s.mutable_points()->pop_back(); });
  collector.Scan("points_frame_of_another_size", delta, [](v1::Scan& s) {
    s.set_points(wire::Compressed(std::string(1'000'000, '\0'), 1));
  });
  collector.Scan("points_without_frame", delta, [](v1::Scan& s) { s.set_points("no frame"); });
  collector.Scan("field_beyond_the_stride", none,
                 [](v1::Scan& s) { s.mutable_fields(2)->set_offset(9); });
  collector.Scan("field_missing", none, [](v1::Scan& s) { s.mutable_fields(2)->set_name("up"); });
  collector.Scan("compression_unknown", none,
                 [](v1::Scan& s) { s.set_compression(static_cast<v1::ScanCompression>(4)); });
  collector.Scan("delta_of_a_depth_image", none, [](v1::Scan& s) {
    s.Clear();
    s.set_seq(1);
    s.set_stamp_ns(1);
    s.set_sensor("top");
    s.mutable_depth_image()->set_width(1);
    s.set_compression(v1::SCAN_COMPRESSION_DELTA_ZSTD);
  });
}

}  // namespace

Refusals MakeRefusals() {
  Collector collector;
  AddGrids(collector);
  AddScans(collector);
  return std::move(collector).Take();
}

}  // namespace gem::golden
