#include <nanobind/stl/tuple.h>

#include <limits>
#include <tuple>

#include "arrays.hpp"
#include "firstfix/registration/align.hpp"
#include "firstfix/registration/distinct_poses.hpp"
#include "firstfix/registration/surface_grid.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using Points = In<float, nb::shape<-1, 3>>;
using Flags = In<bool, nb::ndim<1>>;
using Poses = In<double, nb::shape<-1, 4, 4>>;
using Cubes = In<std::int32_t, nb::ndim<4>>;
constexpr int kMostIterations = 1000;  // a caller's slip must not keep a thread for hours

const std::uint8_t* bytes_of(const Flags& flags) { return reinterpret_cast<const std::uint8_t*>(flags.data()); }

// The width of cubes, as a power of two.
int bits_of(const Cubes& cubes) {
  int bits = 0;
  while (bits < 8 && (std::size_t{1} << bits) < cubes.shape(1)) ++bits;
  const std::size_t side = std::size_t{1} << bits;
  require(cubes.shape(1) == side && cubes.shape(2) == side && cubes.shape(3) == side,
          "the blocks are no cubes of a power of two");
  return bits;
}

std::uint32_t count_of(std::size_t rows) {
  require(rows <= static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max()), "a table has too many rows");
  return static_cast<std::uint32_t>(rows);
}

// The tables of a grid, kept as long as a kernel may read them. Their contents are not read here: a large map's file is
// mapped, and loading it must stay quick.
class Grid {
 public:
  Grid(float cell_m, In<float, nb::shape<3>> corner, In<float, nb::shape<-1, 4>> planes, Flags oriented,
       In<std::int32_t, nb::ndim<3>> group, Cubes block, Cubes point)
      : planes_(planes), oriented_(oriented), group_(group), block_(block), point_(point) {
    require(cell_m > 0 && cell_m < 1e6F, "the width of a cell must be positive");
    require(oriented.shape(0) == planes.shape(0), "planes and oriented differ in length");
    require(planes.shape(0) > 0 && block.shape(0) > 0 && point.shape(0) > 0, "a table is empty");
    view.cell_m = cell_m;
    for (int axis = 0; axis < 3; ++axis) view.corner_m[axis] = corner.data()[axis];
    view.planes = reinterpret_cast<const Plane*>(planes.data());
    view.oriented = bytes_of(oriented);
    view.rows = count_of(planes.shape(0));
    view.group = group.data();
    view.block = block.data();
    view.groups = count_of(block.shape(0));
    view.point = point.data();
    view.blocks = count_of(point.shape(0));
    view.side_bits = bits_of(block);
    view.block_bits = bits_of(point);
    const std::size_t most = static_cast<std::size_t>(SurfaceGrid::kMostCells) >> (view.side_bits + view.block_bits);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      require(group.shape(axis) > 0 && group.shape(axis) <= most, "the grid is empty or too large");
      view.shape[axis] = static_cast<std::int32_t>(group.shape(axis));
    }
  }

  SurfaceGrid view{};

 private:
  In<float, nb::shape<-1, 4>> planes_;
  Flags oriented_;
  In<std::int32_t, nb::ndim<3>> group_;
  Cubes block_, point_;
};

nb::ndarray<nb::numpy, std::int32_t> nearest(const Grid& grid, Points points) {
  std::vector<std::int32_t> rows(points.shape(0));
  {
    nb::gil_scoped_release release;
    const SurfaceGrid& view = grid.view;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      std::int32_t cell[3];
      for (int axis = 0; axis < 3; ++axis) cell[axis] = cell_at(points.data()[3 * i + axis] * (1 / view.cell_m), view.last(axis));
      view.nearest(&cell[0], &cell[1], &cell[2], 1, &rows[i]);
    }
  }
  const std::size_t count = rows.size();
  return array_of(std::move(rows), {count});
}

auto align_all(const Grid& grid, Points points, Points normals, Flags oriented, Poses T_start, int iterations,
               float reach_m, float half_angle, float inlier_distance_m) {
  const std::size_t scan_points = points.shape(0), poses = T_start.shape(0);
  require(normals.shape(0) == scan_points && oriented.shape(0) == scan_points,
          "points, normals and oriented differ in length");
  require(iterations >= 0 && iterations <= kMostIterations, "there must be 0 to 1000 iterations");
  for (const float parameter : {reach_m, half_angle, inlier_distance_m}) {
    require(parameter > 1e-6F && parameter < 1e6F, "a parameter is not positive, or too large");
  }
  std::vector<double> T(16 * poses), information(36 * poses), inlier_ratio(poses), alignment_score(poses);
  {
    nb::gil_scoped_release release;
    std::copy_n(T_start.data(), T.size(), T.data());
    const ScanSurface scan(points.data(), normals.data(), bytes_of(oriented), scan_points);
    PairFinder finder(grid.view, scan);
    for (std::size_t pose = 0; pose < poses; ++pose) {
      align(finder, scan_points, {iterations, reach_m, half_angle}, &T[16 * pose], &information[36 * pose]);
      const AlignmentQuality quality = quality_at(finder, scan_points, &T[16 * pose], inlier_distance_m);
      inlier_ratio[pose] = quality.inlier_ratio;
      alignment_score[pose] = quality.alignment_score;
    }
  }
  return std::make_tuple(array_of(std::move(T), {poses, 4, 4}), array_of(std::move(inlier_ratio), {poses}),
                         array_of(std::move(alignment_score), {poses}), array_of(std::move(information), {poses, 6, 6}));
}

}  // namespace

void bind_registration(nb::module_& module) {
  nb::class_<Grid>(module, "SurfaceGrid")
      .def(nb::init<float, In<float, nb::shape<3>>, In<float, nb::shape<-1, 4>>, Flags, In<std::int32_t, nb::ndim<3>>,
                    Cubes, Cubes>(),
           nb::arg("cell_m"), nb::arg("corner").noconvert(), nb::arg("planes").noconvert(),
           nb::arg("oriented").noconvert(), nb::arg("group").noconvert(), nb::arg("block").noconvert(),
           nb::arg("point").noconvert())
      .def("nearest", &nearest, nb::arg("points"));
  module.def("align", &align_all, nb::arg("grid"), nb::arg("points"), nb::arg("normals"), nb::arg("oriented"),
             nb::arg("T_start"), nb::arg("iterations"), nb::arg("reach_m"), nb::arg("half_angle"),
             nb::arg("inlier_distance_m"));
  module.def(
      "distinct_poses",
      [](Poses T, double within_m, double within_rad, std::size_t most) {
        std::vector<std::int64_t> kept = distinct_poses(T.data(), T.shape(0), within_m, within_rad, most);
        const std::size_t count = kept.size();
        return array_of(std::move(kept), {count});
      },
      nb::arg("T"), nb::arg("within_m"), nb::arg("within_rad"), nb::arg("most"));
}

}  // namespace firstfix::python
