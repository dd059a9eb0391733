// The templates of a version, memory-mapped, and those that resemble a prepared scan.
#pragma once

#include <optional>
#include <vector>

#include "arrays.hpp"
#include "engine_numbers.hpp"
#include "firstfix/answer/options.hpp"
#include "firstfix/query/candidate.hpp"
#include "firstfix/query/searched_map.hpp"
#include "firstfix/retrieval/candidates.hpp"
#include "firstfix/retrieval/cascade.hpp"
#include "firstfix/scan/compact.hpp"
#include "version_folder.hpp"

namespace firstfix::version {

// How many candidates a search gives.
struct Wanted {
  std::size_t most, clusters;  // whose templates are compared
  bool is_spread = true;       // few of one spot
};

class TemplateTables {
 public:
  explicit TemplateTables(const VersionFolder& folder);

  const EngineNumbers numbers;

  // Candidates that the prior allows, best first. seen: (n, 3) points of a scan, which is levelled as `frame` says. described: of
  // the same frame, by a robot that had more points; null: none.
  std::vector<Candidate> candidates(const std::vector<float>& seen, const ScanDescriptor* described, const LevelledFrame& frame,
                                    const std::optional<Prior>& prior, const Wanted& wanted) const;

  // Of the sensor above its floor: the templates' median.
  double usual_height_m() const;

  TemplatePlaces places() const { return {position_m_, height_m_, cascade_.templates.count, cascade_.tiles}; }

 private:
  void read_tiles(const VersionFolder& folder, std::size_t templates);

  std::vector<MappedFile> files_;
  std::optional<ArrayFile> tiles_;
  FaissCodes codes_;
  const float *position_m_, *height_m_;
  Cascade cascade_;
};

}  // namespace firstfix::version
