// Strings of bits in bytes, the first bit in the most significant place, as NumPy packs them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace firstfix::detail {

constexpr std::size_t kWordBits = 64;

// The highest `count` bits of a word, 1 to 64.
inline std::uint64_t highest(std::size_t count) { return ~std::uint64_t{0} << (kWordBits - count); }

// The word of eight bytes, the first of which is the most significant.
inline std::uint64_t big_endian(const std::uint8_t* bytes) {
  std::uint64_t word;
  std::memcpy(&word, bytes, sizeof word);
#if __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  word = __builtin_bswap64(word);
#endif
  return word;
}

// A string of bits in `bytes` bytes. Beyond its end are zeros.
struct BitString {
  const std::uint8_t* data;
  std::size_t bytes;

  // Up to 64 bits, `count` of them, from the bit `first` on. Zeros follow.
  std::uint64_t word_at(std::size_t first, std::size_t count) const {
    const std::size_t byte = first / 8, off = first % 8;
    std::uint64_t word = 0;
    if (byte + 9 > bytes) {
      for (std::size_t i = 0; i < 8; ++i) word = word << 8 | at(byte + i);
      word = word << off | at(byte + 8) >> (8 - off);
    } else {
      word = big_endian(data + byte) << off;
      if (off + count > kWordBits) word |= static_cast<std::uint64_t>(data[byte + 8]) >> (8 - off);
    }
    return word & highest(count);
  }

  // Number of ones among the first `count` bits.
  std::int64_t ones(std::size_t count) const {
    std::int64_t found = 0;
    const std::size_t whole = count / kWordBits;
    for (std::size_t i = 0; i < whole; ++i) {
      std::uint64_t word;
      std::memcpy(&word, data + 8 * i, 8);
      found += __builtin_popcountll(word);
    }
    const std::size_t left = count % kWordBits;
    return left == 0 ? found : found + __builtin_popcountll(word_at(whole * kWordBits, left));
  }

 private:
  std::uint64_t at(std::size_t byte) const { return byte < bytes ? data[byte] : 0; }
};

}  // namespace firstfix::detail
