// Which mapped points does a scan see through, and which does it meet?
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/changes/range_image.hpp"
#include "firstfix/verification/point_tiles.hpp"

namespace firstfix {

constexpr float kComparedFromM = 1.5F;  // nearer than this, an error of the pose is wider than the directions around a point
constexpr float kFineFromM = 5.0F;      // from here on narrow directions are wide enough
constexpr std::int32_t kCoarseColumns = 180;
constexpr float kSlackM = 0.2F, kSlack = 0.02F;  // along a ray, for the errors of map, pose and range

// Mapped points around a sensor, x y z x y z in its frame, and what a scan says of each: both 0 where something stands in
// front of it, or nothing returned around it.
struct ComparedPoints {
  std::vector<float> points;
  std::vector<std::uint8_t> gone, met;

  std::size_t size() const { return points.size() / 3; }

  // Adds the points of tiles from low_m on, up to high_m.
  void add(const PointTiles& tiles, const PoseMatrix& T_map_sensor, float low_m, float high_m) {
    const FloatPose pose(T_map_sensor);
    const double centre_m[3] = {T_map_sensor[3], T_map_sensor[7], T_map_sensor[11]};
    tiles.each_run(centre_m, static_cast<double>(high_m), [&](std::int64_t first, std::int64_t end) {
      for (std::int64_t i = first; i < end; ++i) {
        const float* from = tiles.points + 3 * i;
        const float x = from[0] - pose.t[0], y = from[1] - pose.t[1], z = from[2] - pose.t[2];
        const float range_m = std::sqrt(x * x + y * y + z * z);
        if (!(range_m >= low_m && range_m < high_m)) continue;
        for (int axis = 0; axis < 3; ++axis) points.push_back(x * pose.R[axis] + y * pose.R[3 + axis] + z * pose.R[6 + axis]);
      }
    });
  }

  // Compares all points with a scan's returns. columns: directions around the sensor from kFineFromM on.
  void compare(Vectors<const float> returns, std::int32_t columns) {
    const RangeImage coarse(returns, kCoarseColumns), fine(returns, columns);
    gone.assign(size(), 0);
    met.assign(size(), 0);
    for (std::size_t i = 0; i < size(); ++i) {
      const float x = points[3 * i], y = points[3 * i + 1], z = points[3 * i + 2];
      const float here_m = std::sqrt(x * x + y * y + z * z);
      if (!(here_m >= kComparedFromM)) continue;
      const RangeImage& image = here_m < kFineFromM ? coarse : fine;
      const std::int32_t at = image.at(x, y, z);
      const float slack_m = here_m * kSlack + kSlackM;
      gone[i] = image.covered[at] != 0 && image.least_m[at] > here_m + slack_m;
      met[i] = std::fabs(image.nearest_m[at] - here_m) <= slack_m || std::fabs(image.least_m[at] - here_m) <= slack_m ||
               std::fabs(image.most_m[at] - here_m) <= slack_m;
    }
  }
};

}  // namespace firstfix
