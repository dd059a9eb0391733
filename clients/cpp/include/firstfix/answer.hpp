// The answer to a query. "Not localized" is an answer without a pose: there is no fallback pose.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "errors.hpp"
#include "pose.hpp"
#include "query_parameters.hpp"

namespace firstfix {

enum class Verdict { localized, ambiguous, rejected };

// How a scan lies on the map; shares, 0 to 1.
struct AlignmentQuality {
  double inlier_ratio = 0, alignment_score = 0, free_space_violation = 0;
};

struct Hypothesis {
  Pose T_map_sensor;
  std::optional<AlignmentQuality> quality;  // none of a query without points
  double probability = 0;
  long long template_row = 0;
  std::string map_id;  // whose frame it is in, where several maps were asked
};

struct Localization {
  Verdict verdict = Verdict::rejected;
  std::vector<std::string> reasons;  // why it is not localized: clients/PROTOCOL.md, Answer
  std::optional<Pose> T_map_sensor;  // there exactly if localized
  std::optional<Pose> T_map_base;
  std::optional<std::array<double, 36>> covariance;  // row by row over x, y, z and rotations about them (m, rad)
  double probability = 0;
  std::vector<Hypothesis> hypotheses;  // best first
  std::string map_id, map_version;
  std::map<std::string, double> timings_ms;
};

// OGC GeoPose 1.0, Basic-Quaternion: WGS84, metres above the ellipsoid, axes in the east-north-up frame there.
struct GeoPose {
  double latitude_deg = 0, longitude_deg = 0, height_m = 0;
  std::array<double, 4> quaternion{0, 0, 0, 1};  // x, y, z, w
};

struct MapInfo {
  std::string map_id;
  std::optional<std::string> active_version;  // none: every version is retired
};

struct MapPage {
  std::vector<MapInfo> maps;
  std::optional<std::string> next;  // the option `after` of the next page
};

// Documents of the service. They throw "unreadable" for what is none.
Localization parse_localization(std::string_view document);
GeoPose parse_geopose(std::string_view document);
MapPage parse_maps(std::string_view document);

// Of a map's record (GET /maps/{id}), or of `engine` in its manifest alone. They throw "unsupported_format" where robots
// cannot describe scans for the map, the first one "not_found" where no version is active.
QueryParameters parse_query_parameters(std::string_view map_record);
QueryParameters parse_engine(std::string_view engine);

// The error that a problem document (RFC 9457) stands for; none if it is none. A 503 without one is an overloaded proxy.
std::optional<Error> parse_problem(std::string_view document, long status);

const char* text_of(Verdict verdict);

}  // namespace firstfix
