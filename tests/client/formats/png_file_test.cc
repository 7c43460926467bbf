#include "client/formats/png_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include "tests/client/temporary_directory.h"

namespace gem {
namespace {

using ::testing::HasSubstr;

/// Pixels of a PNG as libpng reads them, in the given format of a byte a channel.
std::vector<std::uint8_t> Decode(const std::string& bytes, png_uint_32 format) {
  png_image png = {};
  png.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()), 0);
  png.format = format;
  std::vector<std::uint8_t> pixels(PNG_IMAGE_SIZE(png));
  EXPECT_NE(png_image_finish_read(&png, nullptr, pixels.data(), 0, nullptr), 0);
  return pixels;
}

TEST(PngFile, IsReadBackAsItWas) {
  Image image{3, 2, {}};
  for (std::uint8_t i = 0; i < 6; ++i)
    image.pixels.push_back({i, static_cast<std::uint8_t>(40 * i), 255});
  const TemporaryDirectory dir;
  const auto read = ReadPng(dir.Write("a.png", ToPng(image).value()));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->width, 3);
  EXPECT_EQ(read->height, 2);
  EXPECT_EQ(read->pixels, image.pixels);
}

TEST(PngFile, KeepsTransparency) {
  const TransparentImage image{2, 1, {0xff030201u, 0}};
  EXPECT_THAT(Decode(ToPng(image).value(), PNG_FORMAT_RGBA),
              testing::ElementsAre(1, 2, 3, 255, 0, 0, 0, 0));
}

TEST(PngFile, ReadsGreyAsThreeEqualChannels) {
  png_image png = {};
  png.version = PNG_IMAGE_VERSION;
  png.width = 2;
  png.height = 1;
  png.format = PNG_FORMAT_GRAY;
  const std::uint8_t grey[] = {7, 200};
  png_alloc_size_t size = 0;
  ASSERT_NE(png_image_write_to_memory(&png, nullptr, &size, 0, grey, 0, nullptr), 0);
  std::string bytes(size, '\0');
  ASSERT_NE(png_image_write_to_memory(&png, bytes.data(), &size, 0, grey, 0, nullptr), 0);
  const TemporaryDirectory dir;
  const auto read = ReadPng(dir.Write("grey.png", bytes));
  ASSERT_TRUE(read.ok()) << read.status();
  EXPECT_EQ(read->pixels, (std::vector<Rgb>{{7, 7, 7}, {200, 200, 200}}));
}

TEST(PngFile, NamesTheFileItCannotRead) {
  const TemporaryDirectory dir;
  const auto error = [](const std::string& path) {
    return std::string(ReadPng(path).status().message());
  };
  EXPECT_THAT(error(dir.File("gone.png")), HasSubstr("gone.png: no such file"));
  EXPECT_THAT(error(dir.Write("text.png", "hello")), HasSubstr("text.png: not a readable PNG"));
  const std::string whole = ToPng(Image{8, 8, std::vector<Rgb>(64)}).value();
  EXPECT_THAT(error(dir.Write("half.png", whole.substr(0, whole.size() / 2))),
              HasSubstr("half.png: not a readable PNG"));
}

}  // namespace
}  // namespace gem
