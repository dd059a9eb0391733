// firstfix_ranked_poses FOLDER FILE [X Y Z RADIUS]: the poses of a map's version at which a scan fits, without a service.
//
// FOLDER is maps/MAP/versions/VERSION of a store. FILE is a PCD file, a scan of the protocol (.ffscan), or raw little-endian
// float32 x, y, z. X Y Z RADIUS: a sphere of the map in which the sensor is, in metres. A line a pose, the best first: its
// support, inlier ratio, alignment score, free-space violation, removed surface, share in seen-free space (nan: not known),
// share beside a surface, chance of one plane, whether it rests, the row of its template, and the pose T_map_sensor, row by
// row. Exit codes: 0 some were found, 4 none, 1 error, 2 wrong usage.
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "firstfix/version/pose_search.hpp"
#include "scan_file.hpp"

int main(int argc, char** argv) {
  if (argc != 3 && argc != 7) {
    std::fputs("usage: firstfix_ranked_poses FOLDER FILE [X Y Z RADIUS]\n", stderr);
    return 2;
  }
  try {
    const firstfix::PoseSearch search(argv[1]);
    firstfix::PlacesOptions options;
    if (argc == 7) {
      const auto metres = [argv](int number) { return std::strtod(argv[number], nullptr); };
      options.prior = firstfix::Prior{{metres(3), metres(4), metres(5)}, metres(6)};
    }
    const auto poses = search.find(firstfix::example::read_scan(argv[2]), options);
    for (const firstfix::RankedPose& pose : poses) {
      const firstfix::Fit& fit = pose.fit;
      std::printf("%.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g %d %lld", pose.support, fit.inlier_ratio, fit.alignment_score,
                  fit.free_space_violation, fit.removed_surface, fit.seen_free, fit.beside_surface, fit.same_plane, pose.rests ? 1 : 0,
                  static_cast<long long>(pose.template_row));
      for (std::size_t i = 0; i < 12; ++i) std::printf(" %.17g", pose.T_map_sensor[i]);
      std::printf("\n");
    }
    return poses.empty() ? 4 : 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "firstfix_ranked_poses: %s\n", error.what());
    return 1;
  }
}
