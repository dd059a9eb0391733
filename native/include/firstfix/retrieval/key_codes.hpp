// Keys with 8 bits a number as FAISS writes them (QT_8bit), and the nearest of them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "firstfix/bit_exact/lanes.hpp"

namespace firstfix {

// A code c of number k stands for lowest[k] + (c + 0.5) / 255 * range[k].
struct KeyCodes {
  const std::uint8_t* codes = nullptr;  // (count, numbers)
  std::size_t count = 0, numbers = 0;  // fewer than 2^32 keys
  const float* lowest = nullptr;  // (numbers)
  const float* range = nullptr;   // (numbers)
};

// Squared distances of keys from one key. FAISS adds up in another order, so its distances may differ in their last digits.
class DistancesFrom {
 public:
  // key: (numbers).
  DistancesFrom(const KeyCodes& keys, const float* key)
      : keys_(keys), above_(keys.numbers + kInStep), step_(above_.size()), codes_(above_.size()) {
    for (std::size_t k = 0; k < keys.numbers; ++k) {
      step_[k] = keys.range[k] / 255.0F;
      above_[k] = key[k] - (keys.lowest[k] + 0.5F * step_[k]);
    }
  }

  float to(std::size_t row) {
    const std::uint8_t* codes = keys_.codes + row * keys_.numbers;
    // loops of floats alone, and a loop of their own for the bytes: others are compiled number by number
    for (std::size_t k = 0; k < keys_.numbers; ++k) codes_[k] = static_cast<float>(codes[k]);
    const float *above = above_.data(), *step = step_.data(), *code = codes_.data();
    float sum[kInStep] = {};
    for (std::size_t k = 0; k < keys_.numbers; k += kInStep) {
      for (std::size_t lane = 0; lane < kInStep; ++lane) {
        const float away = above[k + lane] - step[k + lane] * code[k + lane];
        sum[lane] += away * away;
      }
    }
    return detail::sum_of(detail::F16::at(sum));
  }

 private:
  static constexpr std::size_t kInStep = 16;  // whatever the processor has: a sum has one order

  KeyCodes keys_;
  std::vector<float> above_, step_, codes_;  // with room for the last step, whose rest is 0
};

// Rows, ascending, of the `most` keys nearest to a key; of equally near ones the lower rows. among: only these rows.
inline std::vector<std::int64_t> nearest_keys(const KeyCodes& keys, const float* key, std::size_t most,
                                              const std::vector<std::int64_t>* among = nullptr) {
  DistancesFrom distances(keys, key);
  std::vector<std::uint64_t> found(among == nullptr ? keys.count : among->size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    const std::size_t row = among == nullptr ? i : static_cast<std::size_t>((*among)[i]);
    const float away = distances.to(row);
    std::uint32_t bits;  // those of numbers from 0 on have their order
    std::memcpy(&bits, &away, sizeof bits);
    found[i] = std::uint64_t{bits} << 32 | row;
  }
  if (most < found.size()) {
    std::nth_element(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(most), found.end());
    found.resize(most);
  }
  std::vector<std::int64_t> rows(found.size());
  const auto row_of = [](std::uint64_t one) { return static_cast<std::int64_t>(one & 0xffffffffU); };
  std::transform(found.begin(), found.end(), rows.begin(), row_of);
  std::sort(rows.begin(), rows.end());
  return rows;
}

}  // namespace firstfix
