// firstfix_localize URL MAP FILE [scan|range_image|compact|descriptor]: localizes a scan with a running service.
//
// FILE is a PCD file, a serialised PointCloud2 (.cdr), a scan of the protocol (.ffscan), or raw little-endian float32 x, y, z. Exit
// codes are those of `firstfix localize`: 0 localized, 3 ambiguous, 4 rejected, 1 error, 2 wrong usage.
#include <cstdio>
#include <exception>
#include <string>

#include "firstfix/client.hpp"
#include "scan_file.hpp"

namespace {

firstfix::Encoding encoding_of(const std::string& name) {
  if (name == "scan") return firstfix::Encoding::scan;
  if (name == "range_image") return firstfix::Encoding::range_image;
  if (name == "compact") return firstfix::Encoding::compact;
  if (name == "descriptor") return firstfix::Encoding::descriptor;
  throw firstfix::Error("invalid_option", "the encoding must be scan, range_image, compact or descriptor, not " + name);
}

int shown(const firstfix::Localization& fix) {
  std::printf("%s probability %.3f\n", firstfix::text_of(fix.verdict), fix.probability);
  for (const std::string& reason : fix.reasons) std::printf("reason %s\n", reason.c_str());
  if (fix.T_map_sensor) {
    const auto& [p, q] = *fix.T_map_sensor;
    std::printf("position %.4f %.4f %.4f\nquaternion %.6f %.6f %.6f %.6f\n", p[0], p[1], p[2], q[0], q[1], q[2], q[3]);
  }
  switch (fix.verdict) {
    case firstfix::Verdict::localized: return 0;
    case firstfix::Verdict::ambiguous: return 3;
    case firstfix::Verdict::rejected: return 4;
  }
  return 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4 && argc != 5) {
    std::fputs("usage: firstfix_localize URL MAP FILE [scan|range_image|compact|descriptor]\n", stderr);
    return 2;
  }
  try {
    firstfix::Client client(argv[1]);
    const firstfix::Scan scan = firstfix::example::read_scan(argv[3]);
    return shown(client.localize(scan, argv[2], {}, encoding_of(argc == 5 ? argv[4] : "scan")));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "firstfix_localize: %s\n", error.what());
    return 1;
  }
}
