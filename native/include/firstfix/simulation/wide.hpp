// Many floats that the processor computes with at once, on every instruction set with the same result.
#pragma once

#include <cstdint>
#include <cstring>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

namespace firstfix::detail {

#if defined(__AVX512DQ__)
constexpr int kRegister = 16;  // floats
#elif defined(__AVX__)
constexpr int kRegister = 8;
#else
constexpr int kRegister = 4;
#endif

// N floats in as many registers as they need. Compilers do not split larger vectors into registers by themselves, but
// into single floats.
template <int N>
struct Wide {
  static constexpr int kLanes = N < kRegister ? N : kRegister;
  static constexpr int kParts = N / kLanes;
  typedef float Part __attribute__((vector_size(kLanes * sizeof(float))));
  typedef std::int32_t Mask __attribute__((vector_size(kLanes * sizeof(float))));

  Part part[kParts];

  Wide() = default;
  Wide(float value) {  // NOLINT(google-explicit-constructor): a number is the same in every lane
    for (Part& p : part) p = Part{} + value;
  }

  static Wide at(const float* from) {
    Wide loaded;
    std::memcpy(loaded.part, from, sizeof(part));
    return loaded;
  }

  float operator[](int lane) const { return part[lane / kLanes][lane % kLanes]; }
  void set(int lane, float value) { part[lane / kLanes][lane % kLanes] = value; }
};

template <int N>
struct WideMask {
  typename Wide<N>::Mask part[Wide<N>::kParts];
};

#define FIRSTFIX_WIDE_OPERATOR(result, name, expression)                       \
  template <int N>                                                             \
  inline result<N> name(const Wide<N>& a, const Wide<N>& b) {                  \
    result<N> c;                                                               \
    for (int i = 0; i < Wide<N>::kParts; ++i) c.part[i] = expression;          \
    return c;                                                                  \
  }
FIRSTFIX_WIDE_OPERATOR(Wide, operator+, a.part[i] + b.part[i])
FIRSTFIX_WIDE_OPERATOR(Wide, operator-, a.part[i] - b.part[i])
FIRSTFIX_WIDE_OPERATOR(Wide, operator*, a.part[i] * b.part[i])
FIRSTFIX_WIDE_OPERATOR(Wide, operator/, a.part[i] / b.part[i])
// the second operand where the first is not a number
FIRSTFIX_WIDE_OPERATOR(Wide, least, a.part[i] < b.part[i] ? a.part[i] : b.part[i])
FIRSTFIX_WIDE_OPERATOR(Wide, most, a.part[i] > b.part[i] ? a.part[i] : b.part[i])
FIRSTFIX_WIDE_OPERATOR(WideMask, operator<, a.part[i] < b.part[i])
FIRSTFIX_WIDE_OPERATOR(WideMask, operator<=, a.part[i] <= b.part[i])
#undef FIRSTFIX_WIDE_OPERATOR

template <int N>
inline WideMask<N> operator&(const WideMask<N>& a, const WideMask<N>& b) {
  WideMask<N> c;
  for (int i = 0; i < Wide<N>::kParts; ++i) c.part[i] = a.part[i] & b.part[i];
  return c;
}

template <int N>
inline WideMask<N> operator|(const WideMask<N>& a, const WideMask<N>& b) {
  WideMask<N> c;
  for (int i = 0; i < Wide<N>::kParts; ++i) c.part[i] = a.part[i] | b.part[i];
  return c;
}

template <int N>
inline Wide<N> choose(const WideMask<N>& mask, const Wide<N>& yes, const Wide<N>& no) {
  Wide<N> c;
  for (int i = 0; i < Wide<N>::kParts; ++i) c.part[i] = mask.part[i] ? yes.part[i] : no.part[i];
  return c;
}

template <int N>
inline float least_of(const Wide<N>& values) {
  float lanes[N];
  std::memcpy(lanes, &values, sizeof(lanes));
  for (int width = N / 2; width; width /= 2) {
    for (int i = 0; i < width; ++i) lanes[i] = lanes[i] < lanes[i + width] ? lanes[i] : lanes[i + width];
  }
  return lanes[0];
}

template <int N>
inline float most_of(const Wide<N>& values) {
  return -least_of(Wide<N>(0) - values);
}

// One bit for each lane whose mask is set.
template <int N>
inline std::uint32_t bits_of(const WideMask<N>& mask) {
  std::uint32_t bits = 0;
  for (int i = 0; i < Wide<N>::kParts; ++i) {
    const auto& part = mask.part[i];
    std::uint32_t few = 0;
#if defined(__AVX512DQ__)
    if constexpr (sizeof(part) == 64) few = _cvtmask16_u32(_mm512_movepi32_mask(reinterpret_cast<__m512i>(part)));
#endif
#if defined(__AVX__)
    if constexpr (sizeof(part) == 32) {
      few = static_cast<std::uint32_t>(_mm256_movemask_ps(reinterpret_cast<__m256>(part)));
    }
#endif
#if defined(__SSE2__)
    if constexpr (sizeof(part) == 16) few = static_cast<std::uint32_t>(_mm_movemask_ps(reinterpret_cast<__m128>(part)));
#else
    for (int lane = 0; lane < Wide<N>::kLanes; ++lane) few |= static_cast<std::uint32_t>(part[lane] & 1) << lane;
#endif
    bits |= few << i * Wide<N>::kLanes;
  }
  return bits;
}

using F8 = Wide<8>;
using F16 = Wide<16>;

}  // namespace firstfix::detail
