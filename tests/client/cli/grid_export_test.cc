#include "client/cli/grid_export.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "client/cli/export_flags.h"
#include "client/formats/esri_ascii.h"
#include "client/formats/png_file.h"
#include "tests/client/grid_samples.h"
#include "tests/client/temporary_directory.h"

namespace gem::client {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

// South row 1 2, north row 3 and unknown; origin at cell (-1, 2) of 0.5 m.
PlacedGrid Sample() { return GridOf(2, {1, 2, 3, {}}, {1, 0, {}, {}}); }

TEST(GridExport, WritesEsriAsciiWithTheNorthRowFirst) {
  EXPECT_EQ(Export(Sample(), Layer::kElevation, ExportFormat::kEsriAscii).value(),
            "ncols 2\nnrows 2\nxllcorner -0.5\nyllcorner 1\ncellsize 0.5\nNODATA_value -9999\n"
            "3 -9999\n1 2\n");
}

TEST(GridExport, WritesOneLineAKnownCellAtItsCentre) {
  EXPECT_EQ(Export(Sample(), Layer::kElevation, ExportFormat::kXyz).value(),
            "-0.25 1.25 1\n0.25 1.25 2\n-0.25 1.75 3\n");
  // A cell without the layer has no line, even where the elevation is known.
  EXPECT_EQ(Export(Sample(), Layer::kTraversability, ExportFormat::kXyz).value(),
            "-0.25 1.25 1\n0.25 1.25 0\n");
}

TEST(GridExport, KeepsEveryBitOfAHeight) {
  PlacedGrid map = Sample();
  map.grid.layers[0].values = {0.1f, -1.0f / 3, 123456.79f, 0};
  const TemporaryDirectory dir;
  const auto read = ReadEsriAscii(
      dir.Write("map.asc", Export(map, Layer::kElevation, ExportFormat::kEsriAscii).value()));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->values, map.grid.layers[0].values);
  EXPECT_EQ(read->valid, map.grid.layers[0].valid);
}

TEST(GridExport, WritesAColourAsOneNumber) {
  PlacedGrid map = Sample();
  map.grid.layers.push_back({Layer::kColor, {1, 0, 0, 0}, {}, {0xff030201u, 0, 0, 0}});
  // red 1, green 2, blue 3: 65536 + 512 + 3.
  EXPECT_EQ(Export(map, Layer::kColor, ExportFormat::kXyz).value(), "-0.25 1.25 66051\n");
}

TEST(GridExport, ReadsElevationWithEveryLayerAndTraversabilityForPictures) {
  EXPECT_THAT(LayersToRead(Layer::kElevation, ExportFormat::kXyz), ElementsAre(Layer::kElevation));
  EXPECT_THAT(LayersToRead(Layer::kVariance, ExportFormat::kEsriAscii),
              ElementsAre(Layer::kElevation, Layer::kVariance));
  EXPECT_THAT(LayersToRead(Layer::kVariance, ExportFormat::kPng),
              ElementsAre(Layer::kElevation, Layer::kTraversability, Layer::kVariance));
}

TEST(GridExport, ReadsNoTraversabilityForAnOrthophoto) {
  EXPECT_THAT(LayersToRead(Layer::kColor, ExportFormat::kPng),
              ElementsAre(Layer::kElevation, Layer::kColor));
}

TEST(GridExport, DrawsAnOrthophotoOfTheColours) {
  PlacedGrid map = Sample();
  map.grid.layers.erase(map.grid.layers.begin() + 1);  // no traversability
  map.grid.layers.push_back({Layer::kColor, {1, 0, 0, 0}, {}, {0xff030201u, 0, 0, 0}});
  const TemporaryDirectory dir;
  const Image image =
      ReadPng(dir.Write("map.png", Export(map, Layer::kColor, ExportFormat::kPng).value())).value();
  // The south-western cell is at the lower left.
  EXPECT_EQ(image.At(0, image.height - 1), (Rgb{1, 2, 3}));
}

TEST(ExportFlags, ListTheLayersAsTheyAreTyped) {
  const auto error = [](const char* name, const std::vector<Layer>& layers) {
    return std::string(ParseLayerFlag(name, layers).status().message());
  };
  EXPECT_EQ(error("LAYER_COLOR", GlobalMapLayers()),
            "--layer is \"LAYER_COLOR\", want one of elevation, variance, traversability, color, "
            "age");
  EXPECT_EQ(error("slope", GlobalMapLayers()),
            "--layer is \"slope\", want one of elevation, variance, traversability, color, age: "
            "tiles have no other, gem local has");
  EXPECT_EQ(ParseLayerFlag("slope", LocalMapLayers()).value(), Layer::kSlope);
  EXPECT_EQ(ParseLayerFlag("color", GlobalMapLayers()).value(), Layer::kColor);
}

TEST(GridExport, NamesTheFormatItDoesNotKnow) {
  EXPECT_EQ(ParseExportFormat("png").value(), ExportFormat::kPng);
  EXPECT_THAT(std::string(ParseExportFormat("tif").status().message()),
              HasSubstr("format is \"tif\", want asc, xyz or png"));
}

}  // namespace
}  // namespace gem::client
