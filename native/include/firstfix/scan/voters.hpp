// Surface normals that vote on the up direction: docs/method.md, (2.1). Sums are in a fixed order, so that the result does
// not depend on the instruction set.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/bit_exact/exp.hpp"
#include "firstfix/bit_exact/sample.hpp"
#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix::detail {

// Normals parallel or at right angles to a direction vote for it.
class Voters {
 public:
  // Unit normals, x y z x y z, of either sign.
  template <class T>
  Voters(const T* normals, std::size_t count)
      : padded_((count + kInStep - 1) / kInStep * kInStep), x_(padded_), y_(padded_), z_(padded_), counts_(padded_) {
    for (std::size_t i = 0; i < count; ++i) {
      x_[i] = static_cast<float>(normals[3 * i]);
      y_[i] = static_cast<float>(normals[3 * i + 1]);
      z_[i] = static_cast<float>(normals[3 * i + 2]);
      counts_[i] = 1;
    }
  }

  double votes_for(const double* direction) const {
    const float whole = exp_of_negative(kScale);
    const auto a = static_cast<float>(direction[0]), b = static_cast<float>(direction[1]), c = static_cast<float>(direction[2]);
    const float *x = x_.data(), *y = y_.data(), *z = z_.data(), *counts = counts_.data();
    float upright[kInStep * kRows];
    double sum[kInStep] = {};
    for (std::size_t start = 0; start < padded_; start += kInStep * kRows) {
      const std::size_t end = std::min(padded_, start + kInStep * kRows);
      // Three short loops: a processor then has many numbers under way at once. In one loop, each number's long chain of
      // operations fills its queue.
      for (std::size_t i = start; i < end; ++i) {
        const float along = x[i] * a + y[i] * b + z[i] * c;
        upright[i - start] = along * along * kScale;
      }
      for (std::size_t i = 0; i < end - start; ++i) upright[i] = exp_of_negative(upright[i]);
      float part[kInStep] = {};
      for (std::size_t i = start; i < end; i += kInStep) {
        for (std::size_t lane = 0; lane < kInStep; ++lane) {
          const float level = whole / upright[i - start + lane];  // exp(s - t) is exp(s) / exp(t)
          part[lane] += (upright[i - start + lane] + level) * counts[i + lane];
        }
      }
      for (std::size_t lane = 0; lane < kInStep; ++lane) sum[lane] += static_cast<double>(part[lane]);
    }
    double won = 0;
    for (const double part : sum) won += part;
    return won;
  }

  // The row of the direction with the most votes, times its weight (0..1); of equal ones the first. Most directions are
  // left out by a bound on their votes, which is cheaper than the votes.
  std::size_t most_voted(const std::vector<Vector3>& directions, const std::vector<double>& weights) const {
    const Bound bound(*this);
    std::size_t best = 0;
    float most_of_some = -1;
    for (std::size_t i = 0; i < directions.size(); ++i) {
      const float some = static_cast<float>(weights[i]) * bound.of_first(directions[i]);
      if (some > most_of_some) best = i, most_of_some = some;
    }
    double most = weights[best] * votes_for(directions[best].data());
    for (std::size_t i = 0; i < directions.size(); ++i) {
      if (i == best || bound.is_below(directions[i], most / weights[i])) continue;
      const double won = weights[i] * votes_for(directions[i].data());
      if (won > most || (won == most && i < best)) best = i, most = won;
    }
    return best;
  }

 private:
  static constexpr std::size_t kInStep = 16, kRows = 8;  // float sums of so many rows, then double
  static constexpr double kWidth = 5.0 * (kPi / 180);
  static constexpr auto kScale = static_cast<float>(-1 / (2 * kWidth * kWidth));

  // An upper bound on the votes for a direction. The voters are asked in random order, until the others, if all of them voted
  // for it, would not be enough.
  class Bound {
   public:
    explicit Bound(const Voters& voters) : x_(voters.x_), y_(voters.y_), z_(voters.z_) {
      for (std::size_t i = x_.size(); i > 1; --i) {
        const std::size_t other = std::uint64_t{hashed(static_cast<std::uint32_t>(i))} * i >> 32;
        for (std::vector<float>* axis : {&x_, &y_, &z_}) std::swap((*axis)[i - 1], (*axis)[other]);
      }
      padding_ = static_cast<float>(std::count(voters.counts_.begin(), voters.counts_.end(), 0.0F));
    }

    // Votes of the first voters.
    float of_first(const Vector3& direction) const { return among(direction, 0, std::min(kBlock, x_.size())); }

    bool is_below(const Vector3& direction, double votes) const {
      constexpr float kRounding = 1.001F;
      const float wanted = static_cast<float>(votes) + padding_;  // a voter of the padding votes for all directions
      float sum = 0;
      for (std::size_t start = 0; start < x_.size(); start += kBlock) {
        const std::size_t end = std::min(x_.size(), start + kBlock);
        sum += among(direction, start, end);
        if ((sum + static_cast<float>(x_.size() - end)) * kRounding < wanted) return true;
      }
      return false;
    }

   private:
    static constexpr std::size_t kBlock = 256;

    // Not less than the votes of some voters. An exponential is not above the line between powers of two, which has the same
    // bits as a number of fixed point.
    float among(const Vector3& direction, std::size_t start, std::size_t end) const {
      constexpr float kStepsAnOctave = 8388608.0F, kOctaves = kScale * 1.44269504F, kOne = 127.0F * kStepsAnOctave;
      const auto a = static_cast<float>(direction[0]), b = static_cast<float>(direction[1]), c = static_cast<float>(direction[2]);
      const float *x = x_.data(), *y = y_.data(), *z = z_.data();
      float part[kInStep] = {};
      for (std::size_t i = start; i < end; i += kInStep) {
        for (std::size_t lane = 0; lane < kInStep; ++lane) {
          const float along = x[i + lane] * a + y[i + lane] * b + z[i + lane] * c, along2 = along * along;
          // upright or level: of the two votes, one is as good as 0
          const float off = along2 < 0.5F ? along2 : along2 < 1.0F ? 1.0F - along2 : 0.0F;
          const auto bits = static_cast<std::int32_t>(off * (kOctaves * kStepsAnOctave) + kOne);
          float vote;
          std::memcpy(&vote, &bits, sizeof vote);
          part[lane] += vote;
        }
      }
      float sum = 0;
      for (const float one : part) sum += one;
      return sum;
    }

    std::vector<float> x_, y_, z_;
    float padding_ = 0;
  };

  std::size_t padded_;
  std::vector<float> x_, y_, z_, counts_;
};

}  // namespace firstfix::detail
