#include "engine_numbers.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include "fields.hpp"

namespace firstfix::version {

// The ranges are those of firstfix.engine.config.
EngineNumbers engine_numbers(const MappedFile& file) {
  const Json engine = parsed(reinterpret_cast<const char*>(file.data()), file.size(), file.name());
  const Json &described = field(engine, "descriptor"), &prepared = field(engine, "preprocess"), &search = field(engine, "search"),
             &ranking = field(engine, "ranking");
  if (text_in(described, "kind") != "occupancy") {
    throw Error("incompatible_version", "the templates have another descriptor than the default one, which only a service compares");
  }
  std::vector<float> edges_m;
  for (const double edge_m : numbers_in(described, "layer_edges_m", 2, 17, 1e6)) edges_m.push_back(static_cast<float>(edge_m));
  if (!std::is_sorted(edges_m.begin(), edges_m.end())) file.refuse("layer_edges_m does not ascend");
  EngineNumbers made{LayeredGrid::of(whole_in(described, "rings", 2, 200), whole_in(described, "sectors", 8, 720),
                                     number_in(described, "max_range_m", 1, 500), std::move(edges_m)),
                     whole_in(described, "coefficients", 1, 30),
                     {},
                     number_in(prepared, "default_height_m", 0, 1e6),
                     number_in(engine, "spacing_m", 0, 1e6),
                     whole_in(search, "clusters", 1, 100'000),
                     whole_in(search, "candidates", 1, 100),
                     {}};
  const auto points = [&](const char* name) { return whole_in(ranking, name, 1, 1 << 30); };
  made.preparation = {number_in(prepared, "min_range_m", 0, 1e9), number_in(prepared, "max_range_m", 1, 1e9),
                      number_in(prepared, "voxel_m", 0.01, 5),    whole_in(prepared, "min_points", 10, 1 << 30),
                      points("voxelled_points"),                  points("view_points"),
                      points("dense_points"),                     points("sparse_points")};
  const std::vector<double> T = numbers_in(engine, "T_map_level", 16, 16, 1e9);
  std::copy(T.begin(), T.end(), made.T_map_level.begin());
  return made;
}

}  // namespace firstfix::version
