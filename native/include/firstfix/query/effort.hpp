// The effort levels of a search in one map, and the time that each takes at worst (docs/method.md section 7.1).
#pragma once

#include <cstddef>
#include <limits>

namespace firstfix {

// Effort levels, cheapest first.
enum class Step {
  narrow,      // as levelled, the templates most similar by descriptor
  wide,        // several ups near it, and more templates, screened on the map
  other_ups,   // ups for a sensor that hangs head down or lies on its side
  exhaustive,  // more ups, and all templates of a map that is not too large, screened on the map
};

// firstfix.engine.config.EffortConfig, under the same names.
struct Effort {
  std::size_t clusters, screened, candidates;
};

// firstfix.engine.config.SearchConfig, under the same names.
struct EffortNumbers {
  std::size_t clusters, candidates;
  std::size_t widened;  // 1: no scan is searched for twice
  Effort wide, exhaustive;

  bool is_widened() const { return widened > 1; }
};

constexpr double kSlower = 1.5;  // than estimated, at worst

// Seconds that a step takes, at worst: measured by the first one, which always runs.
inline double expected_s(Step step, const EffortNumbers& numbers, double narrow_s) {
  constexpr double kScreenedPerRegistered = 12;   // poses that are screened in the time of one candidate's registration
  constexpr double kComparedPerRegistered = 200;  // templates that are compared in this time
  constexpr double kOtherUps = 6;                 // at most, each with a first search of its own
  if (step == Step::narrow) return -std::numeric_limits<double>::infinity();
  if (step == Step::other_ups) return kSlower * kOtherUps * narrow_s;
  const Effort& effort = step == Step::exhaustive ? numbers.exhaustive : numbers.wide;
  const double registrations = static_cast<double>(effort.candidates) + static_cast<double>(effort.screened) / kScreenedPerRegistered +
                               static_cast<double>(effort.clusters) / kComparedPerRegistered;
  return kSlower * narrow_s * registrations / static_cast<double>(numbers.candidates);
}

}  // namespace firstfix
