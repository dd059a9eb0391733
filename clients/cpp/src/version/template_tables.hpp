// The templates of a version, memory-mapped, and those that resemble a prepared scan.
#pragma once

#include <optional>
#include <vector>

#include "arrays.hpp"
#include "engine_numbers.hpp"
#include "firstfix/query/searched_map.hpp"
#include "firstfix/query/similar_places.hpp"
#include "firstfix/retrieval/cascade.hpp"
#include "version_folder.hpp"

namespace firstfix::version {

class TemplateTables {
 public:
  explicit TemplateTables(const VersionFolder& folder);

  const EngineNumbers numbers;

  // How templates are found that resemble a scan. It refers to this.
  Describe describe() const { return by_occupancy(cascade_, numbers.grid); }

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
