#include "client/formats/png_file.h"

#include <png.h>

#include "absl/strings/str_cat.h"

namespace gem {

absl::StatusOr<std::string> ToPng(const Image& image) {
  png_image png = {};
  png.version = PNG_IMAGE_VERSION;
  png.width = static_cast<png_uint_32>(image.width);
  png.height = static_cast<png_uint_32>(image.height);
  png.format = PNG_FORMAT_RGB;
  const int stride = image.width * 3;
  // Rows of noise do not shrink: the bound leaves room for zlib's and PNG's own bytes.
  png_alloc_size_t size = PNG_IMAGE_PNG_SIZE_MAX(png);
  std::string bytes(size, '\0');
  if (png_image_write_to_memory(&png, bytes.data(), &size, 0, image.pixels.data(), stride,
                                nullptr) == 0)
    return absl::InternalError(absl::StrCat("the picture of ", image.width, " x ", image.height,
                                            " pixels cannot be encoded: ", png.message));
  bytes.resize(size);
  return bytes;
}

}  // namespace gem
