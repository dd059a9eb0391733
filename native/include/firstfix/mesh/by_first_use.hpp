// The vertices of triangles that stand tile by tile, in the order in which each tile first uses them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace firstfix {

struct VerticesByUse {
  std::vector<std::int64_t> used;          // (n,) numbers of the vertices; one of several tiles is in each of them
  std::vector<std::int64_t> triangles;     // (3 t,) the corners as rows of `used`
  std::vector<std::int64_t> vertex_start;  // (tiles + 1,) where each tile's vertices begin
};

// triangles: (start[tiles], 3) numbers of vertices, each less than `vertices`. start: (tiles + 1,), ascending from zero.
inline VerticesByUse by_first_use(const std::int64_t* triangles, const std::int64_t* start, std::size_t tiles,
                                  std::size_t vertices) {
  VerticesByUse found;
  std::vector<std::int64_t> row(vertices, -1);  // one before this tile's vertices: not used in it yet
  found.triangles.reserve(3 * static_cast<std::size_t>(start[tiles]));
  found.vertex_start.reserve(tiles + 1);
  for (std::size_t tile = 0; tile < tiles; ++tile) {
    const auto first = static_cast<std::int64_t>(found.used.size());
    found.vertex_start.push_back(first);
    for (std::int64_t corner = 3 * start[tile]; corner < 3 * start[tile + 1]; ++corner) {
      const std::int64_t vertex = triangles[corner];
      std::int64_t& place = row[static_cast<std::size_t>(vertex)];
      if (place < first) {
        place = static_cast<std::int64_t>(found.used.size());
        found.used.push_back(vertex);
      }
      found.triangles.push_back(place);
    }
  }
  found.vertex_start.push_back(static_cast<std::int64_t>(found.used.size()));
  return found;
}

}  // namespace firstfix
