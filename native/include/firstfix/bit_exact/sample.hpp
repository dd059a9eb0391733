// Random rows of a list, the same on every machine: equal to firstfix.bit_exact.sample.
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

// Calls `take(i, row)` with ascending rows of a list of `count`: one random row of each of `at_most` equal runs, or all
// rows if there are no more. Taking every k-th row instead would take rows that repeat with the period k, such as the
// beams of a scan, either always or never.
template <class Take>
void for_rows_by_chance(std::uint64_t count, std::uint64_t at_most, const Take& take) {
  if (count <= at_most) {
    for (std::uint64_t i = 0; i < count; ++i) take(i, i);
    return;
  }
  if (at_most == 0) return;
  const std::uint64_t whole = count / at_most, part = count % at_most;  // a run begins at floor(i * count / at_most)
  for (std::uint64_t i = 0, start = 0, rest = 0; i < at_most; ++i) {
    rest += part;
    const std::uint64_t width = whole + (rest >= at_most ? 1 : 0);
    if (rest >= at_most) rest -= at_most;
    take(i, start + (hashed(static_cast<std::uint32_t>(i)) * width >> 32));
    start += width;
  }
}

inline std::vector<std::int64_t> rows_by_chance(std::uint64_t count, std::uint64_t at_most) {
  std::vector<std::int64_t> rows(count <= at_most ? count : at_most);
  for_rows_by_chance(count, at_most, [&](std::uint64_t i, std::uint64_t row) { rows[i] = static_cast<std::int64_t>(row); });
  return rows;
}

}  // namespace firstfix::detail

namespace firstfix {

// Copies the rows of (count, 3) numbers that rows_by_chance chooses; `chosen` has room for at most `at_most` of them.
template <class T>
void chosen_by_chance(const T* points, std::uint64_t count, std::uint64_t at_most, T* chosen) {
  detail::for_rows_by_chance(count, at_most, [&](std::uint64_t i, std::uint64_t row) {
    for (std::size_t axis = 0; axis < 3; ++axis) chosen[3 * i + axis] = points[3 * row + axis];
  });
}

}  // namespace firstfix
