// firstfix_localize_here FOLDER FILE [OPTION=NUMBERS ...]: localizes a scan, or several with their poses, in a map's version on
// this machine, without a service.
//
// FOLDER is maps/MAP/versions/VERSION of a store; several maps are ID=FOLDER,ID=FOLDER. FILE is a PCD file, a serialised PointCloud2
// (.cdr), a body of the protocol (.ffscan: a scan, a compact one, or a sequence), or raw little-endian float32 x, y, z. Options are those
// of a query: gravity=X,Y,Z prior=X,Y,Z,RADIUS[,YAW,RANGE] T_base_sensor=X,Y,Z,QX,QY,QZ,QW T_odom_base=X,Y,Z,QX,QY,QZ,QW
// twist=VX,VY,VZ,WX,WY,WZ max_candidates=N min_probability=P max_false_accept=P deadline_ms=T; and explaining=SHARE: how long it may look for
// the cause, over the time of the query. Each line has a name and what it names; findings go to the standard error. Exit codes are
// those of `firstfix localize`: 0 localized, 3 ambiguous, 4 rejected, 1 error, 2 wrong usage.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <limits>
#include <string>
#include <variant>
#include <vector>

#include "firstfix/version/localizer.hpp"
#include "scan_file.hpp"

namespace {

using firstfix::Error;

std::vector<double> numbers_of(const std::string& text) {
  std::vector<double> numbers;
  const char* at = text.c_str();
  for (char* end = nullptr;; at = end + 1) {
    numbers.push_back(std::strtod(at, &end));
    if (end == at || (*end != ',' && *end != 0)) throw Error("invalid_option", text + " has no numbers separated by commas");
    if (*end == 0) return numbers;
  }
}

firstfix::Pose pose_of(const std::vector<double>& n) { return {{n[0], n[1], n[2]}, {n[3], n[4], n[5], n[6]}}; }

// One folder, or ID=FOLDER,ID=FOLDER. No id has a slash, so a folder's path may have "=" after one.
std::vector<firstfix::MapFolder> maps_of(const std::string& text) {
  std::vector<firstfix::MapFolder> maps;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size()), equals = text.find('=', at);
    if (equals >= end || text.find('/', at) < equals) return {{"", text}};
    maps.push_back({text.substr(at, equals - at), text.substr(equals + 1, end - equals - 1)});
    at = end + 1;
  }
  return maps;
}

void take(firstfix::LocalizeOptions& options, double& explaining, const std::string& text) {
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) throw Error("invalid_option", text + " is no OPTION=NUMBERS");
  const std::string name = text.substr(0, equals);
  const std::vector<double> n = numbers_of(text.substr(equals + 1));
  const auto is = [&](const char* option, std::size_t count) { return name == option && n.size() == count; };
  if (is("gravity", 3)) options.gravity = {n[0], n[1], n[2]};
  else if (is("prior", 4)) options.prior = firstfix::Prior{{n[0], n[1], n[2]}, n[3]};
  else if (is("prior", 6)) options.prior = firstfix::Prior{{n[0], n[1], n[2]}, n[3], n[4], n[5]};
  else if (is("T_base_sensor", 7)) options.T_base_sensor = pose_of(n);
  else if (is("twist", 6)) options.twist = firstfix::Twist{{n[0], n[1], n[2]}, {n[3], n[4], n[5]}};
  else if (is("T_odom_base", 7)) options.T_odom_base = pose_of(n);
  else if (is("max_candidates", 1) && n[0] == std::floor(n[0]) && std::fabs(n[0]) < 1e9) options.max_candidates = static_cast<int>(n[0]);
  else if (is("min_probability", 1)) options.min_probability = n[0];
  else if (is("max_false_accept", 1)) options.max_false_accept = n[0];
  else if (is("deadline_ms", 1)) options.deadline_ms = n[0];
  else if (is("explaining", 1)) explaining = n[0];
  else throw Error("invalid_option", "no such option, or another number of numbers: " + text);
}

template <class Numbers>
void print(const Numbers& numbers) {
  for (const double number : numbers) std::printf(" %.17g", number);
}

void print(const char* name, const firstfix::Pose& pose) {
  std::printf("%s", name);
  print(pose.position);
  print(pose.quaternion);
  std::printf("\n");
}

int print(const firstfix::Localization& fix) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  constexpr int kCodes[] = {0, 3, 4};
  const auto verdict = static_cast<std::size_t>(fix.verdict);
  std::printf("verdict %s\nprobability %.17g\n", firstfix::text_of(fix.verdict), fix.probability);
  if (!fix.map_id.empty()) std::printf("map %s\n", fix.map_id.c_str());
  for (const std::string& reason : fix.reasons) std::printf("reason %s\n", reason.c_str());
  for (const firstfix::Finding& one : fix.findings) std::fprintf(stderr, "%s: %s %s\n", one.code.c_str(), one.text.c_str(), one.remedy.c_str());
  if (fix.T_map_sensor) print("T_map_sensor", *fix.T_map_sensor);
  if (fix.T_map_base) print("T_map_base", *fix.T_map_base);
  if (fix.covariance) std::printf("covariance"), print(*fix.covariance), std::printf("\n");
  if (fix.twist) std::printf("twist"), print(fix.twist->linear), print(fix.twist->angular), std::printf("\n");
  for (const firstfix::FreeDirection& free : fix.degenerate) {
    std::printf("free %s", free.is_rotation ? "rotation" : "translation");
    print(free.direction);
    std::printf(" %.17g\n", free.sigma);
  }
  for (const firstfix::Hypothesis& one : fix.hypotheses) {
    std::printf("hypothesis%s%s %.17g %.17g %.17g %.17g %.17g %.17g %lld", one.map_id.empty() ? "" : " ", one.map_id.c_str(), one.probability, one.quality->inlier_ratio,
                one.quality->alignment_score, one.quality->free_space_violation, one.quality->removed_surface,
                one.quality->seen_free.value_or(kUnknown), one.template_row);
    print("", one.T_map_sensor);
  }
  const firstfix::ScanFacts& scan = *fix.scan;
  const double rings = scan.rings ? static_cast<double>(*scan.rings) : kUnknown;
  std::printf("scan %lld %lld %lld", scan.points, scan.valid, scan.in_range);
  print(std::array{scan.median_range_m.value_or(kUnknown), scan.largest_range_m.value_or(kUnknown), rings,
                   scan.plane_ratio.value_or(kUnknown), scan.time_span_s.value_or(kUnknown)});
  std::printf("\n");
  return kCodes[verdict];
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fputs("usage: firstfix_localize_here FOLDER FILE [OPTION=NUMBERS ...]\n", stderr);
    return 2;
  }
  try {
    firstfix::LocalizeOptions options;
    double explaining = firstfix::Localizer::kExplaining;
    for (int i = 3; i < argc; ++i) take(options, explaining, argv[i]);
    const firstfix::Localizer localizer(maps_of(argv[1]), explaining);
    return std::visit([&](const auto& scan) { return print(localizer.localize(scan, options)); },
                      firstfix::example::read_scans(argv[2]));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "firstfix_localize_here: %s\n", error.what());
    return 1;
  }
}
