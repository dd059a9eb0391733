#include "map_tables.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>

namespace firstfix::version {
namespace {

const float* finite_floats(const ArrayFile& file, const char* name, const std::vector<std::size_t>& shape) {
  const float* numbers = file.of<float>(name, shape);
  bool is_finite = true;  // in a loop that compilers make vectors of: a map has many points
  const std::size_t count = file.count(name);
  for (std::size_t i = 0; i < count; ++i) is_finite &= std::fabs(numbers[i]) <= std::numeric_limits<float>::max();
  if (!is_finite) file.refuse(std::string(name) + " has a number that is not finite");
  return numbers;
}

void take_frame(const ArrayFile& file, float& cell_m, float (&corner_m)[3]) {
  cell_m = *file.of<float>("cell", {1});
  if (!(cell_m > 0.001F && cell_m < 1e6F)) file.refuse("the width of a cell is out of range");
  const float* corner = finite_floats(file, "corner", {3});
  for (std::size_t axis = 0; axis < 3; ++axis) corner_m[axis] = corner[axis];
}

std::uint32_t rows_of(const ArrayFile& file, const char* name) {
  const std::size_t rows = file.shape(name, 0);
  if (rows == 0 || rows > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max())) {
    file.refuse(std::string(name) + " is empty or too large");
  }
  return static_cast<std::uint32_t>(rows);
}

// The table of groups, at most so many along an axis.
const std::int32_t* groups_of(const ArrayFile& file, std::int32_t (&shape)[3], std::int32_t most) {
  const auto* group = file.of<std::int32_t>("group", {0, 0, 0});
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t along = file.shape("group", axis);
    if (along == 0 || along > static_cast<std::size_t>(most)) file.refuse("group is empty or too large");
    shape[axis] = static_cast<std::int32_t>(along);
  }
  return group;
}

// A table of cubes, and their width as a power of two.
const std::int32_t* cubes_of(const ArrayFile& file, const char* name, int& bits) {
  constexpr int kMostBits = 8;
  const std::size_t side = file.shape(name, 1);
  for (bits = 0; bits < kMostBits && std::size_t{1} << bits < side; ++bits) {
  }
  if (side != std::size_t{1} << bits) file.refuse(std::string(name) + " has no cubes of a power of two");
  return file.of<std::int32_t>(name, {0, side, side, side});
}

SurfaceGrid grid_of(const ArrayFile& file) {
  SurfaceGrid made{};
  take_frame(file, made.cell_m, made.corner_m);
  made.rows = rows_of(file, "planes");
  made.planes = reinterpret_cast<const Plane*>(finite_floats(file, "planes", {made.rows, 4}));
  made.oriented = reinterpret_cast<const std::uint8_t*>(file.of<bool>("oriented", {made.rows}));
  made.other_face = file.of<std::int32_t>("other_face", {made.rows});
  made.groups = rows_of(file, "block"), made.blocks = rows_of(file, "point");
  made.block = cubes_of(file, "block", made.side_bits);
  made.point = cubes_of(file, "point", made.block_bits);
  made.group = groups_of(file, made.shape, SurfaceGrid::kMostCells >> (made.side_bits + made.block_bits));
  return made;
}

PointTiles tiles_of(const ArrayFile& file) {
  constexpr std::size_t kMost = std::size_t{1} << 31;
  const std::size_t count = file.shape("points", 0), columns = file.shape("begin", 0), ends = file.shape("begin", 1);
  if (ends == 0 || columns >= kMost || ends >= kMost || count >= kMost) file.refuse("the table of tiles is empty or too large");
  const float* points = finite_floats(file, "points", {0, 3});
  const auto *begin = file.of<std::int32_t>("begin", {0, 0}), *low = file.of<std::int32_t>("low", {2});
  return {points, static_cast<std::int64_t>(count), begin, static_cast<std::int64_t>(columns),
          static_cast<std::int64_t>(ends) - 1, {low[0], low[1]}};
}

SeenFree seen_free_of(const ArrayFile& file) {
  SeenFree made{};
  take_frame(file, made.cell_m, made.corner_m);
  made.group = groups_of(file, made.shape, SeenFree::kMostGroups);
  made.groups = rows_of(file, "brick"), made.bricks = rows_of(file, "bits");
  made.brick = file.of<std::int32_t>("brick", {made.groups, 8, 8, 8});
  made.bits = file.of<std::int32_t>("bits", {made.bricks, 8, 2});
  return made;
}

AliasTable aliases_of(const ArrayFile& file, std::size_t templates) {
  const std::size_t each = file.shape("row", 1);
  if (each == 0 || each > 100) file.refuse("a template has no alias, or too many");
  const std::vector<std::size_t> shape{templates, each};
  const AliasTable made{file.of<std::int32_t>("row", shape), file.of<std::uint8_t>("turn", shape), file.of<std::uint8_t>("score", shape),
                        templates, each};
  try {
    made.check();
  } catch (const std::invalid_argument& error) {
    file.refuse(error.what());
  }
  return made;
}

}  // namespace

MapTables::MapTables(const VersionFolder& folder, std::size_t templates)
    : fine(grid_of(opened(folder, "surface_fine.safetensors"))),
      coarse(grid_of(opened(folder, "surface_coarse.safetensors"))),
      near(tiles_of(opened(folder, "view_near.safetensors"))),
      far(tiles_of(opened(folder, "view_far.safetensors"))) {
  constexpr const char *kSeenFree = "seen_free.safetensors", *kAliases = "aliases.safetensors";
  if (folder.has(kSeenFree)) seen_free = seen_free_of(opened(folder, kSeenFree));
  if (folder.has(kAliases)) alias_table = aliases_of(opened(folder, kAliases), templates);
  release();
}

void MapTables::release() const {
  if (!files_.empty()) files_.back().release();
}

const ArrayFile& MapTables::opened(const VersionFolder& folder, const char* name) {
  release();  // the tables of the file before are checked
  files_.emplace_back(folder.file(name));
  return files_.back();
}

}  // namespace firstfix::version
