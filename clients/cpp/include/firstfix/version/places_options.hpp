// What a robot knows of its scan, beside the points.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "firstfix/answer/options.hpp"
#include "firstfix/pose.hpp"

namespace firstfix {

struct PlacesOptions {
  std::optional<std::array<double, 3>> gravity;  // points down, in the sensor frame; else up is measured
  std::optional<Prior> prior;
  std::optional<Pose> T_base_sensor;      // mounting of the sensor: up is sought near the robot's
  std::optional<std::size_t> max_places;  // at most; else as many as a service registers
};

}  // namespace firstfix
