#include "reason_finding.hpp"

#include <cmath>
#include <map>
#include <string>

namespace firstfix::version {
namespace {

// Texts of firstfix.findings.scan_kinds: these around a number, if there is one.
struct Kind {
  const char *code, *severity, *before, *remedy, *number = "", *after = "";
};

const std::map<std::string, Kind>& kinds() {
  static const std::map<std::string, Kind> made{
      {"low_inlier_ratio",
       {"no_place_fits", "warning", "At the best place, ", "Is it the right map? Was the scan taken outside it, or has the place changed much?",
        "inlier_ratio", " of the scan lies on the map: too little."}},
      {"low_probability",
       {"unsure", "warning", "The best place explains ", "Try a scan from another spot, with more in view, or send two scans with odometry.",
        "inlier_ratio", " of the scan, with probability "}},
      {"several_places",
       {"several_places", "warning", "", "Send a prior, or a second scan from where the answer's hint leads; without one, none near would tell.",
        "places", " places explain the scan about as well."}},
      {"free_space_violation",
       {"through_surfaces", "warning", "At the best place, ",
        "Has a wall or a door gone? Build the map anew; or the scan was taken elsewhere.", "free_space_violation",
        " of the scan's directions pass through surfaces of the map."}},
      {"not_converged",
       {"not_converged", "warning", "The scan could not be aligned to the map at the best place.", "Try a scan from another spot."}},
      {"no_candidate", {"no_candidate", "error", "No place of the map is within the prior.", "Widen the prior, or leave it out."}}};
  return made;
}

std::string whole(double number) { return std::to_string(static_cast<long long>(std::nearbyint(number))); }  // half to even

std::string hundredths(double share) {
  const long long number = static_cast<long long>(std::nearbyint(100 * share));
  const std::string digits = std::to_string(number % 100);
  return std::to_string(number / 100) + (digits.size() < 2 ? ".0" : ".") + digits;
}

}  // namespace

std::optional<Finding> reason_finding(const Localization& answer) {
  const auto found = answer.reasons.empty() ? kinds().end() : kinds().find(answer.reasons.front());
  if (found == kinds().end()) return std::nullopt;
  const Kind& kind = found->second;
  Finding made{kind.code, kind.severity, kind.before, kind.remedy, {}, "docs/how-to/my-scan-is-not-localized.md"};
  made.numbers = {{"probability", answer.probability}, {"places", static_cast<double>(answer.hypotheses.size())}};
  if (!answer.hypotheses.empty()) {
    const AlignmentQuality& fit = *answer.hypotheses.front().quality;
    made.numbers["inlier_ratio"] = fit.inlier_ratio, made.numbers["free_space_violation"] = fit.free_space_violation;
  }
  const std::string number = kind.number;
  if (number == "places") made.text += whole(made.numbers[number]);
  else if (!number.empty()) made.text += whole(100 * made.numbers[number]) + "%";
  made.text += kind.after;
  if (found->first == "low_probability") made.text += hundredths(answer.probability) + ": too unsure.";
  return made;
}

}  // namespace firstfix::version
