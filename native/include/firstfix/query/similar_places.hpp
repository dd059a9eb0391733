// From a scan to the templates that resemble it, and the sensor pose that each implies.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/descriptor/occupied_cells.hpp"
#include "firstfix/query/candidate.hpp"
#include "firstfix/query/level_hypotheses.hpp"
#include "firstfix/query/motion_at_places.hpp"
#include "firstfix/query/prior.hpp"
#include "firstfix/query/searched_map.hpp"
#include "firstfix/query/template_places.hpp"
#include "firstfix/retrieval/candidates.hpp"
#include "firstfix/retrieval/cascade.hpp"

namespace firstfix {

// One of a query's scans as it was prepared. What it points to must outlive it.
struct QueriedScan {
  ScanToLevel measured;
  double height_m;                // of the sensor above the floor, as it was levelled
  Vectors<const float> seen;      // all points within range
  const std::uint8_t* occupancy;  // by the robot, which had all points, levelled as measured; null: none that the map knows
};

// One of a query's scans, levelled in one way.
struct LevelledScan {
  std::size_t scan;  // its number
  detail::Matrix3 R_level_sensor;
  double height_m;
  bool is_as_measured;
};

using TemplateRows = std::vector<std::int64_t>;

// Where templates are looked for, in their own frame.
struct Sphere {
  detail::Vector3 centre_m;
  double radius_m;
};

// Finds the templates that resemble a described scan, of so many clusters nearest by key; nowhere else than in a sphere, if one
// is given, and among ascending rows, if they are.
using FindTemplates = std::function<Matches(const std::optional<Sphere>& within, std::size_t clusters, const TemplateRows* among)>;

// Describes a levelled scan as a map's templates are.
using Describe = std::function<FindTemplates(const QueriedScan& scan, const LevelledScan& levelled)>;

// The way of templates that are described by their occupancy, with keys in one list. Both must outlive what is made.
inline Describe by_occupancy(const Cascade& cascade, const LayeredGrid& grid) {
  return [&cascade, &grid](const QueriedScan& scan, const LevelledScan& levelled) {
    std::vector<std::uint8_t> occupancy(grid.bytes());
    if (levelled.is_as_measured && scan.occupancy != nullptr) {
      occupancy.assign(scan.occupancy, scan.occupancy + grid.bytes());
    } else {
      const std::int64_t start[] = {0, static_cast<std::int64_t>(scan.seen.size)};
      const auto height_m = static_cast<float>(levelled.height_m);
      Rotation R;
      for (std::size_t i = 0; i < 9; ++i) R[i] = static_cast<float>(levelled.R_level_sensor[i / 3][i % 3]);
      occupied_cells(scan.seen.data, start, &height_m, 1, &R, grid, occupancy.data());
    }
    return FindTemplates([&cascade, occupancy = std::move(occupancy)](const std::optional<Sphere>& within, std::size_t clusters,
                                                                      const TemplateRows* among) {
      return within ? cascade.search_near(occupancy.data(), within->centre_m, within->radius_m, clusters, among)
                    : cascade.search(occupancy.data(), clusters, among);
    });
  };
}

// Poses within these are of one spot. Templates of one spot lead to one pose: more of them would crowd out other spots.
constexpr double kSpotM = 2.0, kSpotDeg = 20.0;
constexpr std::size_t kMostPerSpot = 3;

// How many places are wanted of one scan.
struct Wanted {
  std::size_t most, clusters;  // whose templates are compared, nearest by key
  bool is_spread = true;       // kMostPerSpot of one spot at most
  const TemplateRows* among = nullptr;  // only these, ascending
};

// Candidates that the prior allows, most similar first.
inline std::vector<Candidate> similar_places(const TemplatePlaces& places, double spacing_m, const FindTemplates& find,
                                             const PoseMatrix& T_last_scan, const LevelledScan& levelled,
                                             const std::optional<PriorRegion>& prior, const Wanted& wanted) {
  std::optional<Sphere> within;
  std::optional<HeadingPrior> headings;
  if (prior) {
    const detail::Vector3 way_m{T_last_scan[3], T_last_scan[7], T_last_scan[11]};  // the prior is about the last scan
    within = Sphere{prior->middle_on_level_m(), prior->radius_m + std::sqrt(detail::dot(way_m, way_m)) + spacing_m};
    headings = HeadingPrior{prior->T_map_level, prior->yaw_deg, prior->yaw_range_deg + kYawSlackDeg};
  }
  const LevelledFrame frame{levelled.R_level_sensor, levelled.height_m, detail::inverse(T_last_scan)};
  const Spot spot{kSpotM, std::cos(kSpotDeg * (detail::kPi / 180)), kMostPerSpot};
  const Candidates found = candidates_of(find(within, wanted.clusters, wanted.among), places.position_m, places.height_m, frame,
                                         headings ? &*headings : nullptr, wanted.most, wanted.is_spread ? &spot : nullptr);
  std::vector<Candidate> made;
  for (std::size_t i = 0; i < found.templates.size(); ++i) {
    if (!detail::is_within_reach(found.T_level_sensor[i])) continue;
    made.push_back({found.templates[i], found.T_level_sensor[i], static_cast<double>(found.score[i])});
  }
  return made;
}

}  // namespace firstfix
