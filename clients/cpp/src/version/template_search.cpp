#include "firstfix/version/template_search.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "arrays.hpp"
#include "engine_numbers.hpp"
#include "firstfix/descriptor/occupied_cells.hpp"
#include "firstfix/query/prepared_scan.hpp"
#include "firstfix/retrieval/candidates.hpp"
#include "firstfix/retrieval/cascade.hpp"
#include "version_folder.hpp"

namespace firstfix {
namespace {

using version::Array;
using version::MappedFile;
using version::VersionFolder;

// As firstfix.engine.candidates.
constexpr double kSpotM = 2.0, kSpotDeg = 20.0, kYawSlackDeg = 10.0;
constexpr std::size_t kMostPerSpot = 3;
constexpr double kMaxRadiusM = 1e6;
constexpr PoseMatrix kSameFrame{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

double radians(double degrees) { return degrees * (detail::kPi / 180); }

PoseMatrix product(const PoseMatrix& a, const PoseMatrix& b) {
  PoseMatrix made{};
  for (std::size_t row = 0; row < 4; ++row) {
    for (std::size_t column = 0; column < 4; ++column) {
      for (std::size_t k = 0; k < 4; ++k) made[4 * row + column] += a[4 * row + k] * b[4 * k + column];
    }
  }
  return made;
}

// A point of the map in the frame of the templates.
detail::Vector3 in_level(const PoseMatrix& T_map_level, const std::array<double, 3>& point_m) {
  detail::Vector3 made{};
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t k = 0; k < 3; ++k) made[row] += T_map_level[4 * k + row] * (point_m[k] - T_map_level[4 * k + 3]);
  }
  return made;
}

void check(const SimilarPlacesOptions& options) {
  const auto require = [](bool holds, const char* message) {
    if (!holds) throw Error("invalid_option", message);
  };
  const auto are_finite = [](const std::array<double, 3>& v) {
    return std::isfinite(v[0]) && std::isfinite(v[1]) && std::isfinite(v[2]);
  };
  if (options.gravity) {
    const detail::Vector3& down = *options.gravity;
    require(are_finite(down) && detail::dot(down, down) > 1e-12 && detail::dot(down, down) < 1e18, "gravity has no direction");
  }
  if (options.prior) {
    const Prior& prior = *options.prior;
    require(are_finite(prior.position) && std::isfinite(prior.yaw_deg), "a number of the prior is not finite");
    require(prior.radius_m > 0 && prior.radius_m <= kMaxRadiusM, "the prior's radius_m must lie in (0, 1e6]");
    require(prior.yaw_range_deg > 0 && prior.yaw_range_deg <= 180, "the prior's yaw_range_deg must lie in (0, 180]");
  }
  require(!options.T_base_sensor || detail::usable(*options.T_base_sensor), "T_base_sensor is not a valid pose");
  require(!options.max_places || *options.max_places > 0, "max_places must be at least 1");
}

// Up in the sensor frame: the opposite of gravity, or where it is expected.
Levelling levelling_of(const SimilarPlacesOptions& options, double default_height_m) {
  if (options.gravity) {
    const detail::Vector3& down = *options.gravity;
    return {{-down[0], -down[1], -down[2]}, true, std::nullopt, default_height_m};
  }
  detail::Vector3 up{0, 0, 1};
  if (options.T_base_sensor) {
    const auto [x, y, z, w] = detail::normalised(*options.T_base_sensor).quaternion;
    up = {2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)};
  }
  return {up, false, std::nullopt, default_height_m};
}

}  // namespace

struct TemplateSearch::Tables {
  explicit Tables(const VersionFolder& folder)
      : version(folder.version()), numbers(version::engine_numbers(folder.file("engine.json"))) {
    const auto array = [&](const char* name) {
      files.push_back(folder.file(std::string(name) + ".npy"));
      return version::npy_array(files.back());
    };
    const Array position = array("template_position_m"), representative = array("cluster_representative");
    const std::size_t templates = position.shape[0], clusters = representative.shape[0];
    if (templates == 0 || templates >= std::size_t{1} << 31) throw Error("corrupt_version", "there are no templates, or too many");
    position_m = position.of<float>("template_position_m", {templates, 3});
    height_m = array("template_height_m").of<float>("template_height_m", {templates});
    cascade.position_m = position_m;
    cascade.templates = {array("template_occupancy").of<std::uint8_t>("template_occupancy", {templates, numbers.grid.bytes()}), templates,
                         numbers.grid.layers() * numbers.grid.rings, numbers.grid.sectors};
    cascade.clusters = {representative.of<std::int32_t>("cluster_representative", {clusters}),
                        array("cluster_start").of<std::int32_t>("cluster_start", {clusters + 1}),
                        array("cluster_member").of<std::int32_t>("cluster_member", {templates}), clusters};
    cascade.form.coefficients = numbers.coefficients;
    if (folder.has("key_projection.npy")) {
      const std::size_t spectra = cascade.templates.rings * std::min(numbers.coefficients, numbers.grid.sectors / 2 + 1);
      const Array projection = array("key_projection");
      cascade.form.projection = projection.of<float>("key_projection", {spectra, 0});
      cascade.form.columns = projection.shape[1];
    }
    read_tiles(folder, templates);
    if (!folder.has("keys.faiss")) {
      throw Error("incompatible_version", "the version's keys are in shards, or searched by another engine: only a service reads them");
    }
    files.push_back(folder.file("keys.faiss"));
    codes = version::faiss_codes(files.back());
    cascade.keys = codes.view();
    try {
      cascade.check();
    } catch (const std::invalid_argument& error) {
      throw Error("corrupt_version", error.what());
    }
  }

  std::string version;
  version::EngineNumbers numbers;
  std::vector<MappedFile> files;
  version::FaissCodes codes;
  const float *position_m, *height_m;
  Cascade cascade;

 private:
  void read_tiles(const VersionFolder& folder, std::size_t templates) {
    const std::string name = "template_tiles.safetensors";
    files.push_back(folder.file(name));
    const auto arrays = version::named_arrays(files.back());
    for (const char* one : {"row", "begin", "low"}) {
      if (arrays.count(one) == 0) files.back().refuse("an array is missing");
    }
    const Array& begin = arrays.at("begin");
    const auto* low = arrays.at("low").of<std::int32_t>(name, {2});
    cascade.tiles.row = arrays.at("row").of<std::int32_t>(name, {templates});
    cascade.tiles.begin = begin.of<std::int32_t>(name, {0, 0});
    if (begin.shape[0] == 0 || begin.shape[1] == 0) files.back().refuse("it has no tiles");
    cascade.tiles.columns = begin.shape[0], cascade.tiles.rows = begin.shape[1] - 1;
    cascade.tiles.low[0] = low[0], cascade.tiles.low[1] = low[1];
  }
};

TemplateSearch::TemplateSearch(const std::string& folder) : tables_(std::make_unique<Tables>(VersionFolder(folder))) {}
TemplateSearch::~TemplateSearch() = default;
TemplateSearch::TemplateSearch(TemplateSearch&&) noexcept = default;
TemplateSearch& TemplateSearch::operator=(TemplateSearch&&) noexcept = default;

const std::string& TemplateSearch::version() const { return tables_->version; }

std::vector<SimilarPlace> TemplateSearch::find(const Scan& scan, const SimilarPlacesOptions& options) const {
  check(options);
  const Tables& tables = *tables_;
  const version::EngineNumbers& numbers = tables.numbers;
  if (scan.points.size() > kMaxPoints) throw Error("too_large", "the scan has over 2,000,000 points");
  const Scan usable = cleaned(scan);
  const std::size_t count = usable.points.size();
  const float* time_s = usable.time_s ? usable.time_s->data() : nullptr;
  for (std::size_t i = 0; time_s != nullptr && i < count; ++i) {
    if (!(std::fabs(static_cast<double>(time_s[i])) <= kMaxAbsTime)) throw Error("invalid_scan", "a time is over 1 s from the stamp, or not a number");
  }
  const auto prepared = prepared_scan(numbers_of(usable.points), time_s, count, numbers.preparation, levelling_of(options, numbers.default_height_m));
  if (!prepared) return {};
  std::vector<std::uint8_t> occupancy(numbers.grid.bytes());
  const std::int64_t start[] = {0, static_cast<std::int64_t>(prepared->seen.size() / 3)};
  const auto height_m = static_cast<float>(prepared->height_m);
  Rotation R;
  for (std::size_t i = 0; i < 9; ++i) R[i] = static_cast<float>(prepared->R_level_sensor[i / 3][i % 3]);
  occupied_cells(prepared->seen.data(), start, &height_m, 1, &R, numbers.grid, occupancy.data());
  std::optional<HeadingPrior> headings;
  Matches matches;
  if (options.prior) {
    const Prior& prior = *options.prior;
    headings = HeadingPrior{numbers.T_map_level, prior.yaw_deg, prior.yaw_range_deg + kYawSlackDeg};
    matches = tables.cascade.search_near(occupancy.data(), in_level(numbers.T_map_level, prior.position),
                                         prior.radius_m + numbers.spacing_m, numbers.clusters);
  } else {
    matches = tables.cascade.search(occupancy.data(), numbers.clusters);
  }
  const Spot spot{kSpotM, std::cos(radians(kSpotDeg)), kMostPerSpot};
  const LevelledFrame frame{prepared->R_level_sensor, prepared->height_m, kSameFrame};
  const Candidates found = candidates_of(matches, tables.position_m, tables.height_m, frame, headings ? &*headings : nullptr,
                                         options.max_places.value_or(numbers.candidates), &spot);
  std::vector<SimilarPlace> places;
  for (std::size_t i = 0; i < found.templates.size(); ++i) {
    places.push_back({product(numbers.T_map_level, found.T_level_sensor[i]), static_cast<double>(found.score[i]), found.templates[i]});
  }
  return places;
}

}  // namespace firstfix
