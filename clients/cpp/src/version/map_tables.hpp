// The surface, the free space and the aliases of a version, as a search reads them: memory-mapped.
#pragma once

#include <optional>
#include <vector>

#include "arrays.hpp"
#include "firstfix/registration/surface_grid.hpp"
#include "firstfix/retrieval/alias_table.hpp"
#include "firstfix/verification/point_tiles.hpp"
#include "firstfix/verification/seen_free.hpp"
#include "version_folder.hpp"

namespace firstfix::version {

class MapTables {
  std::vector<ArrayFile> files_;  // first: the tables lie in them

 public:
  // Throws Error "corrupt_version" if a file is missing, or a table has another type or size, or a length that is not finite.
  // Numbers that point into other tables are compared with these where they are read.
  // templates: how many the version has.
  MapTables(const VersionFolder& folder, std::size_t templates);

  SurfaceGrid fine, coarse;
  PointTiles near, far;
  std::optional<SeenFree> seen_free;      // nothing: it is not known
  std::optional<AliasTable> alias_table;  // nothing: of a provisional version

 private:
  const ArrayFile& opened(const VersionFolder& folder, const char* name);
  void release() const;  // the pages of the last file
};

}  // namespace firstfix::version
