#include "client/pictures/map_picture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "tests/client/grid_samples.h"

namespace gem {

void PrintTo(const Rgb& color, std::ostream* out) {
  *out << int{color.red} << "," << int{color.green} << "," << int{color.blue};
}

namespace client {
namespace {

constexpr Rgb kFree{85, 170, 85};
constexpr Rgb kObstacle{150, 40, 30};
constexpr Rgb kNearlyFree{205, 125, 60};
constexpr Rgb kNotAnnotated{150, 150, 150};

PictureOptions OnePixelACell(Layer layer = Layer::kTraversability) {
  PictureOptions options;
  options.layer = layer;
  options.pixels_per_cell = 1;
  return options;
}

TEST(MapPicture, ColoursAFlatMapByTraversability) {
  const Image image = Draw(GridOf(5, {1, 1, 1, 1, {}}, {1, 0, 0.7f, {}, {}}), OnePixelACell());
  ASSERT_EQ(image.width, 5);
  ASSERT_EQ(image.height, 1);
  EXPECT_EQ(image.At(0, 0), kFree);
  EXPECT_EQ(image.At(1, 0), kObstacle);
  // Free is above the threshold, not on it.
  EXPECT_EQ(image.At(2, 0), kNearlyFree);
  EXPECT_EQ(image.At(3, 0), kNotAnnotated);
  EXPECT_EQ(image.At(4, 0), kUnknownColor);
}

TEST(MapPicture, HasNorthUpAndEastRight) {
  // North-east is the only obstacle.
  const Image image = Draw(GridOf(2, {0, 0, 0, 0}, {1, 1, 1, 0}), OnePixelACell());
  EXPECT_EQ(image.At(1, 0), kObstacle);
  EXPECT_EQ(image.At(0, 0), kFree);
  EXPECT_EQ(image.At(1, 1), kFree);
}

TEST(MapPicture, IsLitFromTheNorthWest) {
  const std::vector<std::optional<float>> free(9, 1);
  const auto green = [&free](const std::vector<std::optional<float>>& elevation) {
    return Draw(GridOf(3, elevation, free), OnePixelACell()).At(1, 1).green;
  };
  const int flat = green(std::vector<std::optional<float>>(9, 0));
  const int rises_to_east = green({0, 0.5f, 1, 0, 0.5f, 1, 0, 0.5f, 1});   // faces the light
  const int rises_to_north = green({0, 0, 0, 0.5f, 0.5f, 0.5f, 1, 1, 1});  // faces away
  EXPECT_GT(rises_to_east, flat);
  EXPECT_LT(rises_to_north, flat);
}

TEST(MapPicture, NeverDrawsUnknownOrNotAnnotatedAsFree) {
  std::mt19937 random(7);
  std::uniform_real_distribution<float> height(-3, 3), unit(0, 1);
  std::vector<std::optional<float>> elevation(400), traversability(400);
  for (std::size_t i = 0; i < 400; ++i) {
    if (unit(random) < 0.7f) elevation[i] = height(random);
    if (elevation[i] && unit(random) < 0.7f) traversability[i] = unit(random);
  }
  PlacedGrid map = GridOf(20, elevation, traversability);
  map.grid.layers.push_back(LayerOf(Layer::kVariance, elevation));
  for (const Layer layer : {Layer::kElevation, Layer::kTraversability, Layer::kVariance}) {
    const Image image = Draw(map, OnePixelACell(layer));
    int num_unknown = 0, num_not_annotated = 0;
    for (int row = 0; row < 20; ++row) {
      for (int column = 0; column < 20; ++column) {
        const auto cell = static_cast<std::size_t>(row * 20 + column);
        const Rgb pixel = image.At(column, 19 - row);
        EXPECT_EQ(pixel == kUnknownColor, !elevation[cell].has_value());
        num_unknown += !elevation[cell].has_value();
        if (layer == Layer::kVariance || !elevation[cell] || traversability[cell]) continue;
        ++num_not_annotated;
        EXPECT_TRUE(pixel.red == pixel.green && pixel.green == pixel.blue) << "not grey";
      }
    }
    EXPECT_GT(num_unknown, 50);
    EXPECT_GE(num_not_annotated, layer == Layer::kVariance ? 0 : 50);
  }
}

constexpr Rgba kOrange = 0xff0a141eu;  // red 30, green 20, blue 10

/// Elevations are all 0; 0 is no colour.
PlacedGrid ColorsOf(std::int32_t columns, const std::vector<Rgba>& colors) {
  const std::vector<std::optional<float>> flat(colors.size(), 0.0f);
  PlacedGrid map = GridOf(columns, flat, flat);
  GridLayer layer{Layer::kColor, {}, {}, colors};
  for (const Rgba rgba : colors) layer.valid.push_back(rgba != 0 ? 1 : 0);
  map.grid.layers.push_back(layer);
  return map;
}

TEST(Orthophoto, ShowsColoursAsTheyAreAndNothingWhereThereIsNone) {
  const TransparentImage image = DrawOrthophoto(ColorsOf(2, {kOrange, 0}), OnePixelACell());
  EXPECT_EQ(image.At(0, 0), kOrange);
  EXPECT_EQ(image.At(1, 0), 0u);
}

TEST(Orthophoto, IsNotShadedOnASlope) {
  PlacedGrid map = ColorsOf(2, {kOrange, kOrange});
  map.grid.layers[0].values = {0, 5};
  const TransparentImage image = DrawOrthophoto(map, OnePixelACell());
  EXPECT_EQ(image.pixels, (std::vector<Rgba>{kOrange, kOrange}));
}

TEST(Orthophoto, HasNorthUpAndEastRight) {
  const Rgba south_west = 0xff000001u, south_east = 0xff000002u, north_west = 0xff000003u,
             north_east = 0xff000004u;
  const TransparentImage image = DrawOrthophoto(
      ColorsOf(2, {south_west, south_east, north_west, north_east}), OnePixelACell());
  EXPECT_EQ(image.pixels, (std::vector<Rgba>{north_west, north_east, south_west, south_east}));
}

TEST(Orthophoto, ShowsTheMeanOfSeveralCells) {
  PictureOptions options;
  options.side_pixels_max = 2;
  // Two known cells of four: reds 10 and 21. Two pixels; the right one has no colour.
  const TransparentImage image =
      DrawOrthophoto(ColorsOf(4, {0xff00000au, 0, 0, 0, 0, 0xff000015u, 0, 0}), options);
  ASSERT_EQ(image.pixels.size(), 2u);
  EXPECT_EQ(image.At(0, 0), 0xff000010u);  // 15.5 rounds up
  EXPECT_EQ(image.At(1, 0), 0u);
}

TEST(Orthophoto, IsAsLargeAsTheOtherPictures) {
  const PlacedGrid map = ColorsOf(40, std::vector<Rgba>(40 * 20, kOrange));
  const Image hillshade = Draw(map, {});
  const TransparentImage orthophoto = DrawOrthophoto(map);
  EXPECT_EQ(orthophoto.width, hillshade.width);
  EXPECT_EQ(orthophoto.height, hillshade.height);
}

TEST(MapPicture, ShowsTheLeastTraversableOfSeveralCells) {
  // 4 x 2 cells on 2 x 1 pixels: one obstacle among free cells; known among unknown ones.
  PictureOptions options;
  options.side_pixels_max = 2;
  const Image image =
      Draw(GridOf(4, {0, 0, {}, {}, 0, 0, {}, 0}, {1, 1, {}, {}, 0, 1, {}, 1}), options);
  ASSERT_EQ(image.width, 2);
  ASSERT_EQ(image.height, 1);
  EXPECT_EQ(image.At(0, 0), kObstacle);
  EXPECT_EQ(image.At(1, 0), kFree);
}

TEST(MapPicture, EnlargesASmallMap) {
  const std::vector<std::optional<float>> flat(40 * 20, 0);
  const Image image = Draw(GridOf(40, flat, flat), {});
  EXPECT_EQ(image.width, 40 * 13);  // 13 is the first that reaches 512
  EXPECT_EQ(image.height, 20 * 13);
}

}  // namespace
}  // namespace client
}  // namespace gem
