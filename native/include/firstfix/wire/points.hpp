// Kind 1 of application/vnd.firstfix.scan: every point of a scan. clients/protocol/scan.md specifies every byte.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/wire/bytes.hpp"
#include "firstfix/wire/planes.hpp"
#include "firstfix/wire/times.hpp"
#include "firstfix/wire/zstd_frame.hpp"

namespace firstfix::detail {

constexpr double kMinResolution = 1e-4, kMaxResolution = 1.0;  // m
constexpr float kMaxIntensity = 1e30F;

struct PointsForm {
  std::array<double, 3> origin{};
  std::size_t coordinate_bytes = 2;
  std::size_t intensity_bytes = 0;
  double scale = 1, offset = 0;  // of the intensity; float values
};

// Chooses origin and bytes per coordinate. Two bytes reach 327 m at 1 cm. For a scan that reaches further, the origin
// moves to the middle, or a coordinate takes four bytes.
inline void choose_coordinates(const std::vector<Point>& points, double resolution_m, PointsForm& form) {
  const double reach_m = 32'767 * resolution_m;
  constexpr double kFar = std::numeric_limits<double>::infinity();
  Vector3 low{kFar, kFar, kFar}, high{-kFar, -kFar, -kFar};
  double furthest_m = 0, extent_m = 0;
  for (const Point& point : points) {
    const Vector3 p = vector_of(point);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      furthest_m = std::max(furthest_m, std::fabs(p[axis]));
      low[axis] = std::min(low[axis], p[axis]);
      high[axis] = std::max(high[axis], p[axis]);
    }
  }
  if (furthest_m <= reach_m) return;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    extent_m = std::max(extent_m, high[axis] - low[axis]);
  }
  if (extent_m / 2 > reach_m - resolution_m) {
    form.coordinate_bytes = 4;
    return;
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    form.origin[axis] = std::nearbyint((low[axis] + high[axis]) / 2 / resolution_m) * resolution_m;
  }
}

// Chooses the form of the intensity: exact for integers of 8 or 16 bits, otherwise 65,536 steps over the range.
inline void choose_intensity(const std::vector<float>& intensity, PointsForm& form) {
  double low = 0, high = 0;
  bool whole = true;
  for (std::size_t i = 0; i < intensity.size(); ++i) {
    const auto v = static_cast<double>(intensity[i]);
    low = i == 0 ? v : std::min(low, v);
    high = i == 0 ? v : std::max(high, v);
    whole = whole && v == std::nearbyint(v);
  }
  if (low >= 0 && high <= 65'535 && whole) {
    form.intensity_bytes = high <= 255 ? 1 : 2;
    return;
  }
  constexpr float kEnd = std::numeric_limits<float>::infinity();
  form.intensity_bytes = 2;
  form.offset = static_cast<double>(std::nextafter(static_cast<float>(low), -kEnd));
  form.scale = static_cast<double>(std::nextafter(static_cast<float>((high - form.offset) / 65'535), kEnd));
}

// Replaces NaN by 0 and limits the values to 1e30.
inline std::vector<float> finite(const std::vector<float>& intensity) {
  std::vector<float> clean(intensity.size());
  std::transform(intensity.begin(), intensity.end(), clean.begin(), [](float v) {
    return std::isnan(v) ? 0.0F : std::clamp(v, -kMaxIntensity, kMaxIntensity);
  });
  return clean;
}

// Writes the part of a scan after its first six bytes.
inline void put_points(Bytes& body, const Scan& scan, double resolution_m) {
  const std::vector<Point>& points = scan.points;
  std::optional<std::vector<float>> intensity;
  if (scan.intensity) intensity = finite(*scan.intensity);
  PointsForm form;
  choose_coordinates(points, resolution_m, form);
  if (intensity) choose_intensity(*intensity, form);

  if (scan.time_s) put_times(body, times_of(*scan.time_s, points.size()), 1, true);
  put(body, static_cast<std::uint8_t>(form.coordinate_bytes));
  put(body, static_cast<std::uint8_t>(form.intensity_bytes));
  put(body, static_cast<std::uint32_t>(points.size()));
  put(body, std::uint32_t{0});
  put(body, resolution_m);
  for (const double v : form.origin) put(body, v);
  put(body, scan.stamp_s.value_or(std::numeric_limits<double>::quiet_NaN()));
  put(body, static_cast<float>(form.scale));
  put(body, static_cast<float>(form.offset));

  Bytes planes;
  planes.reserve(points.size() * (3 * form.coordinate_bytes + form.intensity_bytes));
  std::vector<std::uint32_t> values(points.size());
  const double steps_a_metre = 1 / resolution_m;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    std::uint32_t before = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double metres = vector_of(points[i])[axis];
      const double steps = std::nearbyint((metres - form.origin[axis]) * steps_a_metre);
      const auto q = static_cast<std::uint32_t>(static_cast<std::int64_t>(steps));  // modulo 2^32
      values[i] = q - before;
      before = q;
    }
    put_planes(planes, values, form.coordinate_bytes);
  }
  if (intensity) {
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double level = (static_cast<double>((*intensity)[i]) - form.offset) / form.scale;
      values[i] = static_cast<std::uint32_t>(std::nearbyint(level));
    }
    put_planes(planes, values, form.intensity_bytes);
  }
  append(body, compressed(planes, 1, true));
}

// Reads the part of a scan after its first six bytes. timed: it begins with the times of the points.
inline Scan take_points(Reader& rest, bool timed) {
  std::optional<TimesPart> times;
  if (timed) times = TimesPart::read(rest);
  const std::size_t c = rest.get<std::uint8_t>(), i = rest.get<std::uint8_t>();
  const std::size_t count = rest.get<std::uint32_t>();
  const auto zero = rest.get<std::uint32_t>();
  const auto resolution_m = rest.get<double>();
  std::array<double, 3> origin{};
  for (double& v : origin) v = rest.get<double>();
  const auto stamp_s = rest.get<double>();
  const auto scale = static_cast<double>(rest.get<float>()), offset = static_cast<double>(rest.get<float>());
  if (count > kMaxPoints) throw Error("too_large", "the scan has over 2,000,000 points");
  const auto within = [](double v) { return std::fabs(v) <= kMaxAbsCoordinate; };
  if (!((c == 2 || c == 4) && i <= 2 && zero == 0 && resolution_m >= kMinResolution &&
        resolution_m <= kMaxResolution && within(origin[0]) && within(origin[1]) && within(origin[2]) &&
        !std::isinf(stamp_s) && std::fabs(scale) * 65'535 <= 4e30 && std::fabs(offset) <= 2e30)) {
    throw Error("malformed_data", "a field of the scan's header is out of range");
  }
  const std::size_t content_bytes = count * (3 * c + i);
  const Bytes content = decompressed(rest.take(rest.left()), content_bytes, content_bytes);
  Scan scan;
  scan.points.resize(count);
  points_of_planes(content.data(), count, c, resolution_m, origin.data(), numbers_of(scan.points));
  if (i > 0) {
    scan.intensity.emplace(count);
    intensity_of_planes(content.data() + 3 * c * count, count, i, scale, offset, scan.intensity->data());
  }
  if (!std::isnan(stamp_s)) scan.stamp_s = stamp_s;
  if (times) scan.time_s = times->time_s(count);
  return scan;
}

}  // namespace firstfix::detail
