// Search of a query in a version, step by step of the effort levels (docs/method.md section 7.1).
#pragma once

#include <chrono>
#include <optional>
#include <vector>

#include "asked_scan.hpp"
#include "firstfix/query/prior.hpp"
#include "firstfix/query/search.hpp"
#include "firstfix/query/stage_times.hpp"
#include "firstfix/version/places_options.hpp"
#include "template_tables.hpp"

namespace firstfix::version {

using Clock = std::chrono::steady_clock;

class ScanSearch {
 public:
  // templates, map: must outlive it. usual_height_m: of the map's own sensor above the floor. deadline: a step that would end
  // later does not begin.
  ScanSearch(const TemplateTables& templates, const SearchedMap& map, double usual_height_m, std::vector<PlacedScan>&& scans,
             const PlacesOptions& options, const std::optional<Clock::time_point>& deadline);
  ScanSearch(const ScanSearch&) = delete;
  ScanSearch& operator=(const ScanSearch&) = delete;

  // Climbs the effort levels until a place explains the scan: most scans need the first step alone.
  void climb();

  // Lets the known aliases of the best pose compete, if it would be accepted. asked: the threshold on the probability that the
  // caller asks for; not a number: none.
  void try_aliases(double asked);

  const RegisteredPoses& found() const { return search_.found(); }

  // Support by which a known alias outside the query's prior is better than the best pose; 0: none is.
  double outside_lead() const { return outside_lead_; }

  // All points of the scans, one a voxel, and how many spots they are of.
  const ScannedSurface& dense() const { return query_.dense; }
  std::size_t spots() const { return query_.spots; }

 private:
  enum class Step { narrow, wide, other_ups, exhaustive };

  struct Levelled {
    const PlacedScan* scan;
    detail::Matrix3 R_level_sensor;
    double height_m;
    bool is_as_measured = false;
  };

  void take(Step step);
  void by_descriptor(const std::vector<Levelled>& levelled);
  void by_screening(const Effort& effort, bool tilted);
  std::vector<Levelled> as_measured() const;
  std::vector<Levelled> with_other_ups() const;
  std::vector<Candidate> similar(const std::vector<Levelled>& levelled, const std::optional<Prior>& prior) const;
  std::vector<Candidate> merged(const std::vector<Levelled>& levelled, const std::optional<Prior>& prior, const Wanted& wanted) const;
  void run(const std::vector<Candidate>& candidates);
  void compare_outside();
  double expected_s(Step step) const;
  double left_s() const;

  const TemplateTables& templates_;
  const SearchedMap& map_;
  double usual_height_m_;
  PlacesOptions options_;
  std::optional<Clock::time_point> deadline_;
  std::vector<PlacedScan> scans_;
  SearchedQuery query_;
  Search search_;
  StageTimes times_;
  double narrow_s_ = 0, outside_lead_ = 0;
};

}  // namespace firstfix::version
