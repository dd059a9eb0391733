#include "firstfix/client.hpp"

#include <map>
#include <mutex>

#include "http.hpp"

namespace firstfix {
namespace {

constexpr std::size_t kMaxCompactBytes = 10'000, kFewestPoints = 500;

Request localize_request(const Bytes& body, const std::string& media_type, const std::string& map_id,
                         const LocalizeOptions& options, const RobotName& robot) {
  Request request{"localize", {{"map", map_id}}, {"Content-Type: " + media_type}, &body, true};
  if (robot) request.headers.push_back("X-Robot: " + checked_robot_name(*robot));
  for (auto& one : strings_of(options)) request.query.push_back(std::move(one));
  return request;
}

Scan sent(const Scan& scan) {
  Scan clean = cleaned(scan);
  clean.intensity.reset();  // localization does not use it
  return clean;
}

}  // namespace

// Descriptor parameters of maps, by map id.
struct Client::Parameters {
  std::mutex mutex;
  std::map<std::string, DescriptorParameters> by_map;
};

Client::Client(const std::string& url, Settings settings)
    : settings_(std::move(settings)),
      http_(std::make_unique<Http>(url, settings_)),
      parameters_(std::make_unique<Parameters>()) {}

Client::~Client() = default;

Localization Client::localize(const Scan& scan, const std::string& map_id, const LocalizeOptions& options,
                              Encoding encoding, const RobotName& robot) {
  if (encoding == Encoding::compact) {
    return localize_body(compact_body(condense(scan)), kQueryMediaType, map_id, options, robot);
  }
  if (encoding == Encoding::scan || encoding == Encoding::range_image) {
    const ScanForm form = encoding == Encoding::scan ? ScanForm::points : ScanForm::range_image;
    const Bytes body = encode_scan(sent(scan), settings_.resolution_m, settings_.voxel_m, form);
    return localize_body(body, kScanMediaType, map_id, options, robot);
  }
  bool known = false;
  try {
    return localize_described(scan, map_id, options, robot, &known);
  } catch (const Error& error) {
    if (!known || error.code() != "descriptor_mismatch") throw;
  }
  {
    const std::lock_guard<std::mutex> lock(parameters_->mutex);
    parameters_->by_map.erase(map_id);  // another version is active now
  }
  return localize_described(scan, map_id, options, robot, &known);
}

Localization Client::localize_described(const Scan& scan, const std::string& map_id, const LocalizeOptions& options,
                                        const RobotName& robot, bool* known) {
  DescriptorParameters parameters;
  {
    const std::lock_guard<std::mutex> lock(parameters_->mutex);
    const auto found = parameters_->by_map.find(map_id);
    *known = found != parameters_->by_map.end();
    if (*known) parameters = found->second;
  }
  if (!*known) {
    parameters = descriptor_parameters(map_id);
    const std::lock_guard<std::mutex> lock(parameters_->mutex);
    parameters_->by_map[map_id] = parameters;
  }
  const Bytes body = encode_query(describe(scan, parameters, options.gravity));
  return localize_body(body, kQueryMediaType, map_id, options, robot);
}

Localization Client::localize(const ScanSequence& sequence, const std::string& map_id,
                              const LocalizeOptions& options, const RobotName& robot) {
  ScanSequence plain = sequence;
  for (AnyScan& scan : plain.scans) {
    if (auto* whole = std::get_if<Scan>(&scan)) *whole = sent(*whole);
  }
  const Bytes body = encode_scans(plain, settings_.resolution_m, settings_.voxel_m);
  return localize_body(body, kScansMediaType, map_id, options, robot);
}

Localization Client::localize_body(const Bytes& body, const std::string& media_type, const std::string& map_id,
                                   const LocalizeOptions& options, const RobotName& robot) {
  const Deadline deadline(settings_.timeout_s);
  return parse_localization(http_->send(localize_request(body, media_type, map_id, options, robot), deadline).body);
}

GeoAnswer Client::geopose(const Scan& scan, const std::string& map_id, const LocalizeOptions& options,
                          const RobotName& robot) {
  const Bytes body = encode_scan(sent(scan), settings_.resolution_m, settings_.voxel_m);
  Request request = localize_request(body, kScanMediaType, map_id, options, robot);
  request.headers.emplace_back("Accept: application/geopose+json");
  const Reply reply = http_->send(request, Deadline(settings_.timeout_s));
  if (reply.media_type.rfind("application/geopose+json", 0) == 0) return {parse_geopose(reply.body), std::nullopt};
  return {std::nullopt, parse_localization(reply.body)};
}

DescriptorParameters Client::descriptor_parameters(const std::string& map_id) {
  const Request request{"maps/" + Http::escaped(map_id), {}, {}, nullptr, false};
  return parse_descriptor_parameters(http_->send(request, Deadline(settings_.timeout_s)).body);
}

std::vector<MapInfo> Client::maps() {
  std::vector<MapInfo> found;
  Strings query;
  for (;;) {  // each page has the whole timeout
    const Reply reply = http_->send({"maps", query, {}, nullptr, false}, Deadline(settings_.timeout_s));
    MapPage page = parse_maps(reply.body);
    found.insert(found.end(), page.maps.begin(), page.maps.end());
    if (!page.next) return found;
    query = {{"after", *page.next}};
  }
}

Bytes compact_body(CompactScan scan) {
  Bytes body = encode_query(scan);
  while (body.size() >= kMaxCompactBytes && scan.points.size() > kFewestPoints) {
    const std::size_t fewer = scan.points.size() * 9 / 10;
    scan.points = detail::at_most(scan.points, fewer);
    if (scan.time_s) scan.time_s = detail::at_most(*scan.time_s, fewer);
    body = encode_query(scan);
  }
  return body;
}

}  // namespace firstfix
