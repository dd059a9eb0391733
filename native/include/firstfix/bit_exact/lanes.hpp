// Vectors of as many lanes as the processor's registers have: the compiler's vector type. For kernels of the engine
// whose results do not depend on the number of lanes; what a robot runs too is written as plain loops.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace firstfix::detail {

#if defined(__AVX512F__)
constexpr std::size_t kVectorBytes = 64;
#elif defined(__AVX2__)
constexpr std::size_t kVectorBytes = 32;
#else
constexpr std::size_t kVectorBytes = 16;
#endif

constexpr std::size_t kFloatLanes = kVectorBytes / sizeof(float), kWordLanes = kVectorBytes / sizeof(std::uint64_t);

typedef float FloatLanes __attribute__((vector_size(kVectorBytes)));
typedef std::int32_t IntLanes __attribute__((vector_size(kVectorBytes)));
typedef std::uint64_t WordLanes __attribute__((vector_size(kVectorBytes)));

inline FloatLanes load_lanes(const float* from) {
  FloatLanes lanes;
  std::memcpy(&lanes, from, sizeof lanes);
  return lanes;
}

inline void store_lanes(float* to, FloatLanes lanes) { std::memcpy(to, &lanes, sizeof lanes); }

inline FloatLanes all_lanes(float value) { return FloatLanes{} + value; }

inline FloatLanes greater_lanes(FloatLanes a, FloatLanes b) { return a < b ? b : a; }

inline FloatLanes lesser_lanes(FloatLanes a, FloatLanes b) { return b < a ? b : a; }

inline FloatLanes root_lanes(FloatLanes of) {
  float roots[kFloatLanes];
  store_lanes(roots, of);
  for (float& root : roots) root = std::sqrt(root);
  return load_lanes(roots);
}

// Whether any lane of a comparison's result holds.
inline bool any_lane(IntLanes holds) {
  typedef std::int64_t Words __attribute__((vector_size(16)));
  Words quarters[sizeof holds / 16];
  std::memcpy(quarters, &holds, sizeof holds);
  for (std::size_t i = 1; i < sizeof holds / 16; ++i) quarters[0] |= quarters[i];
  return (quarters[0][0] | quarters[0][1]) != 0;
}

}  // namespace firstfix::detail
