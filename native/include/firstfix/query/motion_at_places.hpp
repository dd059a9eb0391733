// The motion during a scan, solved at each place that is compared (docs/method.md section 7).
//
// A scan has one motion, wherever it is compared. A place that fits worse than another may only have got a poor minimum of
// its motion. So each that could rival the best one is solved again from the motion found there.
#pragma once

#include <cmath>
#include <cstddef>
#include <map>
#include <vector>

#include "firstfix/query/scan_on_map.hpp"

namespace firstfix {

constexpr double kSlowMS = 0.2, kSlowRadS = 0.05;  // slower, a motion during a scan moves its points by a few centimetres

// A start that was aligned rigidly. twist_start: by which the scan was deskewed then; nothing: it was not.
struct AlignedStart {
  std::int64_t template_row;
  PoseMatrix T_start;
  KnownTwist twist_start;
  Registration rigid;
};

namespace detail {

// The product of two poses.
inline PoseMatrix product(const PoseMatrix& a, const PoseMatrix& b) {
  PoseMatrix made{};
  for (std::size_t row = 0; row < 4; ++row) {
    for (std::size_t column = 0; column < 4; ++column) {
      double sum = 0;
      for (std::size_t k = 0; k < 4; ++k) sum += a[4 * row + k] * b[4 * k + column];
      made[4 * row + column] = sum;
    }
  }
  return made;
}

inline PoseMatrix inverse(const PoseMatrix& T) {
  PoseMatrix made{};
  for (std::size_t row = 0; row < 3; ++row) {
    double sum = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      made[4 * row + k] = T[4 * k + row];
      sum += -T[4 * k + row] * T[4 * k + 3];
    }
    made[4 * row + 3] = sum;
  }
  made[15] = 1;
  return made;
}

inline double length(const double* v) { return std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]); }

// Whether two motions differ by one that is slow.
inline bool is_same_motion(const Vector6& one, const Vector6& other) {
  Vector6 off;
  for (std::size_t k = 0; k < 6; ++k) off[k] = one[k] - other[k];
  return length(&off[0]) < kSlowMS && length(&off[3]) < kSlowRadS;
}

}  // namespace detail

// Registrations of a scan with its motion, row by row of its aligned starts. Each is solved once.
class MotionAtPlaces {
 public:
  // rival_from: share of the best place's rigid alignment score, from which on another may rival it.
  MotionAtPlaces(const SearchedMap& map, ScanOnMap& scan, double rival_from)
      : ranking_(map.ranking), scan_(scan), rival_from_(rival_from) {}

  // Poses of all that were solved.
  std::vector<PoseMatrix> poses() const {
    std::vector<PoseMatrix> made;
    for (const auto& [row, one] : solved_) made.push_back(one.T_level_sensor);
    return made;
  }

  // Registrations with a motion of the starts at the given rows, in order.
  std::vector<Registration> solve(const std::vector<AlignedStart>& starts, const std::vector<std::size_t>& rows) {
    std::vector<std::size_t> fresh;
    std::vector<PoseMatrix> T;
    std::vector<KnownTwist> twist;
    for (const std::size_t row : rows) {
      if (solved_.count(row) != 0) continue;
      fresh.push_back(row), T.push_back(starts[row].rigid.T_level_sensor), twist.push_back(starts[row].twist_start);
    }
    keep(fresh, T, twist);
    if (rows.size() > 1) share_motion(starts, rows);
    std::vector<Registration> found;
    for (const std::size_t row : rows) found.push_back(solved_.at(row));
    return found;
  }

 private:
  // Solves the rows that may rival the best one again, beginning with its motion.
  void share_motion(const std::vector<AlignedStart>& starts, const std::vector<std::size_t>& rows) {
    std::size_t best = rows.front();
    for (const std::size_t row : rows) {
      if (score(solved_.at(row)) > score(solved_.at(best))) best = row;
    }
    const Registration found = solved_.at(best);
    const AlignedStart& start = starts[best];
    // the same skewed scan stood askew in the same way
    const PoseMatrix askew = detail::product(detail::inverse(start.rigid.T_level_sensor), found.T_level_sensor);
    std::vector<std::size_t> rivals;
    std::vector<PoseMatrix> T;
    for (const std::size_t row : rows) {
      const bool may_rival = row != best && starts[row].rigid.alignment_score >= rival_from_ * start.rigid.alignment_score &&
                             starts[row].twist_start.value_or(Vector6{}) == start.twist_start.value_or(Vector6{});
      if (!may_rival || detail::is_same_motion(*solved_.at(row).twist, *found.twist)) continue;
      const auto [compared, is_first] = compared_.try_emplace(row, *found.twist);
      if (!is_first && detail::is_same_motion(compared->second, *found.twist)) continue;
      compared->second = *found.twist;
      rivals.push_back(row), T.push_back(detail::product(starts[row].rigid.T_level_sensor, askew));
    }
    keep(rivals, T, std::vector<KnownTwist>(rivals.size(), found.twist));
  }

  // Solves rows from their starts, and keeps what is better than what they have.
  void keep(const std::vector<std::size_t>& rows, const std::vector<PoseMatrix>& T, const std::vector<KnownTwist>& twist) {
    if (rows.empty()) return;
    const std::vector<Registration> made = scan_.align_finely(T, twist);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const auto [known, is_first] = solved_.try_emplace(rows[i], made[i]);
      if (!is_first && score(made[i]) > score(known->second)) known->second = made[i];
    }
  }

  double score(const Registration& one) const { return ranking_.discounted_score(one.alignment_score, one.twist); }

  const Ranking& ranking_;
  ScanOnMap& scan_;  // the few points
  double rival_from_;
  std::map<std::size_t, Registration> solved_;
  std::map<std::size_t, Vector6> compared_;  // twist of the best one, by row
};

}  // namespace firstfix
