// A pose to which a candidate was aligned, how well the scan fits there, and how it compares with others.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/query/calibration.hpp"
#include "firstfix/query/ranking.hpp"
#include "firstfix/query/searched_map.hpp"
#include "firstfix/query/searched_query.hpp"
#include "firstfix/registration/distinct_poses.hpp"

namespace firstfix {

// Aligned pose of a scan. information: over rotation then translation, about the sensor and along the level axes. rests:
// whether the alignment came to rest. twist: of the sensor during the scan, if it was solved.
struct Registration {
  PoseMatrix T_level_sensor{};
  double inlier_ratio = 0, alignment_score = 0;
  Matrix6 information{};
  bool rests = false;
  KnownTwist twist;
};

struct RegisteredPose {
  std::int64_t template_row;  // that the candidate came from
  double start_z_m;           // height at which the alignment began
  Registration registration;
  Fit fit;
  double support;
  bool is_measured = false;  // whether its agreement is
  bool is_alike = false;     // whether the scan does not tell it from the best pose of its map (look_alikes.hpp)

  RegisteredPose(const Ranking& ranking, std::int64_t row, double start_z, const Registration& aligned)
      : template_row(row), start_z_m(start_z), registration(aligned) {
    fit.inlier_ratio = aligned.inlier_ratio;
    fit.alignment_score = ranking.discounted_score(aligned.alignment_score, aligned.twist);
    support = ranking.support(fit);
  }

  // The same candidate, aligned otherwise.
  RegisteredPose moved(const Ranking& ranking, const Registration& aligned) const {
    return RegisteredPose(ranking, template_row, start_z_m, aligned);
  }
};

using RegisteredPoses = std::vector<RegisteredPose>;

inline double radians(double deg) { return deg * (detail::kPi / 180); }

inline bool has_more_support(const RegisteredPose& one, const RegisteredPose& other) { return one.support > other.support; }

// The poses by support, best first; of nearly the same pose only the best is kept.
inline RegisteredPoses ranked(RegisteredPoses poses, const Ranking& ranking) {
  std::stable_sort(poses.begin(), poses.end(), has_more_support);
  std::vector<PoseMatrix> T;
  for (const RegisteredPose& one : poses) T.push_back(one.registration.T_level_sensor);
  RegisteredPoses kept;
  for (const auto row : distinct_poses(T, ranking.same_pose_m, radians(ranking.same_pose_deg), T.size())) {
    kept.push_back(poses[static_cast<std::size_t>(row)]);
  }
  return kept;
}

// Features of the first of ranked poses, and of a pose that follows them, if any. The evidence of several spots adds up: the
// margin counts once for each.
inline MatchFeatures features_of(const RegisteredPoses& ranked, const SearchedMap& map, std::size_t spots,
                                 const RegisteredPose* following = nullptr) {
  std::vector<double> supports;
  for (const RegisteredPose& one : ranked) supports.push_back(one.support);
  if (following != nullptr) supports.push_back(following->support);
  MatchFeatures features =
      match_features(ranked.front().fit, supports, 0, map.calibration.min_margin, map.ranking.max_margin);
  if (spots != 1) features.margin *= static_cast<double>(spots);
  return features;
}

}  // namespace firstfix
