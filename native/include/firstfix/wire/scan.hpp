// The encoding application/vnd.firstfix.scan: clients/protocol/scan.md specifies every byte.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "firstfix/errors.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/usable_points.hpp"
#include "firstfix/scan/reduction.hpp"
#include "firstfix/wire/bytes.hpp"
#include "firstfix/wire/points.hpp"
#include "firstfix/wire/range_image.hpp"

namespace firstfix {

inline constexpr const char* kScanMediaType = "application/vnd.firstfix.scan";

namespace detail {
constexpr int kTimedKind = 4;  // more than the kind of the same without times
}

enum class ScanForm {
  points,       // every point; the default resolution is 1 cm
  range_image,  // the nearest return in each of 4 million directions, no intensity; 2.5 cm
};

// Encodes a scan. With voxel_m, only the first point of each voxel is sent. Throws "invalid_option", "invalid_scan" (a
// coordinate is not finite or beyond 1000 m: see `cleaned`; a time is not within a second), "too_large".
inline Bytes encode_scan(const Scan& scan, std::optional<double> resolution_m = std::nullopt,
                         std::optional<double> voxel_m = std::nullopt, ScanForm form = ScanForm::points) {
  const bool points = form == ScanForm::points;
  const double step_m = resolution_m.value_or(points ? 0.01 : 0.025);
  if (!(step_m >= (points ? detail::kMinResolution : detail::kMinImageResolution) && step_m <= detail::kMaxResolution)) {
    throw Error("invalid_option", "the resolution must be in [0.0001, 1] m, of a range image in [0.005, 1] m");
  }
  if (voxel_m && !(*voxel_m >= 0.01 && *voxel_m <= 10)) throw Error("invalid_option", "the voxel must be in [0.01, 10] m");
  if (scan.points.size() > kMaxPoints) throw Error("too_large", "the scan has over 2,000,000 points");
  if (scan.intensity && scan.intensity->size() != scan.points.size()) {
    throw Error("invalid_scan", "the number of intensities is not the number of points");
  }
  if (scan.time_s && scan.time_s->size() != scan.points.size()) {
    throw Error("invalid_scan", "the number of times is not the number of points");
  }
  if (!std::all_of(scan.points.begin(), scan.points.end(), [](const Point& p) { return usable(p); })) {
    throw Error("invalid_scan", "a coordinate is not finite, or beyond 1000 m");
  }
  std::optional<Scan> thinned;
  if (voxel_m) {
    thinned = Scan{{}, std::nullopt, scan.stamp_s};
    if (scan.intensity) thinned->intensity.emplace();
    if (scan.time_s) thinned->time_s.emplace();
    for (const auto row : detail::first_in_voxel(scan.points, *voxel_m)) {
      thinned->points.push_back(scan.points[row]);
      if (scan.intensity) thinned->intensity->push_back((*scan.intensity)[row]);
      if (scan.time_s) thinned->time_s->push_back((*scan.time_s)[row]);
    }
  }
  const int kind = (points ? 1 : 2) + (scan.time_s ? detail::kTimedKind : 0);
  Bytes body{'F', 'F', 'S', 'C', 1, static_cast<std::uint8_t>(kind)};
  const auto put = points ? detail::put_points : detail::put_range_image;
  put(body, thinned ? *thinned : scan, step_m);
  return body;
}

// Decodes a scan. Throws "malformed_data", "unsupported_format", "too_large". Every size is checked before memory is
// allocated.
inline Scan decode_scan(const std::uint8_t* data, std::size_t size) {
  detail::Reader rest(data, size, kScanMediaType);
  rest.magic("FFSC");
  const auto version = rest.get<std::uint8_t>(), kind = rest.get<std::uint8_t>();
  const bool timed = kind > detail::kTimedKind;
  const int form = timed ? kind - detail::kTimedKind : kind;
  if (version != 1 || form < 1 || form > 2) {
    throw Error("unsupported_format", "only version 1, kinds 1, 2, 5 and 6 are supported");
  }
  Scan scan = form == 1 ? detail::take_points(rest, timed) : detail::take_range_image(rest, timed);
  if (!all_within(numbers_of(scan.points), scan.points.size(), kMaxAbsCoordinate * 1.001)) {
    throw Error("malformed_data", "the scan has coordinates beyond 1000 m");
  }
  return scan;
}

inline Scan decode_scan(const Bytes& body) { return decode_scan(body.data(), body.size()); }

}  // namespace firstfix
