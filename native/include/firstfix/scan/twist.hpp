// The steady motion of a sensor during its scan, along and about its own axes at the scan's stamp.
#pragma once

#include <array>

namespace firstfix {

struct Twist {
  std::array<double, 3> linear{}, angular{};  // m/s, rad/s
};

}  // namespace firstfix
