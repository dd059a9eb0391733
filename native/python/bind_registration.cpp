#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <tuple>
#include <vector>

#include "arrays.hpp"
#include "firstfix/registration/agreement.hpp"
#include "firstfix/registration/align.hpp"
#include "firstfix/registration/align_moving.hpp"
#include "firstfix/registration/covariance.hpp"
#include "firstfix/registration/distinct_poses.hpp"
#include "firstfix/registration/nearest_points.hpp"
#include "firstfix/registration/surface_grid.hpp"
#include "grid.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using Points = In<float, nb::shape<-1, 3>>;
using Poses = In<double, nb::shape<-1, 4, 4>>;
using Twist = In<double, nb::shape<6>>;
using Twists = In<double, nb::shape<-1, 6>>;
constexpr int kMostIterations = 1000;  // a caller's slip must not keep a thread for hours

nb::ndarray<nb::numpy, std::int32_t> nearest(const Grid& grid, Points points) {
  std::vector<std::int32_t> rows(points.shape(0));
  without_gil([&] {
    const SurfaceGrid& view = grid.view;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      std::int32_t cell[3];
      for (int axis = 0; axis < 3; ++axis) cell[axis] = cell_at(points.data()[3 * i + axis] * (1 / view.cell_m), view.last(axis));
      view.nearest(&cell[0], &cell[1], &cell[2], 1, &rows[i]);
    }
  });
  return array_of(std::move(rows));
}

// The cubes of blocks first to end, the last one excluded.
auto nearest_of_points(In<std::int32_t, nb::shape<-1, 3>> cell, Points offset, In<std::int32_t, nb::ndim<1>> row,
                       In<std::int32_t, nb::ndim<3>> group, Cubes block, int block_bits, std::int64_t first,
                       std::int64_t end) {
  const std::size_t count = cell.shape(0);
  require(offset.shape(0) == count && row.shape(0) == count, "cell, offset and row differ in length");
  require(block_bits >= 0 && block_bits <= 4, "blocks are of 1 to 16 cells a side");
  constexpr std::int64_t kMostSlots = std::int64_t{1} << 30;
  require(0 <= first && first <= end && end - first <= kMostSlots >> 3 * block_bits, "the blocks are no range, or too many");
  require(block.shape(0) > 0, "a table is empty");
  const auto usable = [](float part) { return part >= 0 && part <= 1; };
  require(std::all_of(offset.data(), offset.data() + 3 * count, usable), "a point is not in its cell");
  const auto counts = [](std::int32_t number) { return number >= 0; };
  require(std::all_of(row.data(), row.data() + count, counts), "a row is negative");
  GridBlocks grid{group.data(), {}, block.data(), static_cast<std::int64_t>(block.shape(0)), bits_of(block), block_bits,
                  first, end - first};
  for (std::size_t axis = 0; axis < 3; ++axis) grid.shape[axis] = static_cast<std::int64_t>(group.shape(axis));
  auto found = without_gil([&] { return nearest_points(grid, cell.data(), offset.data(), row.data(), count); });
  const std::size_t side = std::size_t{1} << block_bits;
  return array_of(std::move(found), {static_cast<std::size_t>(grid.count), side, side, side});
}

void check(const Points& points, const Points& normals, const Flags& oriented, int iterations,
           std::initializer_list<float> parameters) {
  require(normals.shape(0) == points.shape(0) && oriented.shape(0) == points.shape(0),
          "points, normals and oriented differ in length");
  require(iterations >= 0 && iterations <= kMostIterations, "there must be 0 to 1000 iterations");
  for (const float parameter : parameters) {
    require(parameter > 1e-6F && parameter < 1e6F, "a parameter is not positive, or too large");
  }
}

auto align_all(const Grid& grid, Points points, Points normals, Flags oriented, Poses T_start, int iterations,
               float reach_m, float half_angle, float inlier_distance_m) {
  const std::size_t scan_points = points.shape(0), poses = T_start.shape(0);
  check(points, normals, oriented, iterations, {reach_m, half_angle, inlier_distance_m});
  std::vector<PoseMatrix> T = poses_of(T_start);
  std::vector<Matrix6> information(poses);
  std::vector<double> inlier_ratio(poses), alignment_score(poses);
  std::vector<std::uint8_t> rests(poses);
  without_gil([&] {
    const ScanSurface scan(vectors_of(points), vectors_of(normals), bytes_of(oriented));
    PairFinder finder(grid.view, scan);
    for (std::size_t pose = 0; pose < poses; ++pose) {
      rests[pose] = align(finder, scan_points, {iterations, reach_m, half_angle}, T[pose], information[pose]);
      const InlierShares quality = quality_at(finder, scan_points, T[pose], inlier_distance_m);
      inlier_ratio[pose] = quality.inlier_ratio;
      alignment_score[pose] = quality.alignment_score;
    }
  });
  return std::make_tuple(array_of(std::move(T), {poses, 4, 4}), array_of(std::move(inlier_ratio), {poses}),
                         array_of(std::move(alignment_score), {poses}), array_of(std::move(information), {poses, 6, 6}),
                         array_of(std::move(rests), {poses}));
}

auto align_all_moving(const Grid& grid, Points points, Points normals, Flags oriented, Times time_s, Poses T_start,
                      Twists twist_start, Twist scale, int iterations, float reach_m, float half_angle,
                      float inlier_distance_m) {
  const std::size_t scan_points = points.shape(0), poses = T_start.shape(0);
  check(points, normals, oriented, iterations, {reach_m, half_angle, inlier_distance_m});
  check_times(time_s, scan_points);
  for (std::size_t k = 0; k < 6; ++k) {
    require(scale.data()[k] >= 1e-9 && scale.data()[k] <= 1e9, "the scale of a twist is not positive, or too large");
  }
  require(twist_start.shape(0) == poses, "T_start and twist_start differ in length");
  std::vector<PoseMatrix> T = poses_of(T_start);
  std::vector<Vector6> twist(poses);
  for (std::size_t pose = 0; pose < poses; ++pose) twist[pose] = twist_of(twist_start.data() + 6 * pose);
  std::vector<Matrix6> information(poses);
  std::vector<double> inlier_ratio(poses), alignment_score(poses);
  std::vector<std::uint8_t> rests(poses);
  without_gil([&] {
    MovingScan scan(vectors_of(points), vectors_of(normals), bytes_of(oriented), time_s.data());
    PairFinder finder(grid.view, scan.seen());
    for (std::size_t pose = 0; pose < poses; ++pose) {
      rests[pose] = align_moving(finder, scan, {iterations, reach_m, half_angle}, vector6_of(scale), T[pose], twist[pose],
                                 information[pose]);
      const InlierShares quality = quality_at(finder, scan_points, T[pose], inlier_distance_m);
      inlier_ratio[pose] = quality.inlier_ratio;
      alignment_score[pose] = quality.alignment_score;
    }
  });
  return std::make_tuple(array_of(std::move(T), {poses, 4, 4}), array_of(std::move(inlier_ratio), {poses}),
                         array_of(std::move(alignment_score), {poses}), array_of(std::move(information), {poses, 6, 6}),
                         array_of(std::move(rests), {poses}), array_of(std::move(twist), {poses, 6}));
}

auto agreement_of_all(const Grid& grid, const Grid& coarse, Points points, Points normals, Flags oriented,
                      Poses T_level_sensor, float inlier_distance_m) {
  const std::size_t scan_points = points.shape(0), poses = T_level_sensor.shape(0);
  check(points, normals, oriented, 0, {inlier_distance_m});
  const std::vector<PoseMatrix> T = poses_of(T_level_sensor);
  std::vector<double> beside_surface(poses), same_plane(poses);
  without_gil([&] {
    const ScanSurface scan(vectors_of(points), vectors_of(normals), bytes_of(oriented));
    PairFinder finder(grid.view, scan);
    for (std::size_t pose = 0; pose < poses; ++pose) {
      const Agreement found = agreement_at(finder, coarse.view, scan, T[pose], inlier_distance_m);
      beside_surface[pose] = found.beside_surface;
      same_plane[pose] = found.same_plane;
    }
  });
  return std::make_tuple(array_of(std::move(beside_surface), {poses}), array_of(std::move(same_plane), {poses}));
}

using Information = In<double, nb::shape<6, 6>>;
using Doubles = nb::ndarray<nb::numpy, double>;

Matrix6 matrix6_of(const Information& array) {
  Matrix6 matrix;
  std::memcpy(matrix.data(), array.data(), sizeof matrix);
  const bool is_finite = std::all_of(matrix.begin(), matrix.end(), [](double number) { return std::isfinite(number); });
  require(is_finite, "a number of the matrix is not finite");
  return matrix;
}

Doubles array6_of(const Matrix6& matrix) { return array_of(std::vector<Matrix6>{matrix}, {6, 6}); }

Doubles faced(const Grid& grid, Points points, In<double, nb::shape<4, 4>> T_level_sensor, Information information, float reach_m) {
  require(reach_m > 1e-6F && reach_m < 1e6F, "a parameter is not positive, or too large");
  const PoseMatrix T = pose_of(T_level_sensor);
  const Matrix6 all = matrix6_of(information);
  return array6_of(without_gil([&] { return faced_information(grid.view, vectors_of(points), T, all, reach_m); }));
}

Doubles covariance_of(Information information, In<double, nb::shape<4, 4>> T_map_level, double map_voxel_m) {
  require(map_voxel_m > 0 && map_voxel_m < 1e6, "the voxel is not positive, or too large");
  return array6_of(pose_covariance(matrix6_of(information), pose_of(T_map_level), map_voxel_m));
}

// Of each: whether it is a turn, the direction, the standard deviation.
std::vector<std::tuple<bool, Doubles, double>> free_axes_of(Information covariance, double above_m, double above_rad) {
  std::vector<std::tuple<bool, Doubles, double>> made;
  for (const FreeAxis& one : free_axes(matrix6_of(covariance), above_m, above_rad)) {
    made.emplace_back(one.is_turn, array_of(std::vector<detail::Vector3>{one.direction}, {3}), one.sigma);
  }
  return made;
}

}  // namespace

void bind_registration(nb::module_& module) {
  nb::class_<Grid>(module, "SurfaceGrid")
      .def(nb::init<float, In<float, nb::shape<3>>, In<float, nb::shape<-1, 4>>, Flags, In<std::int32_t, nb::ndim<1>>,
                    In<std::int32_t, nb::ndim<3>>, Cubes, Cubes>(),
           nb::arg("cell_m"), nb::arg("corner").noconvert(), nb::arg("planes").noconvert(),
           nb::arg("oriented").noconvert(), nb::arg("other_face").noconvert(), nb::arg("group").noconvert(),
           nb::arg("block").noconvert(), nb::arg("point").noconvert())
      .def("nearest", &nearest, nb::arg("points"));
  module.def("nearest_points", &nearest_of_points, nb::arg("cell"), nb::arg("offset"), nb::arg("row"), nb::arg("group"),
             nb::arg("block"), nb::arg("block_bits"), nb::arg("first"), nb::arg("end"));
  module.def("align", &align_all, nb::arg("grid"), nb::arg("points"), nb::arg("normals"), nb::arg("oriented"),
             nb::arg("T_start"), nb::arg("iterations"), nb::arg("reach_m"), nb::arg("half_angle"),
             nb::arg("inlier_distance_m"));
  module.def("align_moving", &align_all_moving, nb::arg("grid"), nb::arg("points"), nb::arg("normals"),
             nb::arg("oriented"), nb::arg("time_s"), nb::arg("T_start"), nb::arg("twist_start"), nb::arg("scale"),
             nb::arg("iterations"), nb::arg("reach_m"), nb::arg("half_angle"), nb::arg("inlier_distance_m"));
  module.def("agreement", &agreement_of_all, nb::arg("grid"), nb::arg("coarse"), nb::arg("points"), nb::arg("normals"),
             nb::arg("oriented"), nb::arg("T_level_sensor"), nb::arg("inlier_distance_m"));
  module.def("faced_information", &faced, nb::arg("grid"), nb::arg("points"), nb::arg("T_level_sensor"), nb::arg("information"),
             nb::arg("reach_m"));
  module.def("pose_covariance", &covariance_of, nb::arg("information"), nb::arg("T_map_level"), nb::arg("map_voxel_m"));
  module.attr("FREE_M") = kFreeM;
  module.attr("FREE_RAD") = kFreeRad;
  module.def("free_axes", &free_axes_of, nb::arg("covariance"), nb::arg("above_m") = kFreeM, nb::arg("above_rad") = kFreeRad);
  module.def(
      "distinct_poses",
      [](Poses T, double within_m, double within_rad, std::size_t most) {
        return array_of(distinct_poses(poses_of(T), within_m, within_rad, most));
      },
      nb::arg("T"), nb::arg("within_m"), nb::arg("within_rad"), nb::arg("most"));
}

}  // namespace firstfix::python
