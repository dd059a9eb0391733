// Many numbers in step: the compiler's vector types, whose results are the same for every instruction set. Three kinds:
// as many lanes as a register has, for sums that do not depend on their number; always eight, for sums over the lanes;
// and N floats in as many registers as they need. What a robot runs too is written as plain loops.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

#if defined(__AVX512F__)
#include <immintrin.h>
#endif

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

inline FloatLanes root_lanes(FloatLanes of) {
  float roots[kFloatLanes];
  store_lanes(roots, of);
  for (float& root : roots) root = std::sqrt(root);
  return load_lanes(roots);
}

// All the bits that are set in some of a vector's 64-bit words.
template <class Lanes>
std::uint64_t joined(const Lanes& lanes) {
  typedef std::uint64_t Words __attribute__((vector_size(16)));
  Words quarters[sizeof lanes / 16];
  std::memcpy(quarters, &lanes, sizeof lanes);
  for (std::size_t i = 1; i < sizeof lanes / 16; ++i) quarters[0] |= quarters[i];
  return quarters[0][0] | quarters[0][1];
}

// The bits that are set in some lane.
inline std::uint32_t all_bits(IntLanes lanes) {
  const std::uint64_t both = joined(lanes);
  return static_cast<std::uint32_t>(both | both >> 32);
}

// N floats in as many registers as they need. Compilers do not split larger vectors into registers by themselves, but
// into single floats.
template <int N>
struct Wide {
  static constexpr int kLanes = N < static_cast<int>(kFloatLanes) ? N : static_cast<int>(kFloatLanes);
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
inline Wide<N> root(const Wide<N>& of) {
  Wide<N> roots;
  for (int i = 0; i < Wide<N>::kParts; ++i) {
    for (int lane = 0; lane < Wide<N>::kLanes; ++lane) roots.part[i][lane] = std::sqrt(of.part[i][lane]);
  }
  return roots;
}

template <int N>
inline float least_of(const Wide<N>& values) {
  typedef float Quarter __attribute__((vector_size(16)));
  Quarter least[N / 4];
  std::memcpy(least, &values, sizeof least);
  for (int half = N / 8; half; half /= 2) {
    for (int i = 0; i < half; ++i) least[i] = least[i] < least[i + half] ? least[i] : least[i + half];
  }
  const float even = least[0][0] < least[0][2] ? least[0][0] : least[0][2];
  const float odd = least[0][1] < least[0][3] ? least[0][1] : least[0][3];
  return even < odd ? even : odd;
}

template <int N>
inline float most_of(const Wide<N>& values) {
  return -least_of(Wide<N>(0) - values);
}

inline float most_of_lanes(FloatLanes values) {
  Wide<kFloatLanes> wide;
  wide.part[0] = values;
  return most_of(wide);
}

// The sum of all lanes: halves are added until one is left.
template <int N>
inline float sum_of(const Wide<N>& values) {
  typedef float Quarter __attribute__((vector_size(16)));
  Quarter sum[N / 4];
  std::memcpy(sum, &values, sizeof sum);
  for (int half = N / 8; half; half /= 2) {
    for (int i = 0; i < half; ++i) sum[i] += sum[i + half];
  }
  return (sum[0][0] + sum[0][2]) + (sum[0][1] + sum[0][3]);
}

// One bit for each lane whose mask is set.
template <int N>
inline std::uint32_t bits_of(const WideMask<N>& mask) {
#if defined(__AVX512DQ__)
  if constexpr (N == 16) return static_cast<std::uint32_t>(_mm512_movepi32_mask(reinterpret_cast<__m512i>(mask.part[0])));
#endif
#if defined(__AVX512DQ__) && defined(__AVX512VL__)
  if constexpr (N == 8) return static_cast<std::uint32_t>(_mm256_movepi32_mask(reinterpret_cast<__m256i>(mask.part[0])));
#endif
  static constexpr std::int32_t kBits[16] = {1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192, 16384, 32768};
  WideMask<N> bits;
  std::memcpy(&bits, kBits, sizeof bits);
  for (int i = 0; i < Wide<N>::kParts; ++i) bits.part[i] &= mask.part[i];
  for (int i = 1; i < Wide<N>::kParts; ++i) bits.part[0] |= bits.part[i];
  const std::uint64_t both = joined(bits.part[0]);
  return static_cast<std::uint32_t>(both | both >> 32);
}

using F8 = Wide<8>;
using F16 = Wide<16>;

}  // namespace firstfix::detail

namespace firstfix {

// The width is fixed by the source, not by the processor: sums over the lanes have one order.
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

inline Float8 root_of(const Float8& of) {
  float roots[kLanes];
  store8(of, roots);
  for (float& root : roots) root = std::sqrt(root);
  return load8(roots);
}

// Eight vectors, x y z x y z, coordinate by coordinate. No two of a coordinate's numbers stand in the same lane of the three
// registers: so each is put together first, and its lanes are sorted then.
inline void split8(const float* vectors, Float8& x, Float8& y, Float8& z) {
  const Float8 a = load8(vectors), b = load8(vectors + kLanes), c = load8(vectors + 2 * kLanes);
  const Int8 first{-1, 0, 0, -1, 0, 0, -1, 0}, second{0, -1, 0, 0, -1, 0, 0, -1}, third{0, 0, -1, 0, 0, -1, 0, 0};
  const Float8 of_x = first ? a : second ? b : c, of_y = second ? a : third ? b : c, of_z = third ? a : first ? b : c;
  x = Float8{of_x[0], of_x[3], of_x[6], of_x[1], of_x[4], of_x[7], of_x[2], of_x[5]};
  y = Float8{of_y[1], of_y[4], of_y[7], of_y[2], of_y[5], of_y[0], of_y[3], of_y[6]};
  z = Float8{of_z[2], of_z[5], of_z[0], of_z[3], of_z[6], of_z[1], of_z[4], of_z[7]};
}

// Whether any lane of a comparison holds.
inline bool any(const Int8& mask) { return detail::joined(mask) != 0; }

// Appends to N lists of `count` numbers the first `lanes` of N vectors, where the mask is set. Returns the new count. The
// lists have room for eight numbers more.
template <std::size_t N>
std::size_t append8(const Int8& mask, std::size_t lanes, const Int8 (&values)[N], std::int32_t* const (&to)[N], std::size_t count) {
#if defined(__AVX512DQ__) && defined(__AVX512VL__)
  const unsigned first = (1U << lanes) - 1, taken = _mm256_movepi32_mask(reinterpret_cast<__m256i>(mask)) & first;
  for (std::size_t k = 0; k < N; ++k) {  // compressed in a register: some processors take long to do it on the way to memory
    const __m256i kept = _mm256_maskz_compress_epi32(static_cast<__mmask8>(taken), reinterpret_cast<__m256i>(values[k]));
    _mm256_storeu_si256(reinterpret_cast<__m256i*>(to[k] + count), kept);
  }
  return count + static_cast<std::size_t>(__builtin_popcount(taken));
#else
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    for (std::size_t k = 0; k < N; ++k) to[k][count] = values[k][lane];
    count += static_cast<std::size_t>((mask[lane] != 0) & (lane < lanes));
  }
  return count;
#endif
}

inline double sum(const Float8& lanes) {
  double total = 0;
  for (std::size_t lane = 0; lane < kLanes; ++lane) total += static_cast<double>(lanes[lane]);
  return total;
}

inline std::size_t padded(std::size_t count) { return (count + kLanes - 1) / kLanes * kLanes; }

}  // namespace firstfix
