// zstd frames that declare the size of their content. The size is checked before memory is allocated.
#pragma once

#include <zstd.h>

#include <cstddef>
#include <memory>
#include <string>

#include "firstfix/errors.hpp"
#include "firstfix/wire/bytes.hpp"

namespace firstfix::detail {

inline Bytes compressed(const Bytes& content, int level, bool checksum) {
  const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(), &ZSTD_freeCCtx);
  if (!context) throw std::bad_alloc();
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, level);
  ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, checksum ? 1 : 0);
  Bytes frame(ZSTD_compressBound(content.size()));
  const std::size_t size =
      ZSTD_compress2(context.get(), frame.data(), frame.size(), content.data(), content.size());
  if (ZSTD_isError(size) != 0) throw Error("internal", std::string("zstd: ") + ZSTD_getErrorName(size));
  frame.resize(size);
  return frame;
}

// The content of exactly one frame. Its declared size must be in [least, most].
inline Bytes decompressed(ByteSpan frame, std::size_t least, std::size_t most) {
  static constexpr std::uint8_t kMagic[] = {0x28, 0xB5, 0x2F, 0xFD};
  if (frame.size < sizeof kMagic || std::memcmp(frame.data, kMagic, sizeof kMagic) != 0) {
    throw Error("malformed_data", "a zstd frame is missing");
  }
  const unsigned long long declared = ZSTD_getFrameContentSize(frame.data, frame.size);
  if (declared == ZSTD_CONTENTSIZE_UNKNOWN || declared == ZSTD_CONTENTSIZE_ERROR || declared < least ||
      declared > most) {
    throw Error("malformed_data", "a zstd frame declares a size that the header does not allow");
  }
  if (ZSTD_findFrameCompressedSize(frame.data, frame.size) != frame.size) {
    throw Error("malformed_data", "a zstd frame is cut off, or bytes follow it");
  }
  Bytes content(static_cast<std::size_t>(declared));
  std::uint8_t nothing = 0;
  std::uint8_t* target = content.empty() ? &nothing : content.data();
  const std::size_t size = ZSTD_decompress(target, content.size(), frame.data, frame.size);
  if (ZSTD_isError(size) != 0 || size != content.size()) {
    throw Error("malformed_data", "a zstd frame is damaged");
  }
  return content;
}

}  // namespace firstfix::detail
