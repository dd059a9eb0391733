// Whether a scan was taken from its own origin: as firstfix.engine.diagnosis.viewpoint, which says why.
#pragma once

#include <array>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/query/motion_at_places.hpp"

namespace firstfix::version {

// A place from which a scan may have been taken, in the scan's frame.
struct Viewpoint {
  std::array<double, 3> position_m;
  double spread_ratio;    // number of directions in which the points lie, seen from it, over those from the origin
  double filled_share;    // of the turn about the origin in which points lie
  double evenness_ratio;  // of the points in these directions, seen from it, over that from the origin; 1: not known

  // How much better it explains the points than their origin does.
  double evidence() const;
};

// Whether some hundred points lie in more directions seen from elsewhere: a quick probe, for every scan.
bool is_suspect(Vectors<const float> part);

// The place from which points lie in the most directions: by a search in falling steps.
Viewpoint best_viewpoint(Vectors<const float> points);

// Whether the viewpoint shows that a scan was not taken from its origin. T_map_sensor: that is to be answered; null: none.
bool is_elsewhere(const Viewpoint& viewpoint, const PoseMatrix* T_map_sensor);

// Whether a pose is that of the map's own frame.
bool is_map_origin(const PoseMatrix& T_map_sensor);

// Whether points are as dense far from the origin as near it: those of a map.
bool is_even(Vectors<const float> points);

}  // namespace firstfix::version
