// The encoding application/vnd.firstfix.query: clients/protocol/query.md specifies every byte.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <variant>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/errors.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/scan/range_view.hpp"
#include "firstfix/wire/bytes.hpp"
#include "firstfix/wire/compact_planes.hpp"
#include "firstfix/wire/compact_points.hpp"
#include "firstfix/wire/scan.hpp"
#include "firstfix/wire/times.hpp"
#include "firstfix/wire/zstd_frame.hpp"

namespace firstfix {

inline constexpr const char* kQueryMediaType = "application/vnd.firstfix.query";

namespace detail {

constexpr std::size_t kMaskBytes = kDirections / 8;
static_assert(kDirections % 8 == 0);
constexpr int kQueryZstdLevel = 12;
constexpr std::uint8_t kCompactPart = 1, kDescriptorPart = 2, kTimesPart = 4;

inline float range_of_level(double level) { return static_cast<float>(5 * std::expm1(0.012 * level)); }

// The range at which each of the levels 1 to 254 ends.
inline const std::array<float, 254>& level_edges() {
  static const std::array<float, 254> edges = [] {
    std::array<float, 254> made{};
    for (std::size_t i = 0; i < made.size(); ++i) made[i] = range_of_level(static_cast<double>(i) + 1.5);
    return made;
  }();
  return edges;
}

inline Bytes range_view_content(const std::vector<float>& nearest_m) {
  if (nearest_m.size() != kDirections) throw Error("invalid_scan", "a compact scan must have 16,200 ranges");
  for (const float range : nearest_m) {
    if (!(range >= 0)) throw Error("invalid_scan", "a range is NaN or below 0");
  }
  return levels_of_ranges(nearest_m.data(), kDirections, level_edges().data(), level_edges().size());
}

inline std::uint16_t frame_length(const Bytes& frame) {
  if (frame.size() > 65'535) throw Error("too_large", "a frame of the query has over 65,535 bytes");
  return static_cast<std::uint16_t>(frame.size());
}

// Returns the rows of the points in the order in which they are written.
inline std::vector<std::int64_t> put_compact(Bytes& body, const CompactScan& scan, double wanted_resolution_m) {
  const std::size_t n = scan.points.size();
  if (n > kMaxCompactPoints) throw Error("too_large", "the query has over 10,000 points");
  for (const Point& point : scan.points) {
    if (!usable(point)) throw Error("invalid_scan", "a coordinate is not finite, or beyond 1000 m");
  }
  const auto resolution = static_cast<float>(wanted_resolution_m);
  CompactPlanes points = compact_planes(numbers_of(scan.points), n, static_cast<double>(resolution));
  std::uint64_t product = 1;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const bool reached = std::abs(points.box.lowest[axis]) <= 32'767 && points.box.size[axis] <= 65'535;
    product *= reached ? static_cast<std::uint64_t>(points.box.size[axis]) : 0;
    if (!reached || product > std::uint64_t{1} << 32) {
      throw Error("invalid_scan", "the points are too far apart for the resolution");
    }
  }
  const Bytes first = compressed(points.planes, kQueryZstdLevel, false);
  const Bytes second = compressed(range_view_content(scan.nearest_m), kQueryZstdLevel, false);
  put(body, resolution);
  put(body, static_cast<std::uint16_t>(n));
  for (const std::int64_t v : points.box.lowest) put(body, static_cast<std::int16_t>(v));
  for (const std::int64_t v : points.box.size) put(body, static_cast<std::uint16_t>(v));
  put(body, frame_length(first));
  put(body, frame_length(second));
  append(body, first);
  append(body, second);
  append(body, points.low);
  return std::move(points.order);
}

inline void put_compact_times(Bytes& body, const CompactScan& scan, const std::vector<std::int64_t>& order) {
  const Times times = times_of(*scan.time_s, scan.points.size());
  Times sorted{times.first_s, times.step_s, {}};
  for (const std::int64_t row : order) sorted.level.push_back(times.level[static_cast<std::size_t>(row)]);
  put_times(body, sorted, kQueryZstdLevel, false);
}

inline void put_descriptor(Bytes& body, const ScanDescriptor& described) {
  const LayeredOccupancy& grid = described.descriptor;
  if (!usable(grid) || described.occupancy.size() != grid.bytes()) {
    throw Error("invalid_scan", "the descriptor does not have the size of its grid");
  }
  const Bytes frame = compressed(described.occupancy, kQueryZstdLevel, false);
  put(body, std::uint8_t{1});
  put(body, static_cast<std::uint8_t>(grid.layers()));
  put(body, static_cast<std::uint16_t>(grid.rings));
  put(body, static_cast<std::uint16_t>(grid.sectors));
  put(body, frame_length(frame));
  put(body, static_cast<float>(grid.max_range_m));
  for (const double v : described.up) put(body, static_cast<float>(v));
  put(body, static_cast<float>(described.height_m));
  for (const double edge : grid.layer_edges_m) put(body, static_cast<float>(edge));
  append(body, frame);
}

inline const std::array<float, 256>& levels() {
  static const std::array<float, 256> ranges = [] {
    std::array<float, 256> made{};
    for (std::size_t i = 0; i < made.size(); ++i) made[i] = range_of_level(static_cast<double>(i));
    return made;
  }();
  return ranges;
}

inline CompactScan read_compact(Reader& rest) {
  const auto resolution_m = static_cast<double>(rest.get<float>());
  const std::size_t n = rest.get<std::uint16_t>();
  CompactGrid grid;
  grid.resolution_m = resolution_m;
  for (std::int64_t& v : grid.lowest) v = rest.get<std::int16_t>();
  for (std::int64_t& v : grid.size) v = rest.get<std::uint16_t>();
  const std::size_t first = rest.get<std::uint16_t>(), second = rest.get<std::uint16_t>();
  if (n > kMaxCompactPoints) throw Error("too_large", "the query has over 10,000 points");
  const std::int64_t cells = grid.size[0] * grid.size[1] * grid.size[2];
  if (!(resolution_m >= 0.005 * 0.999 && resolution_m <= 0.1 * 1.001) || cells < 1 || cells > std::int64_t{1} << 32) {
    throw Error("malformed_data", "the resolution or the cells of the query are out of range");
  }
  const Bytes planes = decompressed(rest.take(first), 4 * n, 4 * n);
  const Bytes ranges = decompressed(rest.take(second), kMaskBytes, kMaskBytes + kDirections);
  const ByteSpan low = rest.take(3 * ((n + 1) / 2));
  CompactScan scan;
  scan.points.resize(n);
  compact_points(planes.data(), low.data, n, grid, numbers_of(scan.points));
  scan.nearest_m.resize(kDirections);
  ranges_of_levels(span_of(ranges), levels().data(), kDirections, scan.nearest_m.data());
  return scan;
}

inline ScanDescriptor read_descriptor(Reader& rest) {
  const auto kind = rest.get<std::uint8_t>(), layers = rest.get<std::uint8_t>();
  ScanDescriptor described;
  LayeredOccupancy& grid = described.descriptor;
  grid.rings = rest.get<std::uint16_t>();
  grid.sectors = rest.get<std::uint16_t>();
  const std::size_t frame = rest.get<std::uint16_t>();
  grid.max_range_m = static_cast<double>(rest.get<float>());
  for (double& v : described.up) v = static_cast<double>(rest.get<float>());
  described.height_m = static_cast<double>(rest.get<float>());
  if (kind != 1) throw Error("unsupported_format", "only descriptors of kind 1 are supported");
  const double length = std::sqrt(dot(described.up, described.up));
  if (layers < 1 || layers > 16 || !(std::fabs(length - 1) < 1e-3) || !(std::fabs(described.height_m) <= 100)) {
    throw Error("malformed_data", "a field of the descriptor is out of range");
  }
  grid.layer_edges_m.clear();
  for (std::size_t i = 0; i <= layers; ++i) grid.layer_edges_m.push_back(static_cast<double>(rest.get<float>()));
  if (!usable(grid)) throw Error("malformed_data", "the descriptor's grid is out of range");
  for (double& v : described.up) v /= length;
  described.occupancy = decompressed(rest.take(frame), grid.bytes(), grid.bytes());
  return described;
}

}  // namespace detail

// Encodes a query. Throws "invalid_option" (a resolution outside 0.005 to 0.1 m), "invalid_scan", "too_large".
inline Bytes encode_query(const CompactScan& scan, double resolution_m = 0.02) {
  if (!(resolution_m >= 0.005 && resolution_m <= 0.1)) {
    throw Error("invalid_option", "the resolution of a compact query must be in [0.005, 0.1] m");
  }
  const int parts = detail::kCompactPart + (scan.described ? detail::kDescriptorPart : 0) +
                    (scan.time_s ? detail::kTimesPart : 0);
  Bytes body{'F', 'F', 'Q', 'Y', 1, static_cast<std::uint8_t>(parts), 0, 0};
  const std::vector<std::int64_t> order = detail::put_compact(body, scan, resolution_m);
  if (scan.described) detail::put_descriptor(body, *scan.described);
  if (scan.time_s) detail::put_compact_times(body, scan, order);
  return body;
}

inline Bytes encode_query(const ScanDescriptor& described) {
  Bytes body{'F', 'F', 'Q', 'Y', 1, detail::kDescriptorPart, 0, 0};
  detail::put_descriptor(body, described);
  return body;
}

// A compact scan, with or without a descriptor, or a descriptor alone.
using Query = std::variant<CompactScan, ScanDescriptor>;

// Decodes a query. Throws "malformed_data", "unsupported_format", "too_large". Every size is checked before memory is
// allocated.
inline Query decode_query(const std::uint8_t* data, std::size_t size) {
  detail::Reader rest(data, size, kQueryMediaType);
  rest.magic("FFQY");
  const auto version = rest.get<std::uint8_t>(), parts = rest.get<std::uint8_t>();
  if (rest.get<std::uint16_t>() != 0) throw Error("malformed_data", "a reserved field of the query is not 0");
  const bool has_times_alone = (parts & detail::kTimesPart) != 0 && (parts & detail::kCompactPart) == 0;
  if (version != 1 || parts < 1 || parts > 7 || has_times_alone) {
    throw Error("unsupported_format", "only version 1 with the parts 1, 2, 3, 5 and 7 is supported");
  }
  Query query;
  if ((parts & detail::kCompactPart) != 0) {
    CompactScan scan = detail::read_compact(rest);
    if ((parts & detail::kDescriptorPart) != 0) scan.described = detail::read_descriptor(rest);
    if ((parts & detail::kTimesPart) != 0) scan.time_s = detail::TimesPart::read(rest).time_s(scan.points.size());
    query = std::move(scan);
  } else {
    query = detail::read_descriptor(rest);
  }
  rest.end();
  return query;
}

inline Query decode_query(const Bytes& body) { return decode_query(body.data(), body.size()); }

}  // namespace firstfix
