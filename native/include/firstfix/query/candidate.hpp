// One place where an alignment begins.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix {

// A pose that a template implies. score: 0..1, similarity of the two descriptors.
struct Candidate {
  std::int64_t template_row;
  PoseMatrix T_level_sensor;
  double score;
};

inline std::vector<PoseMatrix> poses_of(const std::vector<Candidate>& candidates) {
  std::vector<PoseMatrix> T;
  for (const Candidate& one : candidates) T.push_back(one.T_level_sensor);
  return T;
}

// Most similar first.
inline void sort_by_score(std::vector<Candidate>& candidates) {
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& one, const Candidate& other) { return one.score > other.score; });
}

}  // namespace firstfix
