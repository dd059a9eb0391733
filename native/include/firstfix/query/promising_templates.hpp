// Templates at which a scan is worth being screened again, levelled otherwise (docs/method.md section 7.1).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/query/searched_map.hpp"

namespace firstfix {

// Of the templates that were screened, the share of the best ones: at them, or near, a scan that leans by some degrees fits.
constexpr double kBestTemplates = 0.1;
// Of the templates' spacing: how near to one of the best.
constexpr double kNeighbourSpacings = 1.1;

// Rows of templates, ascending: those where the best of some screened poses began, those near them, and all where none did.
//
// screened: rows of templates, each once or more, and the scores of poses that began there.
inline std::vector<std::int64_t> promising_templates(const TemplatePlaces& places, double spacing_m,
                                                     const std::vector<std::pair<std::int64_t, double>>& screened) {
  std::map<std::int64_t, double> best;
  for (const auto& [row, score] : screened) {
    const auto [known, is_first] = best.try_emplace(row, score);
    if (!is_first) known->second = std::max(known->second, score);
  }
  std::vector<std::uint8_t> is_poor(places.count);
  std::vector<std::pair<double, std::int64_t>> order;
  for (const auto& [row, score] : best) {
    is_poor[static_cast<std::size_t>(row)] = 1;
    order.emplace_back(-score, row);
  }
  const auto count = static_cast<std::size_t>(kBestTemplates * static_cast<double>(order.size())) + 1;
  const auto end = order.begin() + static_cast<std::ptrdiff_t>(std::min(count, order.size()));
  std::partial_sort(order.begin(), end, order.end());
  for (auto one = order.begin(); one != end; ++one) {
    const float* at = places.position_m + 3 * static_cast<std::size_t>(one->second);
    const detail::Vector3 at_m{static_cast<double>(at[0]), static_cast<double>(at[1]), static_cast<double>(at[2])};
    for (const std::int64_t row : places.tiles.within(places.position_m, at_m, kNeighbourSpacings * spacing_m)) {
      is_poor[static_cast<std::size_t>(row)] = 0;
    }
  }
  std::vector<std::int64_t> rows;
  for (std::size_t row = 0; row < places.count; ++row) {
    if (is_poor[row] == 0) rows.push_back(static_cast<std::int64_t>(row));
  }
  return rows;
}

}  // namespace firstfix
