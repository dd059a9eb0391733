// Comparison of one occupancy with many at every shift of the sectors (docs/method.md, 3.3). Equal to
// firstfix.descriptor.best_shifts to the last bit.
//
// The templates lie side by side, one in each lane of a vector, and bit s of a word stands for the shift s. A filled
// cell of the query in sector j adds the template's ring, turned by j, to the counts of all shifts at once. The counts
// are kept as bit planes: one of them holds the lowest bit of every shift's count, the next one the second, and so on.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "firstfix/descriptor/bit_string.hpp"
#include "firstfix/bit_exact/lanes.hpp"

namespace firstfix {

class BestShifts {
 public:
  // query: one occupancy of so many bytes. rings: of all layers.
  BestShifts(const std::uint8_t* query, std::size_t bytes, std::size_t rings, std::size_t sectors)
      : bytes_(bytes), rings_(rings), sectors_(sectors), words_((sectors + 63) / 64), doubled_(2 * words_) {
    const detail::BitString bits{query, bytes};
    for (std::size_t ring = 0; ring < rings; ++ring) {
      const std::size_t before = cells_.size();
      for (std::size_t sector = 0; sector < sectors; sector += detail::kWordBits) {
        std::uint64_t word = bits.word_at(ring * sectors + sector, std::min(detail::kWordBits, sectors - sector));
        while (word != 0) {
          const auto lead = static_cast<std::size_t>(__builtin_clzll(word));
          word ^= (std::uint64_t{1} << 63) >> lead;
          const std::size_t at = used_.size() * doubled_ + sector / 64;
          cells_.push_back({static_cast<std::uint32_t>(at), static_cast<std::uint32_t>(lead),
                            static_cast<std::uint32_t>(63 - lead)});
        }
      }
      if (cells_.size() > before) used_.push_back(ring);
    }
    while (cells_.size() >> planes_ != 0) ++planes_;
    left_.resize(used_.size() * doubled_);
    right_.resize(used_.size() * doubled_);
    counts_.resize(words_ * planes_);
  }

  // The best shift of each of `count` templates, the smallest of equally good ones, and its score, 0..1.
  // rows: of the templates, (n, bytes).
  void compare(const std::uint8_t* templates, const std::int64_t* rows, std::size_t count, std::int64_t* shift,
               float* score) {
    for (std::size_t first = 0; first < count; first += detail::kWordLanes) {
      const std::size_t lanes = std::min(detail::kWordLanes, count - first);
      std::array<detail::BitString, detail::kWordLanes> group;
      for (std::size_t lane = 0; lane < detail::kWordLanes; ++lane) {
        group[lane] = {templates + static_cast<std::size_t>(rows[first + std::min(lane, lanes - 1)]) * bytes_, bytes_};
      }
      lay_out(group);
      for (std::size_t next = first + lanes; next < std::min(first + lanes + detail::kWordLanes, count); ++next) {
        fetch(templates + static_cast<std::size_t>(rows[next]) * bytes_);
      }
      for (std::size_t word = 0; word < words_; ++word) count_shared(word);
      const WordLanes most = keep_best();
      for (std::size_t lane = 0; lane < lanes; ++lane) {
        const auto shared = static_cast<float>(most[lane]), asked = static_cast<float>(cells_.size()),
                   filled = static_cast<float>(group[lane].ones(rings_ * sectors_));
        shift[first + lane] = first_left(lane);
        score[first + lane] = shared / std::max(std::sqrt(asked * filled), 1.0F);
      }
    }
  }

 private:
  using WordLanes = detail::WordLanes;

  struct Cell {
    std::uint32_t at;           // of the words in which the ring turned by this sector begins
    std::uint32_t left, right;  // shifts of these words
  };

  struct Sum {
    WordLanes bit, carry;
  };

  static Sum add(WordLanes a, WordLanes b, WordLanes c) {
    const WordLanes differ = a ^ b;
    return {differ ^ c, (a & b) | (differ & c)};
  }

  // Asks for a template's bytes, which come from memory while the templates before it are compared.
  void fetch(const std::uint8_t* bits) const {
    for (std::size_t byte = 0; byte < bytes_; byte += 64) __builtin_prefetch(bits + byte);
  }

  // The same bits of each of the templates, as of BitString::word_at: where they lie is reckoned once for all of them.
  WordLanes words_at(const std::array<detail::BitString, detail::kWordLanes>& group, std::size_t first, std::size_t count) const {
    const std::size_t byte = first / 8, off = first % 8;
    std::uint64_t words[detail::kWordLanes];
    WordLanes found;
    if (byte + 9 > bytes_) {
      for (std::size_t lane = 0; lane < detail::kWordLanes; ++lane) words[lane] = group[lane].word_at(first, count);
      std::memcpy(&found, words, sizeof found);
      return found;
    }
    for (std::size_t lane = 0; lane < detail::kWordLanes; ++lane) words[lane] = detail::big_endian(group[lane].data + byte);
    std::memcpy(&found, words, sizeof found);
    found <<= off;
    if (off + count > detail::kWordBits) {
      WordLanes rest;
      for (std::size_t lane = 0; lane < detail::kWordLanes; ++lane) words[lane] = group[lane].data[byte + 8];
      std::memcpy(&rest, words, sizeof rest);
      found |= rest >> (8 - off);
    }
    return found & detail::highest(count);
  }

  // The rings that the query uses, each twice in a row, so that every turn of it can be read from there.
  void lay_out(const std::array<detail::BitString, detail::kWordLanes>& group) {
    for (std::size_t ring = 0; ring < used_.size(); ++ring) {
      for (std::size_t word = 0; word < words_; ++word) {
        const std::size_t sector = 64 * word, count = std::min(detail::kWordBits, sectors_ - sector);
        left_[ring * doubled_ + word] = words_at(group, used_[ring] * sectors_ + sector, count);
      }
    }
    const std::size_t off = sectors_ % 64, whole = sectors_ / 64;
    for (std::size_t ring = 0; ring < used_.size(); ++ring) {
      WordLanes* left = &left_[ring * doubled_];
      WordLanes* right = &right_[ring * doubled_];
      for (std::size_t word = words_; word < doubled_; ++word) left[word] = WordLanes{};
      for (std::size_t word = words_; word-- > 0;) {  // downwards: a word may receive bits of itself
        const WordLanes once = left[word];
        if (off == 0) {
          left[word + whole] |= once;
        } else {
          left[word + whole + 1] |= once << (64 - off);
          left[word + whole] |= once >> off;
        }
      }
      for (std::size_t word = 0; word + 1 < doubled_; ++word) right[word] = left[word + 1] >> 1;
      right[doubled_ - 1] = WordLanes{};
    }
  }

  // Counts the shared cells at 64 shifts.
  void count_shared(std::size_t word) {
    const WordLanes *left = left_.data() + word, *right = right_.data() + word;
    const auto turned = [left, right](const Cell& cell) {
      return left[cell.at] << cell.left | right[cell.at] >> cell.right;
    };
    WordLanes* counts = counts_.data() + word * planes_;
    std::fill(counts, counts + planes_, WordLanes{});
    WordLanes ones{}, twos{}, fours{}, eights{};
    const Cell* cell = cells_.data();
    const Cell* const end = cell + cells_.size();
    for (; end - cell >= 16; cell += 16) {
      const auto two = [&](const Cell* c) {
        const Sum sum = add(ones, turned(c[0]), turned(c[1]));
        ones = sum.bit;
        return sum.carry;
      };
      const auto four = [&](const Cell* c) {
        const WordLanes a = two(c), b = two(c + 2);
        const Sum sum = add(twos, a, b);
        twos = sum.bit;
        return sum.carry;
      };
      const auto eight = [&](const Cell* c) {
        const WordLanes a = four(c), b = four(c + 4);
        const Sum sum = add(fours, a, b);
        fours = sum.bit;
        return sum.carry;
      };
      const WordLanes a = eight(cell), b = eight(cell + 8);
      const Sum sum = add(eights, a, b);
      eights = sum.bit;
      carry_into(counts, 4, sum.carry);
    }
    const std::array<WordLanes, 4> low{ones, twos, fours, eights};
    for (std::size_t plane = 0; plane < std::min(planes_, low.size()); ++plane) counts[plane] = low[plane];
    for (; cell != end; ++cell) carry_into(counts, 0, turned(*cell));
  }

  void carry_into(WordLanes* counts, std::size_t plane, WordLanes carry) const {
    for (; plane < planes_; ++plane) {
      const WordLanes next = counts[plane] & carry;
      counts[plane] ^= carry;
      carry = next;
    }
  }

  // Leaves in the first plane of every word the shifts with the largest count, and returns that count.
  WordLanes keep_best() {
    best_.assign(words_, ~WordLanes{});
    best_.back() = WordLanes{} + detail::highest(sectors_ - 64 * (words_ - 1));
    WordLanes most{};
    for (std::size_t plane = planes_; plane-- > 0;) {
      WordLanes any{};
      for (std::size_t word = 0; word < words_; ++word) any |= best_[word] & counts_[word * planes_ + plane];
      const WordLanes some = reinterpret_cast<WordLanes>(any != 0);  // all bits of a lane, or none
      for (std::size_t word = 0; word < words_; ++word) {
        best_[word] &= counts_[word * planes_ + plane] | ~some;
      }
      most |= some & (std::uint64_t{1} << plane);
    }
    return most;
  }

  std::int64_t first_left(std::size_t lane) const {
    std::size_t word = 0;
    while (best_[word][lane] == 0) ++word;
    return static_cast<std::int64_t>(64 * word) + __builtin_clzll(best_[word][lane]);
  }

  std::size_t bytes_, rings_, sectors_, words_, doubled_, planes_ = 0;
  std::vector<std::size_t> used_;  // rings with any cell of the query
  std::vector<Cell> cells_;        // of the query
  std::vector<WordLanes> left_, right_;  // (used rings, doubled): words of rings, and the words after them one bit right
  std::vector<WordLanes> counts_;        // (words, planes)
  std::vector<WordLanes> best_;          // (words)
};

}  // namespace firstfix
