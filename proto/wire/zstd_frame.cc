#include "proto/wire/zstd_frame.h"

#include <zstd.h>

#include <memory>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "proto/wire/refusal.h"

namespace gem::wire {
namespace {

struct FreeContext {
  void operator()(ZSTD_CCtx* context) const { ZSTD_freeCCtx(context); }
  void operator()(ZSTD_DCtx* context) const { ZSTD_freeDCtx(context); }
};

// One for each thread and way: to make one costs as much as to compress a tile.
ZSTD_CCtx* CompressionContext() {
  thread_local const std::unique_ptr<ZSTD_CCtx, FreeContext> context(ZSTD_createCCtx());
  GEM_CHECK(context != nullptr);
  return context.get();
}

ZSTD_DCtx* InflationContext() {
  thread_local const std::unique_ptr<ZSTD_DCtx, FreeContext> context(ZSTD_createDCtx());
  GEM_CHECK(context != nullptr);
  return context.get();
}

}  // namespace

std::string Compressed(absl::string_view data, int level) {
  std::string frame(ZSTD_compressBound(data.size()), '\0');
  const std::size_t size = ZSTD_compressCCtx(CompressionContext(), frame.data(), frame.size(),
                                             data.data(), data.size(), level);
  GEM_CHECK(!ZSTD_isError(size));
  frame.resize(size);
  return frame;
}

absl::StatusOr<std::string> Inflated(absl::string_view frame, std::size_t size_bytes,
                                     const FieldPath& field) {
  const unsigned long long claimed = ZSTD_getFrameContentSize(frame.data(), frame.size());
  if (claimed == ZSTD_CONTENTSIZE_ERROR) return Refuse(field, "not a zstd frame", "one zstd frame");
  if (claimed == ZSTD_CONTENTSIZE_UNKNOWN)
    return Refuse(field, "a zstd frame without content size", "the size in the frame's header");
  if (claimed != size_bytes)
    return Refuse(field, absl::StrCat("a zstd frame of ", claimed, " bytes"),
                  absl::StrCat(size_bytes));
  const std::size_t frame_bytes = ZSTD_findFrameCompressedSize(frame.data(), frame.size());
  if (ZSTD_isError(frame_bytes))
    return Refuse(field, ZSTD_getErrorName(frame_bytes), "one intact zstd frame");
  if (frame_bytes != frame.size())
    return Refuse(field, absl::StrCat(frame.size() - frame_bytes, " bytes behind a zstd frame"),
                  "one zstd frame");
  std::string data(size_bytes, '\0');
  const std::size_t size =
      ZSTD_decompressDCtx(InflationContext(), data.data(), data.size(), frame.data(), frame.size());
  if (ZSTD_isError(size)) return Refuse(field, ZSTD_getErrorName(size), "one intact zstd frame");
  if (size != size_bytes)
    return Refuse(field, absl::StrCat(size, " bytes"), absl::StrCat(size_bytes));
  return data;
}

}  // namespace gem::wire
