// For each template the places elsewhere in the map that look most like its own.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"

namespace firstfix {

// A template that has an alias, and how the two compare.
struct TemplateAlias {
  std::int64_t own, alias;  // rows of the templates
  double yaw_rad;           // of the template's scan in the alias's frame
  double score;             // 0..1
};

// Aliases of templates, at most `each` for each, most similar first: (templates, each).
struct AliasTable {
  const std::int32_t* row = nullptr;    // negative where there are no more
  const std::uint8_t* turn = nullptr;   // heading in the alias at which it looks like the template, in 1/256 of a turn
  const std::uint8_t* score = nullptr;  // in 1/255
  std::size_t templates = 0, each = 0;

  // Throws std::invalid_argument where a row is of no template.
  void check() const {
    const auto is_row = [this](std::int32_t one) { return one < 0 || static_cast<std::size_t>(one) < templates; };
    if (!std::all_of(row, row + templates * each, is_row)) throw std::invalid_argument("an alias is of no template");
  }

  // All aliases of some templates, most similar first.
  std::vector<TemplateAlias> of(const std::vector<std::int64_t>& rows) const {
    std::vector<TemplateAlias> found;
    for (const std::int64_t own : rows) {
      for (std::size_t i = static_cast<std::size_t>(own) * each; i < (static_cast<std::size_t>(own) + 1) * each; ++i) {
        if (row[i] < 0) continue;
        found.push_back({own, row[i], turn[i] * (2 * detail::kPi / 256), score[i] / 255.0});
      }
    }
    std::stable_sort(found.begin(), found.end(),
                     [](const TemplateAlias& one, const TemplateAlias& other) { return one.score > other.score; });
    return found;
  }
};

}  // namespace firstfix
