// The committed vectors still mean what they meant: the only test that notices when encoder and
// decoder change together, and with them what other people's decoders see. Frames are compared by
// what is in them: another release of zstd may compress otherwise.
#include "golden.pb.h"

#include <gtest/gtest.h>

#include <cmath>

#include "absl/strings/escaping.h"
#include "core/grid/cell_index.h"
#include "proto/wire/grid.h"
#include "proto/wire/scan.h"
#include "proto/wire/zstd_frame.h"
#include "tests/proto/golden/golden_file.h"
#include "tests/proto/refused.h"

namespace gem::wire {
namespace {

/// The cases of a file.
template <typename File>
auto Vectors(const std::string& name) {
  File file;
  golden::Read(GEM_SOURCE_DIR "/tests/proto/golden", name, &file);
  EXPECT_GT(file.cases_size(), 0);
  return *file.mutable_cases();
}

/// What is in a frame that must hold `hex`.
std::string Opened(bool framed, const std::string& bytes, const std::string& hex) {
  if (!framed) return golden::Hex(bytes);
  const auto inflated = Inflated(bytes, hex.size() / 2, FieldPath("frame"));
  return inflated.ok() ? golden::Hex(*inflated) : inflated.status().ToString();
}

TEST(GoldenGrids, AreDecodedToWhatTheyMean) {
  for (const auto& vector : Vectors<golden::Grids>("grids")) {
    SCOPED_TRACE(vector.name());
    const auto grid = FromProto(vector.grid(), kGridCells_max, FieldPath("grid"));
    ASSERT_TRUE(grid.ok()) << grid.status();
    ASSERT_EQ(vector.layers_size(), static_cast<int>(grid->layers.size()));
    for (int i = 0; i < vector.layers_size(); ++i) {
      const v1::GridLayer& proto = vector.grid().layers(i);
      const golden::LayerCase& layer = vector.layers(i);
      EXPECT_EQ(Opened(proto.zstd(), proto.valid_bitmap(), layer.valid_bitmap_hex()),
                layer.valid_bitmap_hex());
      EXPECT_EQ(Opened(proto.zstd(), proto.data(), layer.data_hex()), layer.data_hex());
      const GridLayer& decoded = grid->layers[static_cast<std::size_t>(i)];
      EXPECT_EQ(decoded, golden::LayerOf(decoded.layer, layer.values()));
    }
  }
}

TEST(GoldenGrids, AreWhatTheEncoderMakes) {
  int num_encoded = 0;
  for (const auto& vector : Vectors<golden::Grids>("grids")) {
    if (!vector.layers(0).has_input()) continue;
    SCOPED_TRACE(vector.name());
    ++num_encoded;
    const v1::Grid& want = vector.grid();
    LayeredGrid grid{static_cast<std::int32_t>(want.columns()),
                     static_cast<std::int32_t>(want.rows()),
                     want.cell_size_m(),
                     {},
                     want.stamp_ns()};
    for (int i = 0; i < want.layers_size(); ++i)
      grid.layers.push_back(golden::LayerOf(static_cast<Layer>(want.layers(i).layer() - 1),
                                            vector.layers(i).input()));
    v1::Grid got;
    ToProto(grid, want.layers(0).zstd() ? CellEncoding::kCompact : CellEncoding::kRaw, &got);
    ASSERT_EQ(got.layers_size(), want.layers_size());
    for (int i = 0; i < want.layers_size(); ++i) {
      v1::GridLayer& layer = *got.mutable_layers(i);
      EXPECT_EQ(Opened(layer.zstd(), layer.data(), vector.layers(i).data_hex()),
                vector.layers(i).data_hex());
      EXPECT_EQ(Opened(layer.zstd(), layer.valid_bitmap(), vector.layers(i).valid_bitmap_hex()),
                vector.layers(i).valid_bitmap_hex());
      layer.set_data(want.layers(i).data());
      layer.set_valid_bitmap(want.layers(i).valid_bitmap());
    }
    EXPECT_EQ(got.DebugString(), want.DebugString()) << "all but the frames";
  }
  EXPECT_GE(num_encoded, 10);
}

void ExpectPoints(const golden::ScanCase& vector, const DecodedScan& decoded, float tolerance_m) {
  ASSERT_EQ(static_cast<std::size_t>(vector.points().values_size()), decoded.points.size());
  for (int i = 0; i < vector.points().values_size(); ++i) {
    const auto& xyz = vector.points().values(i).list_value();
    const ScanPoint& point = decoded.points[static_cast<std::size_t>(i)];
    EXPECT_NEAR(point.x_m, static_cast<float>(xyz.values(0).number_value()), tolerance_m);
    EXPECT_NEAR(point.y_m, static_cast<float>(xyz.values(1).number_value()), tolerance_m);
    EXPECT_NEAR(point.z_m, static_cast<float>(xyz.values(2).number_value()), tolerance_m);
    Rgba want = 0;
    if (vector.has_colors() && vector.colors().values(i).has_list_value()) {
      const auto& color = vector.colors().values(i).list_value();
      for (int channel = 0; channel < 3; ++channel)
        want |= static_cast<Rgba>(color.values(channel).number_value()) << (8 * channel);
      want |= 0xff000000u;
    }
    EXPECT_EQ(point.rgba, want);
  }
}

TEST(GoldenScans, AreDecodedToWhatTheyMean) {
  for (const auto& vector : Vectors<golden::Scans>("scans")) {
    SCOPED_TRACE(vector.name());
    const v1::Scan& scan = vector.scan();
    DecodedScan decoded;
    const absl::Status status = FromProto(scan, {}, FieldPath("scan"), decoded);
    ASSERT_TRUE(status.ok()) << status;
    const bool framed = scan.compression() > v1::SCAN_COMPRESSION_NONE;
    if (scan.has_depth_image()) {
      EXPECT_EQ(Opened(framed, scan.depth_image().depth(), vector.depth_hex()), vector.depth_hex());
    } else {
      EXPECT_EQ(Opened(framed, scan.points(), vector.frame_hex()), vector.frame_hex());
    }
    ExpectPoints(vector, decoded, scan.has_depth_image() ? 1e-6f : 0);
    ASSERT_EQ(static_cast<std::size_t>(vector.time_offsets_s().values_size()),
              decoded.time_offsets_s.size());
    for (int i = 0; i < vector.time_offsets_s().values_size(); ++i)
      EXPECT_EQ(decoded.time_offsets_s[static_cast<std::size_t>(i)],
                static_cast<float>(vector.time_offsets_s().values(i).number_value()));
  }
}

TEST(GoldenScans, AreWhatTheEncoderMakes) {
  for (const auto& vector : Vectors<golden::Scans>("scans")) {
    if (vector.scan().has_depth_image()) continue;
    SCOPED_TRACE(vector.name());
    v1::Scan scan = vector.scan();
    scan.set_points(absl::HexStringToBytes(vector.points_hex()));
    const v1::ScanCompression compression = scan.compression();
    scan.clear_compression();
    if (compression != v1::SCAN_COMPRESSION_UNSPECIFIED)
      Compress(static_cast<ScanCompression>(compression), &scan);
    EXPECT_EQ(scan.compression(), compression);
    EXPECT_EQ(
        Opened(compression != v1::SCAN_COMPRESSION_UNSPECIFIED, scan.points(), vector.frame_hex()),
        vector.frame_hex());
  }
}

TEST(GoldenRefusals, AreRefusedWithTheSameWords) {
  for (const auto& vector : Vectors<golden::Refusals>("refusals")) {
    SCOPED_TRACE(vector.name());
    DecodedScan scan;
    const absl::Status status =
        vector.has_grid() ? FromProto(vector.grid(), kGridCells_max, FieldPath("grid")).status()
                          : FromProto(vector.scan(), {}, FieldPath("scan"), scan);
    EXPECT_THAT(status, Refused(vector.field(), vector.text()));
  }
}

TEST(GoldenPlaces, AreWhereTheyWere) {
  for (const auto& place : Vectors<golden::Places>("places")) {
    const CellIndex cell = CellAt(place.x_m(), place.y_m(), place.cell_size_m());
    EXPECT_EQ(cell, (CellIndex{place.cell_x(), place.cell_y()}));
    const CellIndex level_cell = CellAtLevel(place.level(), cell);
    EXPECT_EQ(level_cell, (CellIndex{place.level_cell_x(), place.level_cell_y()}));
    EXPECT_EQ(TileOf(level_cell), (TileIndex{place.tile().x(), place.tile().y()}));
    EXPECT_EQ(IndexInTile(level_cell), static_cast<std::int32_t>(place.index()));
    EXPECT_EQ(CenterOf(level_cell.x, CellSizeAt(place.level(), place.cell_size_m())),
              place.middle_x_m());
  }
}

}  // namespace
}  // namespace gem::wire
