#include "place_findings.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "finding_texts.hpp"
#include "firstfix/bit_exact/atan2.hpp"
#include "poses.hpp"

namespace firstfix::version {

std::optional<Finding> reason_finding(const Localization& answer) {
  static const std::map<std::string, std::string> kinds{
      {"low_inlier_ratio", "no_place_fits"},       {"low_probability", "unsure"},       {"several_places", "several_places"},
      {"free_space_violation", "through_surfaces"}, {"not_converged", "not_converged"}, {"no_candidate", "no_candidate"}};
  const auto kind = answer.reasons.empty() ? kinds.end() : kinds.find(answer.reasons.front());
  if (kind == kinds.end()) return std::nullopt;
  std::map<std::string, double> numbers{{"probability", answer.probability}, {"places", static_cast<double>(answer.hypotheses.size())}};
  if (!answer.hypotheses.empty()) {
    const AlignmentQuality& fit = *answer.hypotheses.front().quality;
    numbers["inlier_ratio"] = fit.inlier_ratio, numbers["free_space_violation"] = fit.free_space_violation;
  }
  return found(kind->second, numbers);
}

std::optional<Finding> mounting_finding(const PoseMatrix& T_map_sensor, const LocalizeOptions& options) {
  constexpr double kUprightCosine = 0.5;  // of 60 degrees: robots lean less than that
  const PoseMatrix T = options.T_base_sensor ? product(T_map_sensor, inverse(matrix_of(*options.T_base_sensor))) : T_map_sensor;
  if ((!options.T_base_sensor && options.gravity) || T[10] > kUprightCosine) return std::nullopt;
  const auto degrees = [](double radians) { return radians * (180 / detail::kPi); };
  const double pitch = -std::asin(std::min(std::max(T[8], -1.0), 1.0));
  return found("mounting", {{"roll_deg", degrees(std::atan2(T[9], T[10]))}, {"pitch_deg", degrees(pitch)}},
               {{"body", options.T_base_sensor ? "robot's base" : "sensor"}});
}

}  // namespace firstfix::version
