// Eight numbers in step. The width is fixed by the source, not by the processor: sums over the lanes have the same order,
// and so the same last bit, for every instruction set.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace firstfix {

constexpr std::size_t kLanes = 8;

using Float8 = float __attribute__((vector_size(4 * kLanes)));
using Int8 = std::int32_t __attribute__((vector_size(4 * kLanes)));

inline Float8 load8(const float* from) {
  Float8 lanes;
  std::memcpy(&lanes, from, sizeof lanes);
  return lanes;
}

inline Int8 load8(const std::int32_t* from) {
  Int8 lanes;
  std::memcpy(&lanes, from, sizeof lanes);
  return lanes;
}

inline void store8(const Float8& lanes, float* to) { std::memcpy(to, &lanes, sizeof lanes); }
inline void store8(const Int8& lanes, std::int32_t* to) { std::memcpy(to, &lanes, sizeof lanes); }

inline Float8 all8(float value) { return Float8{} + value; }

// Whether any lane of a comparison holds.
inline bool any(const Int8& mask) {
  std::uint64_t words[kLanes / 2];
  std::memcpy(words, &mask, sizeof words);
  return (words[0] | words[1] | words[2] | words[3]) != 0;
}

inline double sum(const Float8& lanes) {
  double total = 0;
  for (std::size_t lane = 0; lane < kLanes; ++lane) total += static_cast<double>(lanes[lane]);
  return total;
}

inline std::size_t padded(std::size_t count) { return (count + kLanes - 1) / kLanes * kLanes; }

}  // namespace firstfix
