// Compares this client with the golden vectors (clients/conformance). Prints the vectors that fail. The last line counts
// the vectors, and the bodies that are equal including their compression.
#include <cmath>
#include <cstdio>
#include <exception>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "firstfix/signature.hpp"
#include "programs.hpp"
#include "vectors.hpp"

namespace firstfix::test {
namespace {

using Json = nlohmann::json;

Scan read_scan(const std::string& folder, const Json& given) {
  const std::vector<float> values = read_floats(folder + given.at("points").get<std::string>());
  Scan scan;
  for (int k = given.value("repeat", 1); k > 0; --k) {
    for (std::size_t i = 0; i + 2 < values.size(); i += 3) {
      scan.points.push_back({values[i], values[i + 1], values[i + 2]});
    }
  }
  if (given.contains("intensity")) scan.intensity = read_floats(folder + given.at("intensity").get<std::string>());
  if (given.contains("times")) {
    const auto [first_s, apart_s] = given.at("times").get<std::array<double, 2>>();
    scan.time_s.emplace();
    for (std::size_t i = 0; i < scan.points.size(); ++i) {
      scan.time_s->push_back(static_cast<float>(first_s + apart_s * static_cast<double>(i)));
    }
  }
  if (given.contains("stamp_s")) scan.stamp_s = given.at("stamp_s").get<double>();
  return scan;
}

Pose pose_of(const Json& data) {
  return {data.at("position").get<std::array<double, 3>>(), data.at("quaternion").get<std::array<double, 4>>()};
}

struct Result {
  std::optional<Bytes> body;  // absent: the result is a value
  Json value;
};

using Function = std::function<Result(const std::string&, const Json&, const Json&)>;

std::optional<double> optional_number(const Json& data, const char* name) {
  return data.contains(name) ? std::optional<double>(data.at(name).get<double>()) : std::nullopt;
}

ScanForm form_of(const Json& parameters) {
  const auto name = parameters.value("form", std::string("points"));
  if (name != "points" && name != "range_image") throw Error("invalid_option", "a scan has no form " + name);
  return name == "points" ? ScanForm::points : ScanForm::range_image;
}

DescriptorParameters parameters_of(const Json& parameters) {
  return parameters.contains("engine") ? parse_engine(parameters.at("engine").dump()) : DescriptorParameters{};
}

std::optional<Gravity> gravity_of(const Json& parameters) {
  if (!parameters.contains("gravity")) return std::nullopt;
  return parameters.at("gravity").get<Gravity>();
}

Result encode_scan_vector(const std::string& folder, const Json& input, const Json& parameters) {
  const Scan scan = read_scan(folder, input);
  return {encode_scan(scan, optional_number(parameters, "resolution_m"), optional_number(parameters, "voxel_m"),
                      form_of(parameters)),
          {}};
}

Result decode_scan_vector(const std::string& folder, const Json& input, const Json& parameters) {
  const Scan scan = decode_scan(read_body(folder, input.at("body").get<std::string>()));
  return {encode_scan(scan, optional_number(parameters, "resolution_m"), std::nullopt, form_of(parameters)), {}};
}

Result encode_scans_vector(const std::string& folder, const Json& input, const Json& parameters) {
  ScanSequence sequence;
  for (const Json& one : input.at("scans")) {
    const Scan scan = read_scan(folder, one);
    if (one.value("compact", false)) {
      sequence.scans.emplace_back(condense(scan));
    } else {
      sequence.scans.emplace_back(scan);
    }
  }
  for (const Json& one : input.at("poses")) sequence.T_odom_sensor.push_back(pose_of(one));
  return {encode_scans(sequence, optional_number(parameters, "resolution_m"), optional_number(parameters, "voxel_m"),
                       form_of(parameters)),
          {}};
}

Result decode_scans_vector(const std::string& folder, const Json& input, const Json&) {
  const ScanSequence sequence = decode_scans(read_body(folder, input.at("body").get<std::string>()));
  return {std::nullopt, sequence.scans.size()};
}

Result compact_query_vector(const std::string& folder, const Json& input, const Json& parameters) {
  const CompactScan compact = condense(read_scan(folder, input), parameters_of(parameters), gravity_of(parameters),
                                       parameters.value("points", std::size_t{2500}));
  return {encode_query(compact, parameters.value("resolution_m", 0.02)), {}};
}

Result descriptor_query_vector(const std::string& folder, const Json& input, const Json& parameters) {
  return {encode_query(describe(read_scan(folder, input), parameters_of(parameters), gravity_of(parameters))), {}};
}

Result decode_query_vector(const std::string& folder, const Json& input, const Json& parameters) {
  const Query query = decode_query(read_body(folder, input.at("body").get<std::string>()));
  const auto* compact = std::get_if<CompactScan>(&query);
  if (compact == nullptr) return {encode_query(std::get<ScanDescriptor>(query)), {}};
  return {encode_query(*compact, parameters.value("resolution_m", 0.02)), {}};
}

Result descriptor_parameters_vector(const std::string&, const Json& input, const Json&) {
  const DescriptorParameters known = parse_engine(input.at("engine").dump());
  const LayeredOccupancy& grid = known.descriptor.value();
  return {std::nullopt,
          {{"min_range_m", known.min_range_m},
           {"max_range_m", known.max_range_m},
           {"voxel_m", known.voxel_m},
           {"default_height_m", known.default_height_m},
           {"rings", grid.rings},
           {"sectors", grid.sectors},
           {"descriptor_max_range_m", grid.max_range_m},
           {"layer_edges_m", grid.layer_edges_m}}};
}

Result options_vector(const std::string&, const Json& input, const Json&) {
  LocalizeOptions options;
  options.gravity = gravity_of(input);
  if (input.contains("prior")) {
    const auto numbers = input.at("prior").get<std::vector<double>>();
    options.prior = Prior{{numbers[0], numbers[1], numbers[2]}, numbers[3]};
    if (numbers.size() == 6) {
      options.prior->yaw_deg = numbers[4];
      options.prior->yaw_range_deg = numbers[5];
    }
  }
  if (input.contains("T_base_sensor")) options.T_base_sensor = pose_of(input.at("T_base_sensor"));
  if (input.contains("T_odom_base")) options.T_odom_base = pose_of(input.at("T_odom_base"));
  if (input.contains("max_candidates")) options.max_candidates = input.at("max_candidates").get<int>();
  options.min_probability = optional_number(input, "min_probability");
  options.max_false_accept = optional_number(input, "max_false_accept");
  options.deadline_ms = optional_number(input, "deadline_ms");
  if (input.contains("twist")) {
    const auto six = input.at("twist").get<std::array<double, 6>>();
    options.twist = Twist{{six[0], six[1], six[2]}, {six[3], six[4], six[5]}};
  }
  if (input.contains("version")) options.version = input.at("version").get<std::string>();
  Json value = Json::object();
  for (const auto& [name, text] : strings_of(options)) value[name] = text;
  return {std::nullopt, value};
}

Json json_of(const std::optional<Pose>& pose) {
  if (!pose) return nullptr;
  return {{"position", pose->position}, {"quaternion", pose->quaternion}};
}

Json json_of(const std::optional<Twist>& twist) {
  if (!twist) return nullptr;
  return {{"linear", twist->linear}, {"angular", twist->angular}};
}

Result answer_vector(const std::string& folder, const Json& input, const Json&) {
  const Localization fix = parse_localization(read_text(folder + input.at("document").get<std::string>()));
  Json hypotheses = Json::array();
  for (const Hypothesis& h : fix.hypotheses) {
    const bool laid = h.quality.has_value();
    hypotheses.push_back({{"T_map_sensor", json_of(h.T_map_sensor)},
                          {"inlier_ratio", laid ? Json(h.quality->inlier_ratio) : Json()},
                          {"alignment_score", laid ? Json(h.quality->alignment_score) : Json()},
                          {"free_space_violation", laid ? Json(h.quality->free_space_violation) : Json()},
                          {"removed_surface", laid ? Json(h.quality->removed_surface) : Json()},
                          {"seen_free", laid && h.quality->seen_free ? Json(*h.quality->seen_free) : Json()},
                          {"probability", h.probability},
                          {"template", h.template_row},
                          {"map_id", h.map_id}});
  }
  Json degenerate = Json::array();
  for (const FreeDirection& one : fix.degenerate) {
    degenerate.push_back({{"motion", one.is_rotation ? "rotation" : "translation"},
                          {"direction", one.direction},
                          {"sigma", one.sigma}});
  }
  Json findings = Json::array();
  for (const Finding& one : fix.findings) {
    findings.push_back({{"code", one.code},
                        {"severity", one.severity},
                        {"text", one.text},
                        {"numbers", one.numbers},
                        {"remedy", one.remedy},
                        {"doc", one.doc}});
  }
  Json scan;
  if (fix.scan) {
    const auto or_null = [](const auto& value) { return value ? Json(*value) : Json(); };
    scan = {{"points", fix.scan->points},
            {"valid", fix.scan->valid},
            {"in_range", fix.scan->in_range},
            {"median_range_m", or_null(fix.scan->median_range_m)},
            {"largest_range_m", or_null(fix.scan->largest_range_m)},
            {"rings", or_null(fix.scan->rings)},
            {"plane_ratio", or_null(fix.scan->plane_ratio)},
            {"time_span_s", or_null(fix.scan->time_span_s)}};
  }
  Json hint;
  if (fix.hint) {
    hint = {{"T_sensor_goal", json_of(fix.hint->T_sensor_goal)},
            {"distance_m", fix.hint->distance_m},
            {"turn_deg", fix.hint->turn_deg},
            {"separation", fix.hint->separation},
            {"tells_apart", fix.hint->tells_apart}};
  }
  return {std::nullopt,
          {{"verdict", text_of(fix.verdict)},
           {"reasons", fix.reasons},
           {"T_map_sensor", json_of(fix.T_map_sensor)},
           {"T_map_base", json_of(fix.T_map_base)},
           {"covariance", fix.covariance ? Json(*fix.covariance) : Json()},
           {"degenerate", degenerate},
           {"findings", findings},
           {"scan", scan},
           {"probability", fix.probability},
           {"hypotheses", hypotheses},
           {"hint", hint},
           {"map_id", fix.map_id},
           {"map_version", fix.map_version},
           {"map_provisional", fix.map_provisional},
           {"fix_id", fix.fix_id},
           {"timings_ms", fix.timings_ms},
           {"twist", json_of(fix.twist)}}};
}

Result geopose_vector(const std::string& folder, const Json& input, const Json&) {
  const GeoPose pose = parse_geopose(read_text(folder + input.at("document").get<std::string>()));
  const auto& [x, y, z, w] = pose.quaternion;
  return {std::nullopt,
          {{"position", {{"lat", pose.latitude_deg}, {"lon", pose.longitude_deg}, {"h", pose.height_m}}},
           {"quaternion", {{"x", x}, {"y", y}, {"z", z}, {"w", w}}}}};
}

std::string bytes_of(const Json& hexadecimal) {
  const Bytes bytes = from_hex(hexadecimal.get<std::string>());
  return {bytes.begin(), bytes.end()};
}

Result zenoh_query_vector(const std::string&, const Json& input, const Json&) {
  const QuerySigner signer(input.at("api_key").get<std::string>());
  const Asked asked{input.at("key").get<std::string>(),
                    input.at("parameters").get<std::vector<std::pair<std::string, std::string>>>(),
                    input.at("encoding").get<std::string>()};
  const Bytes random = from_hex(input.at("nonce").get<std::string>());
  Nonce nonce{};
  std::copy(random.begin(), random.end(), nonce.begin());
  std::string digits;
  for (const char c : signer.sign(asked, bytes_of(input.at("payload")), input.at("time_ms").get<std::uint64_t>(), nonce)) {
    digits.push_back("0123456789abcdef"[static_cast<unsigned char>(c) >> 4]);
    digits.push_back("0123456789abcdef"[static_cast<unsigned char>(c) & 15]);
  }
  return {std::nullopt, {{"attachment", digits}}};
}

Result zenoh_reply_vector(const std::string&, const Json& input, const Json&) {
  const QuerySigner signer(input.at("api_key").get<std::string>());
  const auto encoding =
      signer.checked_encoding(bytes_of(input.at("attachment")), input.at("is_ok").get<bool>(),
                              input.at("encoding").get<std::string>(), bytes_of(input.at("payload")));
  return {std::nullopt, {{"is_signed", encoding.has_value()}}};
}

Result problem_vector(const std::string& folder, const Json& input, const Json&) {
  const auto problem = parse_problem(read_text(folder + input.at("document").get<std::string>()),
                                     input.at("status").get<long>());
  if (!problem) return {std::nullopt, nullptr};
  return {std::nullopt, {{"code", problem->code()}, {"detail", problem->detail()}}};
}

const std::map<std::string, Function>& functions() {
  static const std::map<std::string, Function> all{
      {"encode_scan", encode_scan_vector},           {"decode_scan", decode_scan_vector},
      {"encode_scans", encode_scans_vector},         {"decode_scans", decode_scans_vector},
      {"compact_query", compact_query_vector},       {"descriptor_query", descriptor_query_vector},
      {"decode_query", decode_query_vector},         {"descriptor_parameters", descriptor_parameters_vector},
      {"options", options_vector},                   {"answer", answer_vector},
      {"geopose", geopose_vector},                   {"problem", problem_vector},
      {"zenoh_query", zenoh_query_vector},           {"zenoh_reply", zenoh_reply_vector},
  };
  return all;
}

std::optional<std::vector<double>> numbers_of(const std::string& text) {
  std::vector<double> numbers;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    char* end = nullptr;
    numbers.push_back(std::strtod(part.c_str(), &end));
    if (end != part.c_str() + part.size()) return std::nullopt;
  }
  return numbers;
}

// Whether two values are equal. Numbers may differ by 1e-9, also comma-separated numbers in a text.
bool alike(const Json& got, const Json& wanted) {
  if (got.is_number() && wanted.is_number()) return std::fabs(got.get<double>() - wanted.get<double>()) <= 1e-9;
  if (got.type() != wanted.type() || got.size() != wanted.size()) return false;
  if (wanted.is_object()) {
    for (const auto& [key, value] : wanted.items()) {
      if (!got.contains(key) || !alike(got.at(key), value)) return false;
    }
    return true;
  }
  if (wanted.is_array()) {
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      if (!alike(got[i], wanted[i])) return false;
    }
    return true;
  }
  if (wanted.is_string() && got != wanted) {
    const auto a = numbers_of(got.get<std::string>()), b = numbers_of(wanted.get<std::string>());
    return a && b && alike(*a, *b);
  }
  return got == wanted;
}

struct Counts {
  int failed = 0, passed = 0, bodies = 0, whole = 0;
};

// The reason why the vector fails; empty if it passes.
std::string difference(const std::string& folder, const Json& vector, Counts& counts) {
  const Json& expected = vector.at("expected");
  const auto& function = functions().at(vector.at("function").get<std::string>());
  Result got;
  try {
    got = function(folder, vector.at("input"), vector.value("parameters", Json::object()));
  } catch (const Error& error) {
    return error.code() == expected.value("error", "") ? "" : std::string("it throws ") + error.what();
  }
  if (expected.contains("error")) return "it is accepted, not refused as " + expected.at("error").get<std::string>();
  if (expected.contains("value")) return alike(got.value, expected.at("value")) ? "" : "it gives " + got.value.dump();
  if (!got.body) return "it gives no bytes";
  const Bytes wanted = read_body(folder, expected.at("body").get<std::string>());
  ++counts.bodies;
  if (*got.body == wanted) ++counts.whole;
  const bool same = plain_form({got.body->data(), got.body->size()}) == plain_form({wanted.data(), wanted.size()});
  return same ? "" : "it gives other bytes";
}

}  // namespace

int conformance(const std::string& folder) {
  const Json index = Json::parse(read_text(folder + "index.json"));
  Counts counts;
  for (const Json& vector : index.at("vectors")) {
    std::string wrong;
    try {
      wrong = difference(folder, vector, counts);
    } catch (const std::exception& error) {
      wrong = error.what();
    }
    ++(wrong.empty() ? counts.passed : counts.failed);
    if (!wrong.empty()) std::printf("%s: %s\n", vector.at("name").get<std::string>().c_str(), wrong.c_str());
  }
  std::printf("%d passed, %d failed; %d of %d bodies equal to the last byte (zstd %s here, %s there)\n", counts.passed,
              counts.failed, counts.whole, counts.bodies, ZSTD_versionString(),
              index.at("made_with").at("libzstd").get<std::string>().c_str());
  return counts.failed == 0 && counts.passed > 0 ? 0 : 1;
}

}  // namespace firstfix::test
