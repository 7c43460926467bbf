#include "client/formats/png_file.h"

#include <png.h>

#include <bit>

#include "absl/strings/str_cat.h"
#include "client/formats/text_file.h"
#include "core/base/status_macros.h"

namespace gem {
namespace {

static_assert(std::endian::native == std::endian::little, "pixels are handed over as they lie");

constexpr std::uint64_t kFileBytesMax = std::uint64_t{1} << 28;
constexpr std::uint64_t kPixelsMax = std::uint64_t{1} << 26;

absl::StatusOr<std::string> Encode(std::int32_t width, std::int32_t height, png_uint_32 format,
                                   const void* pixels) {
  png_image png = {};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(width);
  png.height = static_cast<png_uint_32>(height);
  png.format = format;
  // Rows of noise do not shrink: the bound leaves room for zlib's and PNG's own bytes.
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(png);
  std::string bytes(size, '\0');
  if (png_image_write_to_memory(&png, bytes.data(), &size, 0, pixels, 0, nullptr) == 0)
    return absl::InternalError(absl::StrCat("the picture of ", width, " x ", height,
                                            " pixels cannot be encoded: ", png.message));
  bytes.resize(size);
  return bytes;
}

}  // namespace

absl::StatusOr<std::string> ToPng(const Image& image) {
  return Encode(image.width, image.height, PNG_FORMAT_RGB, image.pixels.data());
}

absl::StatusOr<std::string> ToPng(const TransparentImage& image) {
  return Encode(image.width, image.height, PNG_FORMAT_RGBA, image.pixels.data());
}

absl::StatusOr<Image> ReadPng(const std::string& path) {
  GEM_ASSIGN_OR_RETURN(const std::string bytes, ReadFile(path, kFileBytesMax));
  png_image png = {};
  png.version = PNG_IMAGE_VERSION;
  const auto failed = [&] {
    const std::string why = png.message;
    png_image_free(&png);
    return absl::InvalidArgumentError(absl::StrCat(path, ": not a readable PNG: ", why));
  };
  if (png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()) == 0) return failed();
  if (std::uint64_t{png.width} * png.height > kPixelsMax) {
    png_image_free(&png);
    return absl::InvalidArgumentError(absl::StrCat(path, ": ", png.width, " x ", png.height,
                                                   " pixels, want at most ", kPixelsMax));
  }
  png.format = PNG_FORMAT_RGB;
  Image image{static_cast<std::int32_t>(png.width), static_cast<std::int32_t>(png.height), {}};
  image.pixels.resize(static_cast<std::size_t>(png.width) * png.height);
  const png_color black = {};
  if (png_image_finish_read(&png, &black, image.pixels.data(), 0, nullptr) == 0) return failed();
  return image;
}

}  // namespace gem
