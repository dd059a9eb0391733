// firstfix_similar_places FOLDER FILE [X Y Z RADIUS]: the places of a map's version that resemble a scan, without a service.
//
// FOLDER is maps/MAP/versions/VERSION of a store. FILE is a PCD file, a serialised PointCloud2 (.cdr), a scan of the protocol
// (.ffscan), or raw little-endian float32 x, y, z. X Y Z RADIUS: a sphere of the map in which the sensor is, in metres. A line a place, the most similar
// first: its score, the row of its template, and the pose T_map_sensor, row by row. Exit codes: 0 some were found, 4 none,
// 1 error, 2 wrong usage.
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "firstfix/version/template_search.hpp"
#include "scan_file.hpp"

int main(int argc, char** argv) {
  if (argc != 3 && argc != 7) {
    std::fputs("usage: firstfix_similar_places FOLDER FILE [X Y Z RADIUS]\n", stderr);
    return 2;
  }
  try {
    const firstfix::TemplateSearch search(argv[1]);
    firstfix::PlacesOptions options;
    if (argc == 7) {
      const auto metres = [argv](int number) { return std::strtod(argv[number], nullptr); };
      options.prior = firstfix::Prior{{metres(3), metres(4), metres(5)}, metres(6)};
    }
    const auto places = search.find(firstfix::example::read_scan(argv[2]), options);
    for (const firstfix::SimilarPlace& place : places) {
      std::printf("%.17g %lld", place.score, static_cast<long long>(place.template_row));
      for (std::size_t i = 0; i < 12; ++i) std::printf(" %.17g", place.T_map_sensor[i]);
      std::printf("\n");
    }
    return places.empty() ? 4 : 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "firstfix_similar_places: %s\n", error.what());
    return 1;
  }
}
