#include "template_tables.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>


namespace firstfix::version {

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
