// The nearest keys of many queries at once, each in some lists of keys. A list is read once for all that search it.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/lanes.hpp"

namespace firstfix {

// Keys list after list: list i holds those from `start[i]` to `start[i + 1]`, fewer than 2^32 in all.
struct KeyLists {
  const float* keys;  // (n, numbers)
  std::size_t numbers;
  const std::int64_t* start;  // (count + 1)
  std::size_t count;
};

namespace detail {

// The keys with the least (distance, number) of all that it is given.
class NearestKeys {
 public:
  explicit NearestKeys(std::size_t most) : most_(most) {}

  float limit() const { return limit_; }

  void add(float distance, std::uint32_t key) {
    found_.emplace_back(distance, key);
    if (found_.size() == 2 * most_) keep();
  }

  // Numbers of keys, nearest first; -1 where there are no more.
  void write(std::int64_t* keys) {
    std::sort(found_.begin(), found_.end());
    for (std::size_t i = 0; i < most_; ++i) keys[i] = i < found_.size() ? std::int64_t{found_[i].second} : -1;
  }

 private:
  void keep() {
    const auto last = found_.begin() + static_cast<std::ptrdiff_t>(most_ - 1);
    std::nth_element(found_.begin(), last, found_.end());
    limit_ = last->first;
    found_.resize(most_);
  }

  std::size_t most_;
  float limit_ = std::numeric_limits<float>::infinity();
  std::vector<std::pair<float, std::uint32_t>> found_;
};

// As many keys as two vectors have lanes, number by number. Each lane sums for itself, so their count changes no sum.
class KeyTile {
 public:
  static constexpr std::size_t kKeys = 2 * kFloatLanes, kQueries = 4;

  explicit KeyTile(std::size_t numbers) : numbers_(numbers), side_by_side_(numbers * kKeys) {}

  // Takes up to kKeys keys.
  void load(const float* keys, std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t k = 0; k < numbers_; ++k) side_by_side_[kKeys * k + i] = keys[numbers_ * i + k];
    }
    FloatLanes low{}, high{};
    for (std::size_t k = 0; k < numbers_; ++k) {
      const FloatLanes a = load_lanes(&side_by_side_[kKeys * k]), b = load_lanes(&side_by_side_[kKeys * k + kFloatLanes]);
      low += a * a;
      high += b * b;
    }
    low_half_square_ = low / 2;
    high_half_square_ = high / 2;
  }

  // For each query and key half of the squared distance, less half of the query's square.
  void compare(const float* const (&query)[kQueries], FloatLanes (&low)[kQueries], FloatLanes (&high)[kQueries]) const {
    const float *q0 = query[0], *q1 = query[1], *q2 = query[2], *q3 = query[3];
    FloatLanes a0{}, a1{}, a2{}, a3{}, b0{}, b1{}, b2{}, b3{};  // by name: arrays would not stay in registers
    for (std::size_t k = 0; k < numbers_; ++k) {
      const FloatLanes a = load_lanes(&side_by_side_[kKeys * k]), b = load_lanes(&side_by_side_[kKeys * k + kFloatLanes]);
      a0 += a * q0[k], b0 += b * q0[k];
      a1 += a * q1[k], b1 += b * q1[k];
      a2 += a * q2[k], b2 += b * q2[k];
      a3 += a * q3[k], b3 += b * q3[k];
    }
    low[0] = low_half_square_ - a0, low[1] = low_half_square_ - a1;
    low[2] = low_half_square_ - a2, low[3] = low_half_square_ - a3;
    high[0] = high_half_square_ - b0, high[1] = high_half_square_ - b1;
    high[2] = high_half_square_ - b2, high[3] = high_half_square_ - b3;
  }

 private:
  std::size_t numbers_;
  std::vector<float> side_by_side_;
  FloatLanes low_half_square_{}, high_half_square_{};
};

}  // namespace detail

// queries: (count, numbers). probed: (count, probes) numbers of the lists that each one searches, all different. found:
// (count, most) numbers of keys, nearest first, of equal ones the lower first; -1 where there are no more.
inline void nearest_in_lists(const KeyLists& lists, const float* queries, std::size_t count, const std::int64_t* probed,
                             std::size_t probes, std::size_t most, std::int64_t* found) {
  using detail::FloatLanes, detail::kFloatLanes, detail::KeyTile;
  std::vector<std::size_t> begin(lists.count + 2), asking(count * probes);  // queries, list by list
  for (std::size_t i = 0; i < asking.size(); ++i) ++begin[static_cast<std::size_t>(probed[i]) + 2];
  for (std::size_t list = 2; list < begin.size(); ++list) begin[list] += begin[list - 1];
  for (std::size_t i = 0; i < asking.size(); ++i) asking[begin[static_cast<std::size_t>(probed[i]) + 1]++] = i / probes;
  std::vector<detail::NearestKeys> nearest(count, detail::NearestKeys(most));
  KeyTile tile(lists.numbers);
  for (std::size_t list = 0; list < lists.count; ++list) {
    if (begin[list] == begin[list + 1]) continue;
    const auto end = static_cast<std::size_t>(lists.start[list + 1]);
    for (auto first = static_cast<std::size_t>(lists.start[list]); first < end; first += KeyTile::kKeys) {
      const std::size_t keys = std::min(KeyTile::kKeys, end - first);
      tile.load(lists.keys + first * lists.numbers, keys);
      for (std::size_t at = begin[list]; at < begin[list + 1]; at += KeyTile::kQueries) {
        const std::size_t some = std::min(KeyTile::kQueries, begin[list + 1] - at);
        const float* query[KeyTile::kQueries];
        for (std::size_t q = 0; q < KeyTile::kQueries; ++q) {
          query[q] = queries + asking[at + std::min(q, some - 1)] * lists.numbers;
        }
        FloatLanes low[KeyTile::kQueries], high[KeyTile::kQueries];
        tile.compare(query, low, high);
        for (std::size_t q = 0; q < some; ++q) {
          detail::NearestKeys& best = nearest[asking[at + q]];
          const FloatLanes limit = detail::all_lanes(best.limit());
          if (detail::all_bits((low[q] <= limit) | (high[q] <= limit)) == 0) continue;
          for (std::size_t i = 0; i < keys; ++i) {
            const float away = i < kFloatLanes ? low[q][i] : high[q][i - kFloatLanes];
            if (away <= best.limit()) best.add(away, static_cast<std::uint32_t>(first + i));
          }
        }
      }
    }
  }
  for (std::size_t i = 0; i < count; ++i) nearest[i].write(found + i * most);
}

}  // namespace firstfix
