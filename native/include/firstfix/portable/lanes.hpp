// Vectors of lanes: the compiler's vector type, which becomes instructions of any set. For kernels of the engine; what a
// robot runs too is written as plain loops.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

namespace firstfix::detail {

#if defined(__AVX512F__)
constexpr std::size_t kFloatLanes = 16;
#else
constexpr std::size_t kFloatLanes = 8;
#endif

typedef float FloatLanes __attribute__((vector_size(kFloatLanes * sizeof(float))));
typedef std::int32_t IntLanes __attribute__((vector_size(kFloatLanes * sizeof(float))));

inline FloatLanes load_lanes(const float* from) {
  FloatLanes lanes;
  std::memcpy(&lanes, from, sizeof lanes);
  return lanes;
}

inline void store_lanes(float* to, FloatLanes lanes) { std::memcpy(to, &lanes, sizeof lanes); }

inline FloatLanes all_lanes(float value) { return FloatLanes{} + value; }

// Whether any lane of a comparison's result holds.
inline bool any_lane(IntLanes holds) {
  std::int64_t words[sizeof holds / 8], any = 0;
  std::memcpy(words, &holds, sizeof holds);
  for (const std::int64_t word : words) any |= word;
  return any != 0;
}

}  // namespace firstfix::detail
