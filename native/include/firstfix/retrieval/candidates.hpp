// Candidates: templates that resemble a scan, and the sensor pose that each implies.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

#include "firstfix/bit_exact/atan2.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/retrieval/cascade.hpp"
#include "firstfix/retrieval/spread_out.hpp"

namespace firstfix {

// Headings of the sensor's x axis in the map that are possible.
struct HeadingPrior {
  PoseMatrix T_map_level;
  double yaw_deg, range_deg;  // the middle, and the largest difference from it

  bool allows(const PoseMatrix& T_level_sensor) const {
    double x = 0, y = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      x += T_map_level[k] * T_level_sensor[4 * k];
      y += T_map_level[4 + k] * T_level_sensor[4 * k];
    }
    const double off_deg = std::atan2(y, x) * (180 / detail::kPi) - yaw_deg;
    return std::fabs(std::remainder(off_deg, 360.0)) <= range_deg;
  }
};

// How a scan was levelled, and where it is in the frame of the query's last scan.
struct LevelledFrame {
  detail::Matrix3 R_level_sensor;
  double height_m;  // of the sensor above the floor
  PoseMatrix T_scan_last;
};

struct Candidates {
  std::vector<std::int64_t> templates;
  std::vector<PoseMatrix> T_level_sensor;  // of the query's last scan
  std::vector<float> score;                // 0..1
};

// The pose of the query's last scan, where a levelled scan stands at a position, turned about z.
inline PoseMatrix upright_pose(const detail::Vector3& position_m, double yaw_rad, const LevelledFrame& scan) {
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  const auto& [x, y, z] = scan.R_level_sensor;
  double R[3][3];
  for (std::size_t k = 0; k < 3; ++k) {
    R[0][k] = c * x[k] - s * y[k];
    R[1][k] = s * x[k] + c * y[k];
    R[2][k] = z[k];
  }
  PoseMatrix T{};
  T[15] = 1;
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 4; ++column) {
      double sum = 0;
      for (std::size_t k = 0; k < 3; ++k) sum += R[row][k] * scan.T_scan_last[4 * k + column];
      T[4 * row + column] = column == 3 ? sum + position_m[row] : sum;
    }
  }
  return T;
}

// The first `most` of the matches that the prior allows. position_m, height_m: of all templates, (n, 3) and (n). The
// template's floor counts, not its mount: this sensor may stand higher. spot: limits the candidates of one place; or null.
inline Candidates candidates_of(const Matches& matches, const float* position_m, const float* height_m,
                                const LevelledFrame& scan, const HeadingPrior* prior, std::size_t most, const Spot* spot) {
  const auto place = [&](std::size_t i) {
    const auto row = static_cast<std::size_t>(matches.rows[i]);
    const float* at = position_m + 3 * row;
    const float higher = static_cast<float>(scan.height_m) - height_m[row];
    return detail::Vector3{static_cast<double>(at[0]), static_cast<double>(at[1]),
                           static_cast<double>(at[2]) + static_cast<double>(higher)};
  };
  std::vector<detail::Vector3> positions;  // of those that are allowed
  std::vector<double> yaw_rad;
  std::vector<std::int64_t> allowed;
  const std::size_t count = matches.rows.size();
  for (std::size_t i = 0; i < count && (spot != nullptr || allowed.size() < most); ++i) {
    const detail::Vector3 position = place(i);
    if (prior != nullptr && !prior->allows(upright_pose(position, matches.yaw_rad[i], scan))) continue;
    positions.push_back(position), yaw_rad.push_back(matches.yaw_rad[i]), allowed.push_back(static_cast<std::int64_t>(i));
  }
  std::vector<std::int64_t> chosen(allowed.size());
  std::iota(chosen.begin(), chosen.end(), 0);
  if (spot != nullptr) chosen = spread_out(detail::numbers_of(positions), yaw_rad.data(), positions.size(), most, *spot);
  Candidates made;
  for (const std::int64_t number : chosen) {
    const auto at = static_cast<std::size_t>(number), match = static_cast<std::size_t>(allowed[at]);
    made.templates.push_back(matches.rows[match]);
    made.T_level_sensor.push_back(upright_pose(positions[at], yaw_rad[at], scan));
    made.score.push_back(matches.score[match]);
  }
  return made;
}

}  // namespace firstfix
