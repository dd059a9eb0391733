// Answers and other documents of the service.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/pose.hpp"
#include "firstfix/scan/twist.hpp"
#include "firstfix/scan/descriptor_parameters.hpp"

namespace firstfix {

enum class Verdict { localized, ambiguous, rejected };

inline const char* text_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::localized: return "localized";
    case Verdict::ambiguous: return "ambiguous";
    case Verdict::rejected: return "rejected";
  }
  return "";
}

// How well a scan fits the map at a pose; shares, 0 to 1.
struct AlignmentQuality {
  double inlier_ratio = 0, alignment_score = 0, free_space_violation = 0, removed_surface = 0;
  std::optional<double> seen_free;  // absent if the map does not know what its mapping run saw free
};

// A pose where the scan may have been taken.
struct Hypothesis {
  Pose T_map_sensor;
  std::optional<AlignmentQuality> quality;  // absent if the query had no points
  double probability = 0;
  long long template_row = 0;
  std::string map_id;  // the map of this pose, if several maps were asked
};

// A move that should tell the best hypotheses of an ambiguous answer apart. Take the next scan at the goal, and send it
// together with this one.
struct Hint {
  Pose T_sensor_goal;  // in the sensor's frame at the query's last scan; the way there is level and straight
  double distance_m = 0, turn_deg = 0;  // turn about the vertical at the goal, to the left if positive
  double separation = 0;                // 0 to 1: by how much the scan at the goal should fit the true place better
  std::vector<long long> tells_apart;   // numbers of hypotheses, 0 for the first
};

// A direction in which the scan leaves an answered pose free, as along a corridor.
struct FreeDirection {
  bool is_rotation = false;           // a turn about the direction; else a shift along it
  std::array<double, 3> direction{};  // unit vector in the map frame; its sign says nothing
  double sigma = 0;                   // standard deviation: m of a shift, rad of a turn
};

// What is wrong or noteworthy with a scan, and what helps.
struct Finding {
  std::string code;                       // stable: docs/how-to/my-scan-is-not-localized.md lists them
  std::string severity;                   // error, warning or info
  std::string text, remedy;               // sentences for people
  std::map<std::string, double> numbers;  // what was measured, by name with unit
  std::string doc;                        // path of the documents' page that tells more
};

// What a scan consists of as it came.
struct ScanFacts {
  long long points = 0, valid = 0, in_range = 0;  // that came; finite and within 1,000 m; within the map's ranges
  std::optional<double> median_range_m, largest_range_m;  // of a part of the points
  std::optional<long long> rings;                         // elevations at which the points lie, if in rings
  std::optional<double> plane_ratio;                      // thickness over breadth: 0 of points in one plane
  std::optional<double> time_span_s;                      // from the first to the last point, if times are known
};

// The answer to a query. A scan that is not localized has no pose: there is no fallback pose.
struct Localization {
  Verdict verdict = Verdict::rejected;
  std::vector<std::string> reasons;  // why the scan is not localized: clients/PROTOCOL.md, Answer
  std::optional<Pose> T_map_sensor;  // present if and only if localized
  std::optional<Pose> T_map_base;
  std::optional<std::array<double, 36>> covariance;  // row by row over x, y, z and rotations about x, y, z (m, rad)
  double probability = 0;
  std::vector<Hypothesis> hypotheses;  // best first
  std::optional<Hint> hint;            // absent unless ambiguous, or if no move within reach helps
  std::string map_id, map_version;
  std::map<std::string, double> timings_ms;
  std::optional<Twist> twist{};  // of the sensor during the scan, if it was solved with the pose or given by the caller
  std::vector<FreeDirection> degenerate{};  // the pose is right but for these
  bool map_provisional = false;  // the version is coarse and little tested, until a full one takes its place
  std::vector<Finding> findings{};  // the cause first
  std::optional<ScanFacts> scan{};  // absent of a query without points
  std::string fix_id{};  // the same for the same pose in the same version; empty without one
};

// OGC GeoPose 1.0, Basic-Quaternion: WGS84, height above the ellipsoid, orientation in the local east-north-up frame.
struct GeoPose {
  double latitude_deg = 0, longitude_deg = 0, height_m = 0;
  std::array<double, 4> quaternion{0, 0, 0, 1};  // x, y, z, w
};

struct MapInfo {
  std::string map_id;
  std::optional<std::string> active_version;  // absent if every version is retired
};

struct MapPage {
  std::vector<MapInfo> maps;
  std::optional<std::string> next;  // the parameter `after` of the next page
};

// Parsers of the service's documents. They throw "unreadable" for anything else.
Localization parse_localization(std::string_view document);
GeoPose parse_geopose(std::string_view document);
MapPage parse_maps(std::string_view document);

// Descriptor parameters from a map's record (GET /maps/{id}), or from the `engine` of its manifest. They throw
// "unsupported_format" if robots cannot describe scans for the map. The first one throws "not_found" if no version is
// active.
DescriptorParameters parse_descriptor_parameters(std::string_view map_record);
DescriptorParameters parse_engine(std::string_view engine);

// The error of a problem document (RFC 9457), or none if the document is not a problem. A status 503 without one comes
// from an overloaded proxy.
std::optional<Error> parse_problem(std::string_view document, long status);

}  // namespace firstfix
