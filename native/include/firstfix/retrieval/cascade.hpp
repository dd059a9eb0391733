// The cascade: find clusters of templates by key, then compare the templates in them (docs/method.md, section 4).
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <numeric>
#include <stdexcept>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/descriptor/best_shifts.hpp"
#include "firstfix/descriptor/ring_spectra.hpp"
#include "firstfix/retrieval/key_codes.hpp"
#include "firstfix/retrieval/template_tiles.hpp"

namespace firstfix {

// Occupancies, packed bits, of `count` templates.
struct DescribedTemplates {
  const std::uint8_t* occupancy = nullptr;  // (count, bytes)
  std::size_t count = 0;
  std::size_t rings = 0, sectors = 0;  // rings of all layers

  std::size_t bytes() const { return (rings * sectors + 7) / 8; }
};

// Cluster i has member[start[i]] to member[start[i + 1]], ascending.
struct TemplateClusters {
  const std::int32_t* representative = nullptr;  // (count)
  const std::int32_t* start = nullptr;           // (count + 1)
  const std::int32_t* member = nullptr;          // (templates)
  std::size_t count = 0;
};

// The key of a scan: spectra of its rings, multiplied by a learned projection where the map has one.
struct KeyForm {
  std::size_t coefficients = 0;       // of each ring
  const float* projection = nullptr;  // (numbers of the spectra, columns)
  std::size_t columns = 0;
};

// Templates compared with a scan, most similar first.
struct Matches {
  std::vector<std::int64_t> rows;
  std::vector<double> yaw_rad;  // of the scan in each template's frame
  std::vector<float> score;     // 0..1
};

struct Cascade {
  DescribedTemplates templates;
  const float* position_m = nullptr;  // (templates, 3)
  TemplateTiles tiles;
  TemplateClusters clusters;
  KeyForm form;
  KeyCodes keys;  // of the clusters' representatives

  // Throws std::invalid_argument where a table points outside of another one, or does not fit it.
  void check() const {
    const auto require = [](bool holds, const char* message) {
      if (!holds) throw std::invalid_argument(message);
    };
    const auto point_into = [](const std::int32_t* numbers, std::size_t size, std::size_t count) {
      return std::all_of(numbers, numbers + size, [count](std::int32_t number) {
        return number >= 0 && static_cast<std::size_t>(number) < count;
      });
    };
    require(point_into(clusters.representative, clusters.count, templates.count), "a cluster has no such representative");
    require(point_into(clusters.member, templates.count, templates.count), "a cluster has no such member");
    require(clusters.start[0] == 0 && std::is_sorted(clusters.start, clusters.start + clusters.count + 1) &&
                static_cast<std::size_t>(clusters.start[clusters.count]) == templates.count,
            "the clusters do not hold every template once");
    tiles.check(templates.count);
    const std::size_t numbers = templates.rings * std::min(form.coefficients, templates.sectors / 2 + 1);
    require(templates.count < std::size_t{1} << 31, "there are too many templates");
    require(keys.count == clusters.count, "there is not one key for each cluster");
    require(keys.numbers == (form.projection == nullptr ? numbers : form.columns), "a key has another number of numbers");
  }

  // Compares one occupancy with all templates of the `most` clusters nearest by key. among: ascending rows; only these, if given.
  Matches search(const std::uint8_t* occupancy, std::size_t most, const std::vector<std::int64_t>* among = nullptr) const {
    if (most >= clusters.count) {
      if (among != nullptr) return compare(occupancy, *among);
      std::vector<std::int64_t> every(templates.count);
      std::iota(every.begin(), every.end(), 0);
      return compare(occupancy, std::move(every));
    }
    std::vector<std::int64_t> found = members(nearest_keys(keys, key_of(occupancy).data(), most));
    return compare(occupancy, among == nullptr ? std::move(found) : in_both(found, *among));
  }

  // Compares one occupancy with templates inside a sphere: with all of them if they are few, else with those of the `most`
  // clusters nearest by key. among: as of `search`.
  Matches search_near(const std::uint8_t* occupancy, const detail::Vector3& centre, double radius_m, std::size_t most,
                      const std::vector<std::int64_t>* among = nullptr) const {
    const std::vector<std::int64_t> inside = tiles.within(position_m, centre, radius_m);
    const auto compare_asked = [&](const std::vector<std::int64_t>& rows) {
      return compare(occupancy, among == nullptr ? rows : in_both(rows, *among));
    };
    if (inside.size() <= most) return compare_asked(inside);
    if (inside.size() == templates.count) return search(occupancy, most, among);
    const std::vector<std::int64_t> represented = represented_by(inside);
    const std::vector<std::int64_t> found = members(nearest_keys(keys, key_of(occupancy).data(), most, &represented));
    return compare_asked(in_both(found, inside));
  }

  std::vector<float> key_of(const std::uint8_t* occupancy) const {
    RingSpectra spectra(templates.rings, templates.sectors, form.coefficients);
    std::vector<float> key(spectra.size());
    spectra.key(occupancy, templates.bytes(), key.data());
    if (form.projection == nullptr) return key;
    std::vector<float> projected(form.columns);
    for (std::size_t i = 0; i < key.size(); ++i) {
      for (std::size_t k = 0; k < form.columns; ++k) projected[k] += key[i] * form.projection[i * form.columns + k];
    }
    return projected;
  }

 private:
  static std::vector<std::int64_t> in_both(const std::vector<std::int64_t>& one, const std::vector<std::int64_t>& other) {
    std::vector<std::int64_t> rows;
    std::set_intersection(one.begin(), one.end(), other.begin(), other.end(), std::back_inserter(rows));
    return rows;
  }

  // Templates of clusters, ascending.
  std::vector<std::int64_t> members(const std::vector<std::int64_t>& of) const {
    std::vector<std::int64_t> rows;
    for (const std::int64_t cluster : of) {
      rows.insert(rows.end(), clusters.member + clusters.start[cluster], clusters.member + clusters.start[cluster + 1]);
    }
    std::sort(rows.begin(), rows.end());
    return rows;
  }

  // Clusters, ascending, whose representatives are among some ascending templates.
  std::vector<std::int64_t> represented_by(const std::vector<std::int64_t>& rows) const {
    std::vector<std::int64_t> found;
    for (std::size_t cluster = 0; cluster < clusters.count; ++cluster) {
      if (std::binary_search(rows.begin(), rows.end(), std::int64_t{clusters.representative[cluster]})) {
        found.push_back(static_cast<std::int64_t>(cluster));
      }
    }
    return found;
  }

  // rows: ascending, as on the disk.
  Matches compare(const std::uint8_t* occupancy, std::vector<std::int64_t> rows) const {
    const std::size_t count = rows.size();
    std::vector<std::int64_t> shift(count);
    std::vector<float> score(count);
    BestShifts(occupancy, templates.bytes(), templates.rings, templates.sectors)
        .compare(templates.occupancy, rows.data(), count, shift.data(), score.data());
    std::vector<std::uint64_t> order(count);  // a score from 0 on has the order of its bits
    for (std::size_t i = 0; i < count; ++i) {
      std::uint32_t bits;
      std::memcpy(&bits, &score[i], sizeof bits);
      order[i] = std::uint64_t{~bits} << 32 | i;
    }
    std::sort(order.begin(), order.end());
    const double sector_rad = 2 * detail::kPi / static_cast<double>(templates.sectors);
    Matches found;
    found.rows.resize(count), found.yaw_rad.resize(count), found.score.resize(count);
    for (std::size_t i = 0; i < count; ++i) {
      const auto at = static_cast<std::size_t>(order[i] & 0xffffffffU);
      found.rows[i] = rows[at];
      found.yaw_rad[i] = static_cast<double>(shift[at]) * sector_rad;
      found.score[i] = score[at];
    }
    return found;
  }
};

}  // namespace firstfix
