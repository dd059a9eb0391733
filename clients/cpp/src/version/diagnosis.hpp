// The findings of an answer: what costs nothing always, what costs only where a scan is not localized. As
// firstfix.engine.diagnosis.diagnose.
#pragma once

#include "firstfix/answer/documents.hpp"
#include "firstfix/answer/options.hpp"
#include "firstfix/query/deadline.hpp"
#include "opened_map.hpp"
#include "sent_query.hpp"

namespace firstfix::version {

// A query as one map was asked.
struct AskedQuery {
  const SentScans& scans;
  const LocalizeOptions& options;  // checked
  const OpenedMap& map;
  const MapQuery* prepared;  // null: too few points
  Deadline::Clock::time_point began;
  Deadline deadline;
  double explaining;  // how long other forms may take, over the time that the query has taken; 0: none is tried
};

// Gives the answer its scan's facts and findings. One of another viewpoint is then not localized.
void diagnose(Localization& answer, const AskedQuery& query);

}  // namespace firstfix::version
