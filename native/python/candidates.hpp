// Candidates and poses, as Python hands them over and gets them.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "firstfix/query/candidate.hpp"
#include "firstfix/query/prior.hpp"

namespace firstfix::python {

using PoseArray = In<double, nb::shape<4, 4>>;
using Poses = In<double, nb::shape<-1, 4, 4>>;
using Rows = In<std::int64_t, nb::ndim<1>>;
using Scores = In<double, nb::ndim<1>>;
// T_map_level, position_m, radius_m, yaw_deg, yaw_range_deg
using PriorNumbers = std::tuple<PoseArray, In<double, nb::shape<3>>, double, double, double>;

inline std::vector<PoseMatrix> finite_poses_of(const Poses& poses) {
  const double* const numbers = poses.data();
  const bool is_finite =
      std::all_of(numbers, numbers + 16 * poses.shape(0), [](double number) { return std::fabs(number) <= 1e9; });
  require(is_finite, "a pose is not finite, or too far away");
  return poses_of(poses);
}

inline PoseMatrix finite_pose_of(const PoseArray& pose) {
  const bool is_finite = std::all_of(pose.data(), pose.data() + 16, [](double number) { return std::fabs(number) <= 1e9; });
  require(is_finite, "a pose is not finite, or too far away");
  return pose_of(pose);
}

inline std::vector<Candidate> candidates_of(const Rows& rows, const Poses& T_level_sensor, const Scores& score) {
  require(rows.shape(0) == T_level_sensor.shape(0) && score.shape(0) == rows.shape(0),
          "template, T_level_sensor and score differ in length");
  const std::vector<PoseMatrix> T = finite_poses_of(T_level_sensor);
  std::vector<Candidate> made;
  for (std::size_t i = 0; i < T.size(); ++i) made.push_back({rows(i), T[i], score(i)});
  return made;
}

// template, T_level_sensor, score
inline auto arrays_of(const std::vector<Candidate>& candidates) {
  std::vector<std::int64_t> rows;
  std::vector<double> score;
  for (const Candidate& one : candidates) rows.push_back(one.template_row), score.push_back(one.score);
  return std::make_tuple(array_of(std::move(rows)), array_of(firstfix::poses_of(candidates), {candidates.size(), 4, 4}),
                         array_of(std::move(score)));
}

inline std::optional<PriorRegion> prior_of(const std::optional<PriorNumbers>& numbers) {
  if (!numbers) return std::nullopt;
  const auto& [T_map_level, position_m, radius_m, yaw_deg, yaw_range_deg] = *numbers;
  const detail::Vector3 middle_m{position_m(0), position_m(1), position_m(2)};
  const PriorRegion made{finite_pose_of(T_map_level), middle_m, radius_m, yaw_deg, yaw_range_deg};
  for (const double number : {middle_m[0], middle_m[1], middle_m[2], radius_m, yaw_deg, yaw_range_deg}) {
    require(std::isfinite(number), "a number of the prior is not finite");
  }
  return made;
}

}  // namespace firstfix::python
