// Keys of layered occupancy: spectra of its rings (docs/method.md, 3.2). Equal to firstfix.descriptor.ring_spectra
// within float rounding.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/descriptor/bit_string.hpp"
#include "firstfix/bit_exact/atan2.hpp"

namespace firstfix {

class RingSpectra {
 public:
  // rings: of all layers.
  RingSpectra(std::size_t rings, std::size_t sectors, std::size_t coefficients)
      : rings_(rings),
        sectors_(sectors),
        coefficients_(std::min(coefficients, sectors / 2 + 1)),
        width_((2 * coefficients_ + kChunk - 1) / kChunk * kChunk),
        table_(sectors * width_),
        sums_(width_) {
    std::vector<double> cosine(sectors), sine(sectors);
    for (std::size_t s = 0; s < sectors; ++s) {
      const double angle = 2 * detail::kPi * static_cast<double>(s) / static_cast<double>(sectors);
      cosine[s] = std::cos(angle), sine[s] = std::sin(angle);
    }
    for (std::size_t s = 0; s < sectors; ++s) {
      double* row = &table_[s * width_];
      for (std::size_t m = 0; m < coefficients_; ++m) {
        row[m] = cosine[m * s % sectors], row[coefficients_ + m] = sine[m * s % sectors];
      }
    }
  }

  std::size_t size() const { return rings_ * coefficients_; }

  // The key of one scan, of unit length: (size(),).
  void key(const std::uint8_t* occupancy, std::size_t bytes, float* key) {
    const detail::BitString bits{occupancy, bytes};
    const float root = static_cast<float>(std::sqrt(2.0));  // Parseval: these coefficients count twice
    double squares = 0;
    for (std::size_t ring = 0; ring < rings_; ++ring) {
      add_up(bits, ring * sectors_);
      float* spectrum = key + ring * coefficients_;
      for (std::size_t m = 0; m < coefficients_; ++m) {
        const double re = sums_[m], im = sums_[coefficients_ + m];
        spectrum[m] = static_cast<float>(std::sqrt(re * re + im * im)) * (m == 0 ? 1.0F : root);
        squares += static_cast<double>(spectrum[m]) * static_cast<double>(spectrum[m]);
      }
    }
    const float length = std::max(static_cast<float>(std::sqrt(squares)), 1e-9F);
    for (std::size_t i = 0; i < size(); ++i) key[i] /= length;
  }

 private:
  // Adds up the table's rows of the sectors that are filled, in their order.
  void add_up(const detail::BitString& bits, std::size_t first) {
    filled_.clear();
    for (std::size_t sector = 0; sector < sectors_; sector += detail::kWordBits) {
      std::uint64_t word = bits.word_at(first + sector, std::min(detail::kWordBits, sectors_ - sector));
      while (word != 0) {
        const auto lead = static_cast<std::size_t>(__builtin_clzll(word));
        word ^= (std::uint64_t{1} << 63) >> lead;
        filled_.push_back(sector + lead);
      }
    }
    for (std::size_t start = 0; start < width_; start += kChunk) {
      std::array<double, kChunk> sums{};
      for (const std::size_t filled : filled_) {
        const double* row = &table_[filled * width_ + start];
        for (std::size_t i = 0; i < kChunk; ++i) sums[i] += row[i];
      }
      std::copy(sums.begin(), sums.end(), &sums_[start]);
    }
  }

  static constexpr std::size_t kChunk = 8;  // sums that fit into registers

  std::size_t rings_, sectors_, coefficients_, width_;
  std::vector<double> table_;  // (sectors, width): cosines, sines, zeros
  std::vector<double> sums_;   // (width)
  std::vector<std::size_t> filled_;
};

}  // namespace firstfix
