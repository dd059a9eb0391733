// Other forms of a scan that was not localized: mirrored, scaled, with other columns, without a wrong option. As
// firstfix.engine.diagnosis.other_forms, which says why.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "firstfix/answer/documents.hpp"
#include "firstfix/answer/options.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/scan.hpp"

namespace firstfix::version {

using Numbers = std::map<std::string, double>;

// One form in which a query is asked again.
struct OtherForm {
  std::function<Scan()> scan;  // in this form, made when it is asked
  LocalizeOptions options;
  std::function<Finding(const PoseMatrix& T_map_sensor, const Numbers& numbers)> finding;  // from the best place, and the numbers of both
};

// The forms, likeliest first. scan: as it was sent, cleaned; it must outlive them. height_m: of the sensor above the floor, as the scan
// shows it. usual_height_m: of the map's own sensor.
std::vector<OtherForm> other_forms(const Scan& scan, const LocalizeOptions& options, double height_m, double usual_height_m);

}  // namespace firstfix::version
