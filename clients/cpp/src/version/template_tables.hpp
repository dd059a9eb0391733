// The templates of a version, memory-mapped, and those that resemble a prepared scan.
#pragma once

#include <optional>
#include <vector>

#include "arrays.hpp"
#include "engine_numbers.hpp"
#include "firstfix/answer/options.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/retrieval/candidates.hpp"
#include "firstfix/retrieval/cascade.hpp"
#include "version_folder.hpp"

namespace firstfix::version {

class TemplateTables {
 public:
  explicit TemplateTables(const VersionFolder& folder);

  const EngineNumbers numbers;

  // At most so many candidates that the prior allows, best first.
  Candidates candidates(const PreparedScan& scan, const std::optional<Prior>& prior, std::size_t most) const;

 private:
  void read_tiles(const VersionFolder& folder, std::size_t templates);

  std::vector<MappedFile> files_;
  std::optional<ArrayFile> tiles_;
  FaissCodes codes_;
  const float *position_m_, *height_m_;
  Cascade cascade_;
};

}  // namespace firstfix::version
