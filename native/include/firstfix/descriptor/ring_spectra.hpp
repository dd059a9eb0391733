// Keys of layered occupancy: spectra of its rings (docs/method.md, 3.2). Equal to firstfix.descriptor.ring_spectra
// within float rounding.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/descriptor/bit_string.hpp"
#include "firstfix/portable/atan2.hpp"

namespace firstfix {

class RingSpectra {
 public:
  // rings: of all layers.
  RingSpectra(std::size_t rings, std::size_t sectors, std::size_t coefficients)
      : rings_(rings),
        sectors_(sectors),
        coefficients_(std::min(coefficients, sectors / 2 + 1)),
        table_(sectors * 2 * coefficients_),
        sums_(2 * coefficients_) {
    std::vector<double> cosine(sectors), sine(sectors);
    for (std::size_t s = 0; s < sectors; ++s) {
      const double angle = 2 * detail::kPi * static_cast<double>(s) / static_cast<double>(sectors);
      cosine[s] = std::cos(angle), sine[s] = std::sin(angle);
    }
    for (std::size_t s = 0; s < sectors; ++s) {
      double* row = &table_[s * 2 * coefficients_];
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
  // Adds up the table's rows of the sectors that are filled.
  void add_up(const detail::BitString& bits, std::size_t first) {
    const std::size_t width = 2 * coefficients_;
    double* sums = sums_.data();
    std::fill(sums, sums + width, 0.0);
    for (std::size_t sector = 0; sector < sectors_; sector += detail::kWordBits) {
      std::uint64_t word = bits.word_at(first + sector, std::min(detail::kWordBits, sectors_ - sector));
      while (word != 0) {
        const auto lead = static_cast<std::size_t>(__builtin_clzll(word));
        word ^= (std::uint64_t{1} << 63) >> lead;
        const double* row = &table_[(sector + lead) * width];
        for (std::size_t i = 0; i < width; ++i) sums[i] += row[i];
      }
    }
  }

  std::size_t rings_, sectors_, coefficients_;
  std::vector<double> table_;  // (sectors, 2, coefficients): cosines, sines
  std::vector<double> sums_;
};

}  // namespace firstfix
