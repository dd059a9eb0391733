// Facts of a scan as it came, and the causes that its own points show: wrong columns, wrong units, driver faults, coordinates of a
// map. As firstfix.engine.diagnosis.facts and input_findings.
#pragma once

#include <optional>
#include <vector>

#include "firstfix/answer/documents.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/scan/dropped.hpp"
#include "sent_query.hpp"

namespace firstfix::version {

// One scan of a query, as far as facts are told of it.
struct LookedAt {
  std::vector<float> points;  // (n, 3) usable ones
  std::vector<float> time_s;  // of each; empty: not known
  Dropped dropped;            // points that it does not have
  std::vector<float> part;    // (m, 3) a part of its points

  explicit LookedAt(const SentScan& scan);
};

ScanFacts facts_of(const LookedAt& scan, const Preparation& limits);

// The cause why a scan cannot be used, as its own points show it, or nothing: it is not plain.
std::optional<Finding> input_finding(const ScanFacts& facts, const LookedAt& scan);

}  // namespace firstfix::version
