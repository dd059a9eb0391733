#include "engine_numbers.hpp"

#include <algorithm>
#include <utility>
#include <vector>

#include "fields.hpp"
#include "ranking_numbers.hpp"

namespace firstfix::version {

namespace {

Effort effort_in(const Json& search, const char* name) {
  const Json& effort = field(search, name);
  return {whole_in(effort, "clusters", 1, 1'000'000), whole_in(effort, "screened", 1, 100'000), whole_in(effort, "candidates", 1, 1000)};
}

}  // namespace

// The ranges are those of firstfix.engine.config.
EngineNumbers engine_numbers(const MappedFile& file) {
  const Json engine = parsed(reinterpret_cast<const char*>(file.data()), file.size(), file.name());
  const Json &described = field(engine, "descriptor"), &prepared = field(engine, "preprocess"), &search = field(engine, "search"),
             &registered = field(engine, "registration"), &nearby = field(engine, "nearby"), &verified = field(engine, "verification"),
             &aliases = field(search, "aliases"), &ranking = field(engine, "ranking");
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
                     {whole_in(search, "clusters", 1, 100'000), whole_in(search, "candidates", 1, 100), whole_in(search, "widened", 1, 100),
                      effort_in(search, "wide"), effort_in(search, "exhaustive")},
                     {},
                     {number_in(registered, "map_voxel_m", 0.01, 5), number_in(registered, "coarse_voxel_m", 0.05, 20),
                      static_cast<int>(whole_in(registered, "coarse_iterations", 1, 200)),
                      static_cast<int>(whole_in(registered, "align_iterations", 1, 200)),
                      number_in(registered, "fine_distance_m", 0.01, 20), number_in(registered, "inlier_distance_m", 0.01, 5)},
                     {number_in(nearby, "reach_m", 0, 20), number_in(nearby, "step_m", 0.1, 5), whole_in(nearby, "points", 10, 10'000),
                      number_in(nearby, "worse_by", 0, 1), whole_in(nearby, "refined", 1, 50), number_in(nearby, "apart_m", 0, 5),
                      number_in(nearby, "apart_deg", 0, 90), number_in(nearby, "better_by", 0, 1)},
                     {number_in(aliases, "near_m", 0, 1000), number_in(aliases, "behind", 0, 1), whole_in(aliases, "templates", 1, 100),
                      whole_in(aliases, "screened", 1, 1000), whole_in(aliases, "tried", 1, 1000)},
                     ranking_numbers(ranking),
                     number_in(ranking, "spots_apart_m", 0, 1e9),
                     number_in(verified, "reach_m", 1, 200),
                     whole_in(verified, "compared", 1, 1000)};
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
