// Parsers of the service's documents. Every field is checked.
#include "firstfix/answer/documents.hpp"

#include <cmath>
#include <nlohmann/json.hpp>

namespace firstfix {
namespace {

using Json = nlohmann::json;

[[noreturn]] void unreadable(const std::string& what) {
  throw Error("unreadable", "not an answer of a firstfix service: " + what);
}

Json parsed(std::string_view document) {
  Json data = Json::parse(document.begin(), document.end(), nullptr, false);
  if (!data.is_object()) unreadable("not a JSON object");
  return data;
}

// Null is treated as missing.
const Json* member(const Json& object, const char* name) {
  if (!object.is_object()) return nullptr;
  const auto found = object.find(name);
  return found == object.end() || found->is_null() ? nullptr : &*found;
}

double number(const Json* value, const char* name) {
  if (value == nullptr || !value->is_number()) unreadable(std::string(name) + " is not a number");
  return value->get<double>();
}

double number(const Json& object, const char* name) { return number(member(object, name), name); }

std::optional<double> optional_number(const Json& object, const char* name) {
  const Json* value = member(object, name);
  return value == nullptr ? std::nullopt : std::optional<double>(number(value, name));
}

std::string text(const Json& object, const char* name) {
  const Json* value = member(object, name);
  if (value == nullptr) return {};
  if (!value->is_string()) unreadable(std::string(name) + " is not a text");
  return value->get<std::string>();
}

template <std::size_t Count>
std::array<double, Count> numbers(const Json& object, const char* name) {
  const Json* list = member(object, name);
  if (list == nullptr || !list->is_array() || list->size() != Count) unreadable(std::string(name) + " is not a list of the right length");
  std::array<double, Count> values{};
  for (std::size_t i = 0; i < Count; ++i) values[i] = number(&(*list)[i], name);
  return values;
}

const Json::array_t& list_of(const Json& object, const char* name) {
  static const Json::array_t nothing;
  const Json* value = member(object, name);
  if (value == nullptr) return nothing;
  if (!value->is_array()) unreadable(std::string(name) + " is not a list");
  return value->get_ref<const Json::array_t&>();
}

Pose pose_of(const Json& data) {
  const Pose pose{numbers<3>(data, "position"), numbers<4>(data, "quaternion")};
  if (!detail::usable(pose)) unreadable("a quaternion has the length 0");
  return detail::normalised(pose);
}

std::optional<Pose> optional_pose(const Json& data, const char* name) {
  const Json* value = member(data, name);
  if (value == nullptr) return std::nullopt;
  return pose_of(*value);
}

Hypothesis hypothesis_of(const Json& data) {
  const Json* pose = member(data, "T_map_sensor");
  if (pose == nullptr) unreadable("a hypothesis has no pose");
  Hypothesis made{pose_of(*pose), std::nullopt, number(data, "probability"), 0, text(data, "map_id")};
  if (member(data, "inlier_ratio") != nullptr) {
    made.quality = AlignmentQuality{number(data, "inlier_ratio"), number(data, "alignment_score"), number(data, "free_space_violation"),
                                    number(data, "removed_surface"), optional_number(data, "seen_free")};
  }
  const Json* row = member(data, "template");
  if (row == nullptr || !row->is_number_integer()) unreadable("a hypothesis has no template");
  made.template_row = row->get<long long>();
  return made;
}

Hint hint_of(const Json& data) {
  const Json* goal = member(data, "T_sensor_goal");
  if (goal == nullptr) unreadable("a hint has no goal");
  Hint made{pose_of(*goal), number(data, "distance_m"), number(data, "turn_deg"), number(data, "separation"), {}};
  for (const Json& one : list_of(data, "tells_apart")) {
    if (!one.is_number_integer()) unreadable("tells_apart is not a list of numbers of hypotheses");
    made.tells_apart.push_back(one.get<long long>());
  }
  return made;
}

Verdict verdict_of(const std::string& name) {
  for (const Verdict verdict : {Verdict::localized, Verdict::ambiguous, Verdict::rejected}) {
    if (name == text_of(verdict)) return verdict;
  }
  unreadable("unknown verdict");
}

FreeDirection free_direction_of(const Json& data) {
  const std::string motion = text(data, "motion");
  if (motion != "translation" && motion != "rotation") unreadable("unknown motion of a free direction");
  return {motion == "rotation", numbers<3>(data, "direction"), number(data, "sigma")};
}

Finding finding_of(const Json& data) {
  Finding made{text(data, "code"), text(data, "severity"), text(data, "text"), text(data, "remedy"), {}, text(data, "doc")};
  if (const Json* numbers = member(data, "numbers")) {
    if (!numbers->is_object()) unreadable("the numbers of a finding are not an object");
    for (const auto& [name, value] : numbers->items()) made.numbers[name] = number(&value, "a number of a finding");
  }
  return made;
}

ScanFacts facts_of(const Json& data) {
  ScanFacts made;
  made.points = static_cast<long long>(number(data, "points"));
  made.valid = static_cast<long long>(number(data, "valid"));
  made.in_range = static_cast<long long>(number(data, "in_range"));
  made.median_range_m = optional_number(data, "median_range_m");
  made.largest_range_m = optional_number(data, "largest_range_m");
  if (const auto rings = optional_number(data, "rings")) made.rings = static_cast<long long>(*rings);
  made.plane_ratio = optional_number(data, "plane_ratio");
  made.time_span_s = optional_number(data, "time_span_s");
  return made;
}

std::size_t whole(const Json& object, const char* name) {
  const double value = number(object, name);
  if (!(value >= 0 && value <= 1e6 && value == std::floor(value))) unreadable(std::string(name) + " is not a count");
  return static_cast<std::size_t>(value);
}

DescriptorParameters parameters_of(const Json& engine) {
  const Json* described = member(engine, "descriptor");
  const Json* used = member(engine, "preprocess");
  if (described == nullptr || used == nullptr) throw Error("unsupported_format", "this is not the engine of a map");
  if (text(*described, "kind") != "occupancy") {
    throw Error("unsupported_format", "this client cannot compute the descriptor of the map");
  }
  DescriptorParameters made;
  made.min_range_m = number(*used, "min_range_m");
  made.max_range_m = number(*used, "max_range_m");
  made.voxel_m = number(*used, "voxel_m");
  made.default_height_m = number(*used, "default_height_m");
  LayeredOccupancy grid;
  grid.rings = whole(*described, "rings");
  grid.sectors = whole(*described, "sectors");
  grid.max_range_m = number(*described, "max_range_m");
  grid.layer_edges_m.clear();
  for (const Json& edge : list_of(*described, "layer_edges_m")) {
    grid.layer_edges_m.push_back(number(&edge, "layer_edges_m"));
  }
  made.descriptor = grid;
  detail::check(made);
  return made;
}

// Any error in a map's engine means a format that this client does not support.
DescriptorParameters usable_parameters(const Json& engine) {
  try {
    return parameters_of(engine);
  } catch (const Error& error) {
    throw Error("unsupported_format", error.detail());
  }
}

}  // namespace

Localization parse_localization(std::string_view document) {
  const Json data = parsed(document);
  Localization made;
  made.verdict = verdict_of(text(data, "verdict"));
  for (const Json& reason : list_of(data, "reasons")) {
    if (!reason.is_string()) unreadable("a reason is not a text");
    made.reasons.push_back(reason.get<std::string>());
  }
  made.T_map_sensor = optional_pose(data, "T_map_sensor");
  made.T_map_base = optional_pose(data, "T_map_base");
  if (made.T_map_sensor.has_value() != (made.verdict == Verdict::localized)) {
    unreadable("an answer must have a pose if and only if it is localized");
  }
  if (member(data, "covariance") != nullptr) made.covariance = numbers<36>(data, "covariance");
  for (const Json& one : list_of(data, "degenerate")) made.degenerate.push_back(free_direction_of(one));
  for (const Json& one : list_of(data, "findings")) made.findings.push_back(finding_of(one));
  if (const Json* scan = member(data, "scan")) made.scan = facts_of(*scan);
  if (const Json* twist = member(data, "twist")) {
    made.twist = Twist{numbers<3>(*twist, "linear"), numbers<3>(*twist, "angular")};
  }
  if (const Json* value = member(data, "probability")) made.probability = number(value, "probability");
  for (const Json& one : list_of(data, "hypotheses")) made.hypotheses.push_back(hypothesis_of(one));
  if (const Json* hint = member(data, "hint")) made.hint = hint_of(*hint);
  made.map_id = text(data, "map_id");
  made.map_version = text(data, "map_version");
  made.fix_id = text(data, "fix_id");
  if (const Json* provisional = member(data, "map_provisional")) {
    if (!provisional->is_boolean()) unreadable("map_provisional is neither true nor false");
    made.map_provisional = provisional->get<bool>();
  }
  if (const Json* timings = member(data, "timings_ms")) {
    if (!timings->is_object()) unreadable("timings_ms is not an object");
    for (const auto& [stage, ms] : timings->items()) made.timings_ms[stage] = number(&ms, "a timing");
  }
  return made;
}

GeoPose parse_geopose(std::string_view document) {
  const Json data = parsed(document);
  const Json* position = member(data, "position");
  const Json* turn = member(data, "quaternion");
  if (position == nullptr || turn == nullptr) unreadable("the position or the quaternion is missing");
  return {number(*position, "lat"),
          number(*position, "lon"),
          number(*position, "h"),
          {number(*turn, "x"), number(*turn, "y"), number(*turn, "z"), number(*turn, "w")}};
}

MapPage parse_maps(std::string_view document) {
  const Json data = parsed(document);
  MapPage page;
  for (const Json& one : list_of(data, "maps")) {
    page.maps.push_back({text(one, "map_id"), std::nullopt});
    if (member(one, "active_version") != nullptr) page.maps.back().active_version = text(one, "active_version");
  }
  if (member(data, "next") != nullptr) page.next = text(data, "next");
  return page;
}

DescriptorParameters parse_engine(std::string_view engine) {
  const Json data = Json::parse(engine.begin(), engine.end(), nullptr, false);
  return usable_parameters(data);
}

DescriptorParameters parse_descriptor_parameters(std::string_view map_record) {
  const Json data = parsed(map_record);
  const Json* manifest = member(data, "manifest");
  if (manifest == nullptr) throw Error("not_found", "no version of the map is active");
  const Json* engine = member(*manifest, "engine");
  return usable_parameters(engine == nullptr ? Json() : *engine);
}

std::optional<Error> parse_problem(std::string_view document, long status) {
  const Json data = Json::parse(document.begin(), document.end(), nullptr, false);
  const Json* code = member(data, "code");
  if (code != nullptr && code->is_string()) {
    for (const char* name : {"detail", "title"}) {
      const Json* said = member(data, name);
      if (said != nullptr && said->is_string() && !said->get_ref<const std::string&>().empty()) {
        return Error(code->get<std::string>(), said->get<std::string>());
      }
    }
    return Error(code->get<std::string>(), code->get<std::string>());
  }
  if (status == 503) return Error("overloaded", "the service, or a proxy in front of it, answered 503");
  return std::nullopt;
}

}  // namespace firstfix
