// Vectors of the processor's width. Integers alone: a result must not depend on the width.
#pragma once

#include <cstddef>
#include <cstdint>

namespace firstfix::detail {

#if defined(__AVX512F__)
constexpr std::size_t kVectorBytes = 64;
#elif defined(__AVX2__)
constexpr std::size_t kVectorBytes = 32;
#else
constexpr std::size_t kVectorBytes = 16;
#endif

constexpr std::size_t kLanes = kVectorBytes / 8;

using Words = std::uint64_t __attribute__((vector_size(kVectorBytes)));

}  // namespace firstfix::detail
