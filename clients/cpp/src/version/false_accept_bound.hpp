// How often a version may answer "localized" wrongly, by the threshold on the probability.
#pragma once

#include <optional>
#include <vector>

#include "version_folder.hpp"

namespace firstfix::version {

class FalseAcceptBound {
 public:
  // Reads false_accept_bound.json. A version without one has no bound. Throws Error "corrupt_version".
  explicit FalseAcceptBound(const VersionFolder& folder);

  // The lowest threshold that accepts at most this share of scans whose place is not in the map. Throws Error "invalid_option"
  // if there is none.
  double min_probability(double max_false_accept, const std::string& map_id) const;

 private:
  struct Row {
    double min_probability, bound;
  };

  std::vector<Row> rows_;  // by the threshold, ascending
};

}  // namespace firstfix::version
