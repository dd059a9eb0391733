// Writing and reading of little-endian values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <type_traits>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/errors.hpp"

namespace firstfix {

using Bytes = std::vector<std::uint8_t>;

namespace detail {

template <typename Value>
using Bits = std::conditional_t<
    sizeof(Value) == 8, std::uint64_t,
    std::conditional_t<sizeof(Value) == 4, std::uint32_t,
                       std::conditional_t<sizeof(Value) == 2, std::uint16_t, std::uint8_t>>>;

template <typename Value>
void put(Bytes& out, Value value) {
  Bits<Value> bits;
  std::memcpy(&bits, &value, sizeof value);
  for (std::size_t i = 0; i < sizeof value; ++i) {
    out.push_back(static_cast<std::uint8_t>((static_cast<std::uint64_t>(bits) >> (8 * i)) & 0xffU));
  }
}

inline void append(Bytes& out, const Bytes& more) { out.insert(out.end(), more.begin(), more.end()); }

// A view of bytes that another object owns.
using ByteSpan = Span<const std::uint8_t>;

inline ByteSpan span_of(const Bytes& bytes) { return {bytes.data(), bytes.size()}; }

// Reads a body from its beginning. Throws "malformed_data" if the body ends too early.
class Reader {
 public:
  Reader(const std::uint8_t* data, std::size_t size, std::string name) : rest_{data, size}, name_(std::move(name)) {}

  ByteSpan take(std::size_t count) {
    if (rest_.size < count) throw Error("malformed_data", "the " + name_ + " is cut off");
    const ByteSpan taken{rest_.data, count};
    if (count > 0) rest_.data += count;
    rest_.size -= count;
    return taken;
  }

  template <typename Value>
  Value get() {
    const Span raw = take(sizeof(Value));
    std::uint64_t bits = 0;
    for (std::size_t i = 0; i < sizeof(Value); ++i) bits |= static_cast<std::uint64_t>(raw.data[i]) << (8 * i);
    const auto narrow = static_cast<Bits<Value>>(bits);
    Value value;
    std::memcpy(&value, &narrow, sizeof value);
    return value;
  }

  // The four bytes that every encoding begins with.
  void magic(const char* wanted) {
    const Span found = take(4);
    if (std::memcmp(found.data, wanted, 4) != 0) throw Error("malformed_data", "the body is not " + name_ + ": its first four bytes are wrong");
  }

  std::size_t left() const { return rest_.size; }

  void end() const {
    if (rest_.size > 0) throw Error("malformed_data", "bytes follow the " + name_);
  }

 private:
  ByteSpan rest_;
  std::string name_;
};

}  // namespace detail
}  // namespace firstfix
