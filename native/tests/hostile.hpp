// Random input of the kind that nobody should send.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <iterator>
#include <limits>
#include <random>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix::tests {

inline Vectors<const float> vectors_of(const std::vector<float>& numbers) { return {numbers.data(), numbers.size() / 3}; }

class Hostile {
 public:
  explicit Hostile(std::uint64_t seed) : random_(seed) {}

  // A whole number from `least` to `most`.
  std::int64_t number(std::int64_t least, std::int64_t most) {
    return std::uniform_int_distribution<std::int64_t>(least, most)(random_);
  }

  bool chance(double share) { return std::uniform_real_distribution<double>()(random_) < share; }

  // A number within a range, or now and then one that is huge, tiny, or none.
  double real(double reach, double wrong = 0.02) {
    static constexpr double kWrong[] = {std::numeric_limits<double>::quiet_NaN(),
                                        std::numeric_limits<double>::infinity(),
                                        -std::numeric_limits<double>::infinity(),
                                        1e300, -1e300, 3e38, -3e38, 2147483648.0, -2147483649.0, 1e-310, 0.0};
    if (chance(wrong)) return kWrong[number(0, std::size(kWrong) - 1)];
    return std::uniform_real_distribution<double>(-reach, reach)(random_);
  }

  std::vector<float> floats(std::size_t count, double reach, double wrong = 0.02) {
    std::vector<float> values(count);
    for (float& value : values) {
      const double any = real(reach, wrong);
      value = any > 3.4e38 ? std::numeric_limits<float>::infinity()
                           : any < -3.4e38 ? -std::numeric_limits<float>::infinity() : static_cast<float>(any);
    }
    return values;
  }

  // Entries of a table that should point into another with `count` rows.
  std::vector<std::int32_t> pointers(std::size_t size, std::int64_t count, double wrong) {
    std::vector<std::int32_t> values(size);
    for (std::int32_t& value : values) {
      const bool is_wrong = chance(wrong);
      value = static_cast<std::int32_t>(is_wrong ? number(std::numeric_limits<std::int32_t>::min(),
                                                          std::numeric_limits<std::int32_t>::max())
                                                 : number(-1, count));
    }
    return values;
  }

 private:
  std::mt19937_64 random_;
};

// Ends the program where a result is not as it must be.
inline void expect(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "failed: %s\n", what);
  std::exit(1);
}

}  // namespace firstfix::tests
