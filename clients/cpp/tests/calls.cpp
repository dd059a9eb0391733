// One call of the client, and a line with its result.
#include <cstdio>
#include <string>

#include "firstfix/client.hpp"
#include "programs.hpp"

namespace firstfix::test {
namespace {

constexpr int kHelixPoints = 1000;

Scan helix() {
  Scan scan;
  for (int i = 0; i < kHelixPoints; ++i) {
    const auto t = static_cast<float>(i) / 20;
    scan.points.push_back({10 * std::cos(t), 8 * std::sin(t), t / 10 - 1});
  }
  return scan;
}

void show(const Localization& fix) {
  std::printf("%s", text_of(fix.verdict));
  if (fix.T_map_sensor) std::printf(" %g %g", fix.T_map_sensor->position[0], fix.T_map_sensor->position[1]);
  for (const std::string& reason : fix.reasons) std::printf(" %s", reason.c_str());
  std::printf("\n");
}

void run(Client& client, const std::string& call, const std::string& map_id) {
  LocalizeOptions options;
  options.gravity = {0, 0, -9.81};
  options.prior = Prior{{1, 2, 3}, 50};
  if (call == "maps") {
    for (const MapInfo& one : client.maps()) std::printf("%s %s\n", one.map_id.c_str(), one.active_version.value_or("-").c_str());
  } else if (call == "parameters") {
    std::printf("%zu\n", client.descriptor_parameters(map_id).descriptor->rings);
  } else if (call == "scan") {
    show(client.localize(helix(), map_id, options));
  } else if (call == "range_image") {
    show(client.localize(helix(), map_id, options, Encoding::range_image));
  } else if (call == "compact") {
    show(client.localize(helix(), map_id, options, Encoding::compact));
  } else if (call == "descriptor") {
    show(client.localize(helix(), map_id, options, Encoding::descriptor));
  } else if (call == "sequence") {
    const Pose start{};
    const Pose later{{0.5, 0, 0}, {0, 0, 0, 1}};
    show(client.localize(ScanSequence{{helix(), condense(helix())}, {start, later}}, map_id, options));
  } else if (call == "geopose") {
    const GeoAnswer answer = client.geopose(helix(), map_id);
    if (answer.pose) std::printf("%.5f %.5f\n", answer.pose->latitude_deg, answer.pose->longitude_deg);
    if (answer.not_localized) show(*answer.not_localized);
  } else if (call.rfind("as ", 0) == 0) {
    const std::string robot = call.substr(3);
    show(client.localize(helix(), map_id, options, Encoding::scan, robot));
    show(client.localize(ScanSequence{{helix()}, {Pose{}}}, map_id, options, robot));
    show(client.localize_body(compact_body(condense(helix())), kQueryMediaType, map_id, options, robot));
    client.geopose(helix(), map_id, options, robot);
  } else {
    std::printf("no such call\n");
  }
}

}  // namespace

int calls(const std::string& url, const std::string& call, const std::string& map_id, double timeout_s) {
  try {
    Settings settings;
    settings.timeout_s = timeout_s;
    Client client(url, settings);
    run(client, call, map_id);
  } catch (const Error& error) {
    std::printf("error %s\n", error.code().c_str());
    return 1;
  }
  return 0;
}

}  // namespace firstfix::test
