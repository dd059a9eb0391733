// Random rows of a list, the same on every machine: equal to firstfix.portable.sample.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace firstfix::detail {

// A hash of 32 bits: the last steps of MurmurHash3.
inline std::uint32_t hashed(std::uint32_t x) {
  x ^= x >> 16;
  x *= 0x85ebca6bu;
  x ^= x >> 13;
  x *= 0xc2b2ae35u;
  return x ^ (x >> 16);
}

// Ascending rows of a list of `count`: one random row of each of `at_most` equal runs, or all rows if there are no
// more. Taking every k-th row instead would take rows that repeat with the period k, such as the beams of a scan,
// either always or never.
inline std::vector<std::size_t> rows_by_chance(std::size_t count, std::size_t at_most) {
  const bool all = count <= at_most;
  std::vector<std::size_t> rows(all ? count : at_most);
  for (std::uint64_t i = 0; i < rows.size(); ++i) {
    const std::uint64_t start = i * count / at_most, end = (i + 1) * count / at_most;
    rows[i] = all ? i : start + (hashed(static_cast<std::uint32_t>(i)) * (end - start) >> 32);
  }
  return rows;
}

}  // namespace firstfix::detail
