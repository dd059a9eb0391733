// Reads sensor_msgs/PointCloud2, serialised as a middleware sends it and as bags keep it (CDR): as a service reads it, to the last
// bit, with the times of the points.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "firstfix/ros/cdr.hpp"
#include "firstfix/ros/columns.hpp"
#include "firstfix/ros/point_times.hpp"
#include "firstfix/scan/scan.hpp"

namespace firstfix::ros {

struct StampedCloud {
  Scan scan;  // its stamp_s is nothing where the driver left the stamp 0
  std::string frame_id;
};

namespace detail {

constexpr const char* kPointCloud2 = "PointCloud2";
constexpr std::array<const char*, 5> kIntensityNames = {"intensity", "scalar_intensity", "reflectivity", "reflectance", "i"};
constexpr std::array<const char*, 5> kRingNames = {"ring", "laser", "laser_id", "channel", "line"};

struct Field {
  std::string name;
  std::size_t offset;
  unsigned type;
  std::size_t count;

  bool is_number() const { return count == 1 && is_number_type(type); }
};

// Seconds since the epoch, or nothing: not known.
inline std::optional<double> read_stamp(MessageReader& reader) {
  constexpr std::int64_t kNs = 1'000'000'000;
  const std::int64_t sec = reader.number<std::int32_t>(), nanosec = reader.number<std::uint32_t>();
  if (sec < 0 || nanosec >= kNs) {
    reader.fail("a stamp of " + std::to_string(sec) + " s and " + std::to_string(nanosec) + " ns is not valid");
  }
  const std::int64_t ns = sec * kNs + nanosec;
  if (ns == 0) return std::nullopt;
  // rounded once, as the quotient of two whole numbers: ns may have more digits than a double
  const auto whole = static_cast<double>(ns);
  const auto lost = static_cast<double>(ns - static_cast<std::int64_t>(whole));
  const double seconds = whole / static_cast<double>(kNs);
  return seconds + (std::fma(-seconds, static_cast<double>(kNs), whole) + lost) / static_cast<double>(kNs);
}

// The names of the fields for x, y and z: in small letters, else in capitals.
inline std::array<std::string, 3> axes_of(const MessageReader& reader, const std::vector<Field>& fields) {
  constexpr std::size_t kFields = 20, kCharacters = 40;  // that an error names
  std::array<std::string, 3> found;
  std::string missing, there;
  std::size_t named = 0;
  for (const Field& field : fields) {
    if (field.is_number() && named++ < kFields) there += (there.empty() ? "" : ", ") + TimeField::shown(field.name, kCharacters);
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const char letter : {"XYZ"[axis], "xyz"[axis]}) {
      const std::string wanted(1, letter);
      const bool is_there = std::any_of(fields.begin(), fields.end(), [&](const Field& one) { return one.is_number() && one.name == wanted; });
      if (is_there) found[axis] = wanted;  // the small letter in place of the capital
    }
    if (found[axis].empty()) missing += (missing.empty() ? "" : ", ") + std::string(1, "xyz"[axis]);
  }
  if (!missing.empty()) reader.fail("no field " + missing + "; its fields: " + (there.empty() ? "none" : there));
  return found;
}

// Whether a field is read. All of these must lie within a point.
inline bool is_wanted(const std::string& name) {
  const std::string small = lower(name);
  const auto is_one_of = [&small](const auto& names) { return std::find(names.begin(), names.end(), small) != names.end(); };
  return small == "x" || small == "y" || small == "z" || is_one_of(kIntensityNames) || is_one_of(kRingNames) || is_time_name(name);
}

// Of two fields with one name, the first one counts.
inline std::vector<Field> wanted_of(const std::vector<Field>& fields) {
  std::vector<Field> wanted;
  for (const Field& field : fields) {
    const auto is_same = [&field](const Field& one) { return one.name == field.name; };
    if (field.is_number() && is_wanted(field.name) && std::none_of(wanted.begin(), wanted.end(), is_same)) wanted.push_back(field);
  }
  return wanted;
}

// The intensity, under any name that drivers or CloudCompare use. Null: there is none.
inline const Column* intensity_in(const std::vector<Column>& columns) {
  for (const char* const name : kIntensityNames) {
    const auto found = std::find_if(columns.rbegin(), columns.rend(), [name](const Column& one) { return lower(one.name) == name; });
    if (found != columns.rend()) return &*found;
  }
  return nullptr;
}

// The points that are finite and not impossibly far, with their intensities and times.
inline void fill(Scan& scan, const std::vector<Column>& columns, const Axes& xyz) {
  const std::vector<double> x = xyz[0]->as<double>(), y = xyz[1]->as<double>(), z = xyz[2]->as<double>();
  PointTimes times = point_times(columns, xyz, scan.stamp_s);
  scan.time_field = std::move(times.field);
  std::vector<float> intensity;
  if (const Column* const found = intensity_in(columns)) intensity = found->as<float>(), scan.intensity.emplace();
  if (times.time_s) scan.time_s.emplace();
  scan.dropped = dropped_of(x.size(), [&](std::size_t i) { return std::array<double, 3>{x[i], y[i], z[i]}; });
  for (std::size_t i = 0; i < x.size(); ++i) {
    const auto is_within = [](double v) { return std::fabs(v) <= kMaxAbsCoordinate; };  // not a number is not
    if (!(is_within(x[i]) && is_within(y[i]) && is_within(z[i]))) continue;
    scan.points.push_back({static_cast<float>(x[i]), static_cast<float>(y[i]), static_cast<float>(z[i])});
    if (scan.intensity) scan.intensity->push_back(intensity[i]);
    if (!scan.time_s) continue;
    const float time_s = (*times.time_s)[i];
    if (!(std::fabs(static_cast<double>(time_s)) <= kMaxAbsTime)) {
      throw Error("invalid_scan", "a point's time is not within 1 s of the scan's stamp");
    }
    scan.time_s->push_back(time_s);
  }
}

}  // namespace detail

// Fields may be in any order, with gaps; rows may be padded; the numbers may be big-endian, whatever the byte order of the CDR.
// Points that are not finite or beyond 1000 m are left out and counted, whatever is_dense says. body: from a stranger, too.
//
// Throws Error "malformed_data" (the sizes contradict each other or the body, or it is cut off), "unsupported_format" (not plain CDR, or
// x, y, z are not FLOAT32 or FLOAT64), "too_large" or "invalid_scan", in the words of a service.
inline StampedCloud read_point_cloud2(ByteSpan body) {
  constexpr std::size_t kMaxFields = 256, kMaxPointStep = 65'535, kMaxBytes = 256'000'000;
  MessageReader reader(detail::kPointCloud2, body);
  StampedCloud made;
  made.scan.stamp_s = detail::read_stamp(reader);
  made.frame_id = reader.text();
  const std::uint64_t height = reader.number<std::uint32_t>(), width = reader.number<std::uint32_t>();
  std::vector<detail::Field> fields;
  for (std::size_t left = reader.count(kMaxFields, "fields"); left > 0; --left) {
    detail::Field field;
    field.name = reader.text();
    field.offset = reader.number<std::uint32_t>();
    field.type = reader.number<std::uint8_t>();
    field.count = reader.number<std::uint32_t>();
    fields.push_back(std::move(field));
  }
  const bool is_big_endian = reader.flag();
  const std::uint64_t point_step = reader.number<std::uint32_t>(), row_step = reader.number<std::uint32_t>(), count = height * width;
  const std::string points = std::to_string(count) + " points";
  const auto refuse_size = [&](const std::string& what) { throw Error("too_large", std::string(detail::kPointCloud2) + ": " + what); };
  if (count > kMaxPoints) refuse_size(points + ", the limit is " + std::to_string(kMaxPoints));
  if (count * point_step > kMaxBytes) {
    refuse_size(points + " of " + std::to_string(point_step) + " bytes, the limit is " + std::to_string(kMaxBytes) + " bytes");
  }
  const ByteSpan data = reader.octets();
  reader.flag();
  reader.end();
  if (data.size != height * row_step || row_step < width * point_step || point_step > kMaxPointStep) {
    reader.fail(std::to_string(height) + " rows of " + std::to_string(row_step) + " bytes with " + std::to_string(width) + " points of " +
                std::to_string(point_step) + " bytes contradict " + std::to_string(data.size) + " bytes of data");
  }
  const std::array<std::string, 3> axes = detail::axes_of(reader, fields);
  fields = detail::wanted_of(fields);
  std::vector<Column> columns;
  for (const detail::Field& field : fields) {
    columns.push_back({field.name, static_cast<NumberType>(field.type), data.data + field.offset, height, width, row_step, point_step, is_big_endian});
  }
  Axes xyz{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    xyz[axis] = &*std::find_if(columns.begin(), columns.end(), [&](const Column& one) { return one.name == axes[axis]; });
    if (!is_real(xyz[axis]->type)) {
      throw Error("unsupported_format", std::string(detail::kPointCloud2) + ": " + "xyz"[axis] + " is not FLOAT32 or FLOAT64");
    }
  }
  for (const detail::Field& field : fields) {
    if (field.offset + bytes_of(static_cast<NumberType>(field.type)) > point_step) {
      reader.fail("the field '" + field.name + "' is outside the " + std::to_string(point_step) + " bytes of a point");
    }
  }
  detail::fill(made.scan, columns, xyz);
  return made;
}

}  // namespace firstfix::ros
