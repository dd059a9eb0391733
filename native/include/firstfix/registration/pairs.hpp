// Pairs of a placed scan: for each of its points the map's plane near it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/registration/scan_surface.hpp"
#include "firstfix/registration/surface_grid.hpp"

namespace firstfix {

constexpr float kNoSurfaceM = 1e9F;    // distance to the surface where none is near
constexpr float kOtherFace = -0.2F;    // cosine: normals further apart face opposite ways, even with noise

// Pairs of eight points. The arms are the points relative to the sensor, along the map's axes.
struct Pairs8 {
  Float8 arm[3], normal[3], off_m, cosine;
};

// Finds the pairs of one scan in one grid, pose after pose. Where a cell names the wrong face of a wall or a slab, the other
// face is taken. A point that stays in its cell keeps its plane: when the pose moves by less than a cell, as it does after
// the first iterations, few look-ups are left.
class PairFinder {
 public:
  PairFinder(const SurfaceGrid& grid, const ScanSurface& scan) : grid_(grid), scan_(scan) {
    const std::size_t size = padded(scan.count);
    for (std::vector<std::int32_t>* cells : {&cell_x_, &cell_y_, &cell_z_}) cells->assign(size, -1);
    for (std::vector<float>* values : {&nx_, &ny_, &nz_}) values->assign(size, 0.0F);
    for (std::vector<float>* values : {&behind_nx_, &behind_ny_, &behind_nz_}) values->assign(size, 0.0F);
    for (std::vector<float>* values : {&off_, &behind_off_}) values->assign(size, kNoSurfaceM);
    oriented_.assign(size, 0);
    for (std::vector<std::int32_t>* rows : {&row_, &behind_row_}) rows->assign(size, -1);
  }

  // Calls use(pairs) for eight points after the other, placed by T_level_sensor.
  template <class Use>
  void each8(const PoseMatrix& T_level_sensor, Use use) {
    const auto [R, t] = FloatPose(T_level_sensor, grid_.corner_m);
    Placed placed;
    for (std::size_t first = 0; first < padded(scan_.count); first += kBlock) {
      const std::size_t end = std::min(first + kBlock, padded(scan_.count));
      look_up(R, t, first, end, placed);
      turn(first, end, placed);
      for (std::size_t i = first; i < end; i += kLanes) use(pairs(t, i, placed.at[(i - first) / kLanes]));
    }
  }

 private:
  static constexpr std::size_t kBlock = 256;  // points whose new cells are looked up together
  static constexpr std::size_t kRoom = kBlock + kLanes;  // append8 writes all lanes

  const SurfaceGrid& grid_;
  const ScanSurface& scan_;
  std::vector<std::int32_t> cell_x_, cell_y_, cell_z_;
  std::vector<float> nx_, ny_, nz_, off_;  // the plane of each point
  std::vector<std::int32_t> row_;          // and its row in the grid
  // Of the row for which the other face was last asked: whether its normal is oriented, and the plane of the other face.
  std::vector<std::int32_t> behind_row_, oriented_;
  std::vector<float> behind_nx_, behind_ny_, behind_nz_, behind_off_;

  struct Vector8 {
    Float8 along[3];
  };

  // Eight points along the map's axes. All steps of a block use them: so much of it stays in the nearest cache.
  struct Placed8 {
    Vector8 arm, seen;  // from the sensor to the point, and the scan's normal
    Float8 cosine;      // between the normal and that of the point's plane
    Int8 away;          // whether they face different ways, if the normal of the plane is oriented
  };

  struct Placed {
    Placed8 at[kBlock / kLanes];
  };

  static Vector8 load(const float* const* axes) { return {{load8(axes[0]), load8(axes[1]), load8(axes[2])}}; }

  static Float8 dot(const Vector8& a, const Vector8& b) {
    return a.along[0] * b.along[0] + a.along[1] * b.along[1] + a.along[2] * b.along[2];
  }

  static Float8 along(const float* row, const Float8& x, const Float8& y, const Float8& z) {
    return x * row[0] + y * row[1] + z * row[2];
  }

  static Vector8 turned(const float* R, const Float8& x, const Float8& y, const Float8& z) {
    return {{along(R, x, y, z), along(R + 3, x, y, z), along(R + 6, x, y, z)}};
  }

  // Places the points, and reads the planes of those that are in another cell than before.
  void look_up(const float* R, const float* t, std::size_t first, std::size_t end, Placed& placed) {
    const float per_m = 1 / grid_.cell_m;
    std::int32_t moved[kRoom], x_of[kRoom], y_of[kRoom], z_of[kRoom];
    std::size_t count = 0;
    for (std::size_t i = first; i < end; i += kLanes) {
      Placed8& here = placed.at[(i - first) / kLanes];
      here.arm = turned(R, load8(&scan_.x[i]), load8(&scan_.y[i]), load8(&scan_.z[i]));
      here.seen = turned(R, load8(&scan_.nx[i]), load8(&scan_.ny[i]), load8(&scan_.nz[i]));
      const Int8 cx = cells((here.arm.along[0] + t[0]) * per_m, grid_.last(0));
      const Int8 cy = cells((here.arm.along[1] + t[1]) * per_m, grid_.last(1));
      const Int8 cz = cells((here.arm.along[2] + t[2]) * per_m, grid_.last(2));
      const Int8 changed = (cx != load8(&cell_x_[i])) | (cy != load8(&cell_y_[i])) | (cz != load8(&cell_z_[i]));
      if (!any(changed)) continue;
      store8(cx, &cell_x_[i]), store8(cy, &cell_y_[i]), store8(cz, &cell_z_[i]);
      const std::size_t left = scan_.count > i ? scan_.count - i : 0;
      const Int8 number = Int8{0, 1, 2, 3, 4, 5, 6, 7} + static_cast<std::int32_t>(i);
      count = append8(changed, std::min(left, kLanes), {number, cx, cy, cz}, {moved, x_of, y_of, z_of}, count);
    }
    if (count == 0) return;
    std::int32_t row[kBlock];
    grid_.nearest(x_of, y_of, z_of, count, row);
    take_planes(moved, row, count);
  }

  static Int8 cells(const Float8& scaled, float last) {  // cell_at, lane by lane
    const Float8 from_zero = scaled > 0.0F ? scaled : Float8{};
    return __builtin_convertvector(from_zero < last ? from_zero : all8(last), Int8);
  }

  // All planes are asked for before the first is read: many of them come from far memory at once. A point without a plane
  // is no branch, since it would often be foreseen wrongly.
  void take_planes(const std::int32_t* points, const std::int32_t* row, std::size_t count) {
    const Plane* const tables[] = {grid_.planes, &kNoPlane};
    const auto plane_of = [&tables](std::int32_t of) { return tables[of < 0] + (of < 0 ? 0 : of); };
    for (std::size_t k = 0; k < count; ++k) __builtin_prefetch(plane_of(row[k]));
    float *nx = nx_.data(), *ny = ny_.data(), *nz = nz_.data(), *off = off_.data();
    std::int32_t* const row_of = row_.data();
    for (std::size_t k = 0; k < count; ++k) {
      const std::int32_t i = points[k];
      const Plane plane = usable(*plane_of(row[k]));
      nx[i] = plane.nx, ny[i] = plane.ny, nz[i] = plane.nz, off[i] = plane.off_m;
      row_of[i] = row[k];
    }
  }

  static constexpr Plane kNoPlane{0, 0, 0, kNoSurfaceM};  // far from everything

  const Plane& plane_at(std::int32_t row) const { return row < 0 ? kNoPlane : grid_.planes[row]; }

  static Plane usable(const Plane& plane) {
    const bool is_plane = (std::fabs(plane.off_m) <= kNoSurfaceM) &  // false for what is not a number
                          (std::fabs(plane.nx) + std::fabs(plane.ny) + std::fabs(plane.nz) < 4.0F);
    return is_plane ? plane : kNoPlane;
  }

  // Reads the other faces for the points that face away from their own. A point keeps it as long as its plane.
  void turn(std::size_t first, std::size_t end, Placed& placed) {
    std::int32_t points[kBlock], behind[kBlock];
    std::size_t count = 0;
    for (std::size_t i = first; i < end; i += kLanes) {
      Placed8& here = placed.at[(i - first) / kLanes];
      const float* const normals[3] = {&nx_[i], &ny_[i], &nz_[i]};
      here.cosine = dot(here.seen, load(normals));
      here.away = (here.cosine < kOtherFace) & load8(&scan_.oriented[i]);
      const Int8 asking = here.away & (load8(&row_[i]) != load8(&behind_row_[i]));
      if (!any(asking)) continue;
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        points[count] = static_cast<std::int32_t>(i + lane);
        count += static_cast<std::size_t>(asking[lane] != 0);
      }
    }
    for (std::size_t k = 0; k < count; ++k) behind[k] = grid_.other_face[row_[points[k]]];
    for (std::size_t k = 0; k < count; ++k) {
      const std::int32_t i = points[k], other = static_cast<std::uint32_t>(behind[k]) < grid_.rows ? behind[k] : -1;
      const Plane plane = usable(plane_at(other));
      behind_nx_[i] = plane.nx, behind_ny_[i] = plane.ny, behind_nz_[i] = plane.nz, behind_off_[i] = plane.off_m;
      behind_row_[i] = row_[i];
      oriented_[i] = grid_.oriented[row_[i]] != 0 ? -1 : 0;
    }
  }

  Pairs8 pairs(const float* t, std::size_t i, const Placed8& here) const {
    const Vector8& arm = here.arm;
    const float* const near[3] = {&nx_[i], &ny_[i], &nz_[i]};
    Vector8 normal = load(near);
    Float8 plane_m = load8(&off_[i]), cosine = here.cosine;
    Int8 nowhere{};
    if (any(here.away)) {
      const float* const behind[3] = {&behind_nx_[i], &behind_ny_[i], &behind_nz_[i]};
      const Float8 behind_m = load8(&behind_off_[i]);
      const Int8 oriented = here.away & load8(&oriented_[i]), turned = oriented & (behind_m < kNoSurfaceM);
      for (int axis = 0; axis < 3; ++axis) normal.along[axis] = turned ? load8(behind[axis]) : normal.along[axis];
      plane_m = turned ? behind_m : plane_m;
      cosine = dot(here.seen, normal);
      nowhere = oriented & (cosine < kOtherFace);
    }
    const Vector8 at{{arm.along[0] + t[0], arm.along[1] + t[1], arm.along[2] + t[2]}};
    const Float8 off_m = plane_m - dot(at, normal);
    const Float8(&n)[3] = normal.along;
    return {{arm.along[0], arm.along[1], arm.along[2]}, {n[0], n[1], n[2]}, nowhere ? all8(kNoSurfaceM) : off_m, cosine};
  }
};

}  // namespace firstfix
