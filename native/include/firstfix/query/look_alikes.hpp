// Which places a scan does not tell from the best one (docs/method.md section 7).
//
// A map may lack most of a room: the mapping run only passed its door. A scan of it fits a look-alike far better that is mapped
// well, as most of its points meet nothing where they belong. But they contradict nothing there either. A room that is mapped,
// and another one, has surfaces that the scan sees through.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "firstfix/query/free_space_order.hpp"
#include "firstfix/query/registered_pose.hpp"

namespace firstfix {

// lab/docs/experiments.md, "Which leads over a look-alike can be trusted"
constexpr double kLeadsBy = 0.08;    // of support: less is what things that move may give to a look-alike
constexpr double kExplained = 0.7;   // alignment score from which on the map has most of what the scan shows
constexpr double kClearly = 0.02;    // of support, by which a place is contradicted more than the best one, or less
constexpr double kOneThing = 0.05;   // of the alignment score: a person at 2 m covers four in a hundred points

// Whether one thing that moved may give the best place its lead over another. Where both explain nearly all of the scan, support
// spreads what a person hides to a clear lead.
inline bool is_one_thing(const SupportNumbers& numbers, const Fit& place, const Fit& best) {
  const double by = numbers.contradiction(place) - numbers.contradiction(best);
  return best.alignment_score - place.alignment_score < kOneThing && by < kClearly;
}

// Whether a place may fit worse than the best one only because the map lacks much of it: the scan contradicts it clearly less
// than the best one, or not more where much meets nothing. alignment_score: at the place, however unlikely the motion.
inline bool may_lack(const SupportNumbers& numbers, double alignment_score, const Fit& place, const Fit& best) {
  if (place.inlier_ratio < kAgrees) return false;
  const double by = numbers.contradiction(place) - numbers.contradiction(best);
  return by < -kClearly || (by < kClearly && alignment_score < kExplained);
}

// Whether a scan tells a place from the best one, which leads by so much support. Rooms above each other are never told apart:
// one plan is furnished twice, and furniture moves. is_doubtful: by may_lack or is_one_thing.
inline bool is_parted(double lead, bool is_doubtful, bool is_above_or_below) {
  return lead >= kLeadsBy && !is_doubtful && !is_above_or_below;
}

// Marks the poses of one map, best first, that the scan does not tell from the best one: known aliases near its support, and
// rivals right above or below that the map may lack. A scan in motion fits wrong places well, as each has three unknowns more:
// there all rivals are marked that the map may lack.
inline void mark_look_alikes(RegisteredPoses& found, const SearchedMap& map, const std::vector<PoseMatrix>& aliases) {
  if (found.empty()) return;
  found.front().is_alike = false;
  const RegisteredPose& best = found.front();
  const double cosine = std::cos(radians(map.ranking.same_pose_deg));
  for (std::size_t i = 1; i < found.size(); ++i) {
    RegisteredPose& one = found[i];
    const double lead = best.support - one.support;
    const bool lacks = may_lack(map.ranking, one.registration.alignment_score, one.fit, best.fit);
    const bool stacked = is_stacked(best.registration.T_level_sensor, one.registration.T_level_sensor);
    const bool is_known = is_any_of(one.registration.T_level_sensor, aliases, map.ranking.same_pose_m, cosine);
    const bool is_doubtful = lacks || is_one_thing(map.ranking, one.fit, best.fit);
    const bool is_rival = lacks && lead < map.ranking.rival_within;
    one.is_alike = (is_known && std::fabs(lead) < map.calibration.alias_margin && !is_parted(lead, is_doubtful, stacked)) ||
                   (is_rival && (is_in_motion(best.registration) || stacked));
  }
}

}  // namespace firstfix
