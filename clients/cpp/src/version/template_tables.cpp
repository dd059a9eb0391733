#include "template_tables.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "firstfix/descriptor/occupied_cells.hpp"
#include "firstfix/query/template_places.hpp"
#include "poses.hpp"

namespace firstfix::version {
namespace {

// As firstfix.engine.candidates.
constexpr double kSpotM = 2.0, kSpotDeg = 20.0;
constexpr std::size_t kMostPerSpot = 3;

}  // namespace

TemplateTables::TemplateTables(const VersionFolder& folder) : numbers(engine_numbers(folder.file("engine.json"))) {
  const auto array = [&](const char* name) {
    files_.push_back(folder.file(std::string(name) + ".npy"));
    return npy_array(files_.back());
  };
  const Array position = array("template_position_m"), representative = array("cluster_representative");
  const std::size_t templates = position.shape[0], clusters = representative.shape[0];
  if (templates == 0 || templates >= std::size_t{1} << 31) throw Error("corrupt_version", "there are no templates, or too many");
  position_m_ = position.of<float>("template_position_m", {templates, 3});
  height_m_ = array("template_height_m").of<float>("template_height_m", {templates});
  const auto are_finite = [](const float* first, std::size_t count) {
    return std::all_of(first, first + count, [](float number) { return std::isfinite(number); });
  };
  if (!are_finite(position_m_, 3 * templates) || !are_finite(height_m_, templates)) {
    throw Error("corrupt_version", "a template's position or height is not finite");
  }
  cascade_.position_m = position_m_;
  cascade_.templates = {array("template_occupancy").of<std::uint8_t>("template_occupancy", {templates, numbers.grid.bytes()}), templates,
                        numbers.grid.layers() * numbers.grid.rings, numbers.grid.sectors};
  cascade_.clusters = {representative.of<std::int32_t>("cluster_representative", {clusters}),
                       array("cluster_start").of<std::int32_t>("cluster_start", {clusters + 1}),
                       array("cluster_member").of<std::int32_t>("cluster_member", {templates}), clusters};
  cascade_.form.coefficients = numbers.coefficients;
  if (folder.has("key_projection.npy")) {
    const std::size_t spectra = cascade_.templates.rings * std::min(numbers.coefficients, numbers.grid.sectors / 2 + 1);
    const Array projection = array("key_projection");
    cascade_.form.projection = projection.of<float>("key_projection", {spectra, 0});
    cascade_.form.columns = projection.shape[1];
  }
  read_tiles(folder, templates);
  if (!folder.has("keys.faiss")) {
    throw Error("incompatible_version", "the version's keys are in shards, or searched by another engine: only a service reads them");
  }
  files_.push_back(folder.file("keys.faiss"));
  codes_ = faiss_codes(files_.back());
  cascade_.keys = codes_.view();
  try {
    cascade_.check();
  } catch (const std::invalid_argument& error) {
    throw Error("corrupt_version", error.what());
  }
}

std::vector<Candidate> TemplateTables::candidates(const std::vector<float>& seen, const ScanDescriptor* described,
                                                  const LevelledFrame& frame, const std::optional<Prior>& prior,
                                                  const Wanted& wanted) const {
  std::vector<std::uint8_t> occupancy(numbers.grid.bytes());
  const std::int64_t start[] = {0, static_cast<std::int64_t>(seen.size() / 3)};
  const auto height_m = static_cast<float>(frame.height_m);
  Rotation R;
  for (std::size_t i = 0; i < 9; ++i) R[i] = static_cast<float>(frame.R_level_sensor[i / 3][i % 3]);
  if (described != nullptr) occupancy = described->occupancy;
  else occupied_cells(seen.data(), start, &height_m, 1, &R, numbers.grid, occupancy.data());
  std::optional<HeadingPrior> headings;
  Matches matches;
  if (prior) {
    headings = HeadingPrior{numbers.T_map_level, prior->yaw_deg, prior->yaw_range_deg + kYawSlackDeg};
    matches = cascade_.search_near(occupancy.data(), in_level(numbers.T_map_level, prior->position), prior->radius_m + numbers.spacing_m,
                                   wanted.clusters);
  } else {
    matches = cascade_.search(occupancy.data(), wanted.clusters);
  }
  const Spot spot{kSpotM, std::cos(kSpotDeg * (detail::kPi / 180)), kMostPerSpot};
  const Candidates found = candidates_of(matches, position_m_, height_m_, frame, headings ? &*headings : nullptr, wanted.most,
                                         wanted.is_spread ? &spot : nullptr);
  std::vector<Candidate> made;
  for (std::size_t i = 0; i < found.templates.size(); ++i) {
    made.push_back({found.templates[i], found.T_level_sensor[i], static_cast<double>(found.score[i])});
  }
  return made;
}

double TemplateTables::usual_height_m() const {
  std::vector<float> sorted(height_m_, height_m_ + cascade_.templates.count);
  std::sort(sorted.begin(), sorted.end());
  const std::size_t middle = sorted.size() / 2;
  return static_cast<double>(sorted.size() % 2 == 1 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2);
}

void TemplateTables::read_tiles(const VersionFolder& folder, std::size_t templates) {
  const ArrayFile& file = tiles_.emplace(folder.file("template_tiles.safetensors"));
  TemplateTiles& tiles = cascade_.tiles;
  const auto* low = file.of<std::int32_t>("low", {2});
  tiles.row = file.of<std::int32_t>("row", {templates});
  tiles.begin = file.of<std::int32_t>("begin", {0, 0});
  const std::size_t columns = file.shape("begin", 0), ends = file.shape("begin", 1);
  if (columns == 0 || ends == 0) file.refuse("it has no tiles");
  tiles.columns = columns, tiles.rows = ends - 1;
  tiles.low[0] = low[0], tiles.low[1] = low[1];
}

}  // namespace firstfix::version
