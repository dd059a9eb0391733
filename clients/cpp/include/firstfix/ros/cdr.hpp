// Reads a serialised ROS 2 message field by field: plain CDR, with its alignment, in both byte orders.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <utility>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/errors.hpp"

namespace firstfix::ros {

using ByteSpan = Span<const std::uint8_t>;

namespace detail {

inline bool is_utf8(const std::string& text) {
  std::size_t left = 0;
  unsigned least = 0x80, most = 0xBF;  // of the next byte
  for (const char c : text) {
    const unsigned byte = static_cast<unsigned char>(c);
    if (left > 0) {
      if (byte < least || byte > most) return false;
      least = 0x80, most = 0xBF, --left;
    } else if (byte >= 0xC2 && byte <= 0xF4) {
      left = byte < 0xE0 ? 1 : byte < 0xF0 ? 2 : 3;
      if (byte == 0xE0) least = 0xA0;
      if (byte == 0xED) most = 0x9F;  // no surrogates
      if (byte == 0xF0) least = 0x90;
      if (byte == 0xF4) most = 0x8F;
    } else if (byte >= 0x80) {
      return false;
    }
  }
  return left == 0;
}

// A number of 1, 2, 4 or 8 bytes at any address.
template <class Number>
Number number_at(const std::uint8_t* address, bool is_big_endian) {
  std::uint8_t bytes[sizeof(Number)];
  for (std::size_t i = 0; i < sizeof(Number); ++i) bytes[i] = address[is_big_endian ? sizeof(Number) - 1 - i : i];
  std::uint64_t bits = 0;  // whatever the processor's own order is
  for (std::size_t i = 0; i < sizeof(Number); ++i) bits |= static_cast<std::uint64_t>(bytes[i]) << (8 * i);
  Number number;
  if constexpr (sizeof(Number) == 8) {
    std::memcpy(&number, &bits, sizeof number);
  } else if constexpr (sizeof(Number) == 4) {
    const auto narrow = static_cast<std::uint32_t>(bits);
    std::memcpy(&number, &narrow, sizeof number);
  } else if constexpr (sizeof(Number) == 2) {
    const auto narrow = static_cast<std::uint16_t>(bits);
    std::memcpy(&number, &narrow, sizeof number);
  } else {
    const auto narrow = static_cast<std::uint8_t>(bits);
    std::memcpy(&number, &narrow, sizeof number);
  }
  return number;
}

}  // namespace detail

// It reads nothing beyond the end of the body, and takes no memory before it has compared a size with what is there.
class MessageReader {
 public:
  // name: type of the message, for errors. body: the whole message; it must outlive this. Throws Error "malformed_data" if it is
  // shorter than its encapsulation, "unsupported_format" for one other than plain CDR.
  MessageReader(std::string name, ByteSpan body) : name_(std::move(name)), body_(body) {
    if (body.size < kEncapsulation) fail(std::to_string(body.size) + " bytes are too few for a message");
    const unsigned kind = body.data[0] * 256U + body.data[1];
    if (kind > 1) {
      constexpr char kDigits[] = "0123456789abcdef";
      std::string digits;
      for (const unsigned shift : {12U, 8U, 4U, 0U}) digits += kDigits[(kind >> shift) & 15U];
      throw Error("unsupported_format", name_ + ": the encapsulation 0x" + digits + " is not plain CDR");
    }
    is_big_endian_ = kind == 0;
  }

  [[noreturn]] void fail(const std::string& why) const { throw Error("malformed_data", name_ + ": " + why); }

  template <class Number>
  Number number() {
    place_ += (sizeof(Number) - (place_ - kEncapsulation) % sizeof(Number)) % sizeof(Number);
    return detail::number_at<Number>(take(sizeof(Number)).data, is_big_endian_);
  }

  bool flag() {
    const unsigned value = number<std::uint8_t>();
    if (value > 1) fail("a boolean must be 0 or 1, not " + std::to_string(value));
    return value == 1;
  }

  // A text of up to 1,024 bytes.
  std::string text() {
    constexpr std::size_t kLongest = 1024;
    const std::size_t length = number<std::uint32_t>();
    if (length > kLongest) fail("a text of " + std::to_string(length) + " bytes, the limit is " + std::to_string(kLongest));
    const ByteSpan raw = take(length);
    if (length == 0) return "";
    if (raw.data[length - 1] != 0) fail("a text does not end with a zero byte");
    std::string found(reinterpret_cast<const char*>(raw.data), length - 1);
    if (!detail::is_utf8(found)) fail("a text is not UTF-8");
    return found;
  }

  // Length of a sequence. what: its elements, for errors.
  std::size_t count(std::size_t most, const char* what) {
    const std::size_t count = number<std::uint32_t>();
    if (count > most) fail(std::to_string(count) + " " + what + ", the limit is " + std::to_string(most));
    return count;
  }

  // A sequence of bytes, as a view of the body.
  ByteSpan octets() { return take(number<std::uint32_t>()); }

  // Checks that only padding follows.
  void end() const {
    constexpr std::size_t kPadding = 3;  // some middlewares fill up to a multiple of four
    const std::size_t left = body_.size - place_;
    if (left > kPadding) fail(std::to_string(left) + " bytes follow the message");
  }

 private:
  static constexpr std::size_t kEncapsulation = 4;

  ByteSpan take(std::size_t size) {
    const std::size_t left = body_.size - std::min(place_, body_.size);
    if (size > left || place_ > body_.size) {
      fail("the message is cut off: " + std::to_string(left) + " of " + std::to_string(size) + " bytes");
    }
    const ByteSpan taken{body_.data + place_, size};
    place_ += size;
    return taken;
  }

  std::string name_;
  ByteSpan body_;
  std::size_t place_ = kEncapsulation;
  bool is_big_endian_ = false;
};

}  // namespace firstfix::ros
