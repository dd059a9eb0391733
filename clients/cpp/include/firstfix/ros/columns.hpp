// Numbers of one field of a cloud.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "firstfix/ros/cdr.hpp"

namespace firstfix::ros {

// Number types of fields, with their codes in sensor_msgs/PointField. The last three since ROS 2 Lyrical; a bool is a byte.
enum class NumberType { int8 = 1, uint8, int16, uint16, int32, uint32, float32, float64, int64, uint64, boolean };

inline bool is_number_type(unsigned code) { return code >= 1 && code <= 11; }
inline bool is_real(NumberType type) { return type == NumberType::float32 || type == NumberType::float64; }

inline std::size_t bytes_of(NumberType type) {
  switch (type) {
    case NumberType::int16: case NumberType::uint16: return 2;
    case NumberType::int32: case NumberType::uint32: case NumberType::float32: return 4;
    case NumberType::int64: case NumberType::uint64: case NumberType::float64: return 8;
    default: return 1;
  }
}

inline const char* name_of(NumberType type) {
  constexpr const char* kNames[] = {"", "int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64", "int64", "uint64", "uint8"};
  return kNames[static_cast<std::size_t>(type)];
}

// The values of a field: of float32 and float64 as double, signed integers, or unsigned ones.
using Values = std::variant<std::vector<double>, std::vector<std::int64_t>, std::vector<std::uint64_t>>;

// Where the numbers of a field lie in a message: rows of points, which may be padded.
struct Column {
  std::string name;
  NumberType type;
  const std::uint8_t* data;  // the first one
  std::size_t rows, width, row_step, point_step;
  bool is_big_endian;

  std::size_t size() const { return rows * width; }

  // The values without any change of them.
  Values values() const {
    return stored([this](auto zero) -> Values {
      using Stored = decltype(zero);
      using Whole = std::conditional_t<std::is_signed_v<Stored>, std::int64_t, std::uint64_t>;
      return all<Stored, std::conditional_t<std::is_floating_point_v<Stored>, double, Whole>>();
    });
  }

  template <class Number>
  std::vector<Number> as() const {
    return stored([this](auto zero) { return all<decltype(zero), Number>(); });
  }

 private:
  // Calls it with a zero of the type in which the numbers are stored.
  template <class Take>
  std::invoke_result_t<Take, std::uint8_t> stored(const Take& take) const {
    switch (type) {
      case NumberType::int8: return take(std::int8_t{});
      case NumberType::int16: return take(std::int16_t{});
      case NumberType::int32: return take(std::int32_t{});
      case NumberType::int64: return take(std::int64_t{});
      case NumberType::uint16: return take(std::uint16_t{});
      case NumberType::uint32: return take(std::uint32_t{});
      case NumberType::uint64: return take(std::uint64_t{});
      case NumberType::float32: return take(float{});
      case NumberType::float64: return take(double{});
      default: return take(std::uint8_t{});
    }
  }

  template <class Stored, class Value>
  std::vector<Value> all() const {
    std::vector<Value> made;
    if (width == 0) return made;  // a stranger's message may have four thousand million rows without a point
    made.reserve(size());
    for (std::size_t row = 0; row < rows; ++row) {
      for (std::size_t column = 0; column < width; ++column) {
        made.push_back(static_cast<Value>(detail::number_at<Stored>(data + row * row_step + column * point_step, is_big_endian)));
      }
    }
    return made;
  }
};

using Axes = std::array<const Column*, 3>;  // x, y, z

}  // namespace firstfix::ros
