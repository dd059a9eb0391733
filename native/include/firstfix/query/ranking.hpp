// How strongly a pose is supported by how a scan fits the map there (docs/method.md, section 7).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>

#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix {

using KnownTwist = std::optional<Vector6>;  // of the sensor during a scan, linear then angular; nothing: not known

// Inlier ratio below which not even the walls agree.
constexpr double kAgrees = 0.4;

// Fit of a scan to the map at a pose: shares, 0..1.
struct Fit {
  double inlier_ratio = 0, alignment_score = 0;                 // the score less for a motion that is unlikely
  double free_space_violation = 0, removed_surface = 0;         // 0 until free space is checked
  double beside_surface = 0, same_plane = 0;                    // 0 until the agreement is measured
  double seen_free = std::numeric_limits<double>::quiet_NaN();  // not a number: the map does not know it

  // How far it counts that the scan does not contradict the map: as far as it meets the map at all. Below the floor, or beside
  // the building, next to nothing of a scan meets anything, and so nothing contradicts it either.
  double meets_map() const { return std::min(inlier_ratio / kAgrees, 1.0); }
};

// The numbers of firstfix.engine.ranking that a search needs, in the same parts and under the same names.
struct SupportNumbers {
  double alignment_weight, removed_weight, violation_weight, seen_free_weight, seen_free_offset, best_score, least_share;

  // Score by which poses are ranked (equation 7.1). Only differences of it mean something. Logarithms of the misfit spread
  // good values: from 98 to 99 % is as far as from 80 to 90 %.
  double support(const Fit& fit) const {
    return -(alignment_weight * std::log(best_score - fit.alignment_score) +
             (fit.meets_map() * seen_through(fit) + in_free(fit)));
  }

  // The support that is lost where the scan does not show what the map has, or saw free.
  double contradiction(const Fit& fit) const { return seen_through(fit) + in_free(fit); }

 private:
  double seen_through(const Fit& fit) const {
    return removed_weight * std::log(least_share + fit.removed_surface) +
           violation_weight * std::log(least_share + fit.free_space_violation);
  }

  double in_free(const Fit& fit) const {
    const double seen_free = std::isnan(fit.seen_free) ? 0 : fit.seen_free;
    return seen_free_weight * std::log(1 + seen_free / seen_free_offset);
  }
};

struct ProbabilityNumbers : SupportNumbers {
  double worst_score, violation_offset, beside_offset, same_plane_offset, max_margin;
  double unlikely_m_s, unlikely_rad_s, motion_score_weight, promising, likely, convincing_inlier_ratio;

  // The alignment score that counts as much as this one and the likelihood of its motion together. Three unknowns more let a
  // scan fit wrong places better, but with motions that are unlikely. The logarithm of the score's misfit has a known weight
  // in the log odds of a pose, and so has that of the motion.
  double discounted_score(double alignment_score, const KnownTwist& twist) const {
    if (!twist) return alignment_score;
    const double odds = (1 + squared(&(*twist)[0], unlikely_m_s)) * (1 + squared(&(*twist)[3], unlikely_rad_s));
    const double misfit = (best_score - alignment_score) * std::pow(odds, 1 / motion_score_weight);
    return std::max(0.0, best_score - misfit);  // 0 of what is not a number
  }

 private:
  static double squared(const double* v, double unit) {
    const double x = v[0] / unit, y = v[1] / unit, z = v[2] / unit;
    return x * x + y * y + z * z;
  }
};

struct Ranking : ProbabilityNumbers {
  double same_pose_m, same_pose_deg, same_start_m, same_start_deg, rival_within;
  std::size_t max_refined;
  double neighbour_m, slid_m, better_by, maybe_better_by;
  std::size_t screen_points, coarse_points;
  int screen_iterations, smooth_iterations;
  double coarse_angle, align_angle, smooth_angle, fine_angle;
  Vector6 twist_scale;
};

}  // namespace firstfix
