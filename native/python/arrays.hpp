// Arrays that cross the border to Python. A kernel sees plain numbers; types, shapes and sizes are checked here.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <type_traits>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/scan/deskew.hpp"

namespace firstfix::python {

namespace nb = nanobind;

// A C-contiguous NumPy array that is only read. A scan of another type or layout is copied to this one first.
template <class T, class... Shape>
using In = nb::ndarray<const T, Shape..., nb::c_contig, nb::device::cpu>;

// The vectors of an array (n, 3).
template <class Array>
auto vectors_of(const Array& array) -> Vectors<std::remove_pointer_t<decltype(array.data())>> {
  return {array.data(), array.shape(0)};
}

// Throws ValueError.
inline void require(bool holds, const char* message) {
  if (!holds) throw nb::value_error(message);
}

// Calls a kernel while other threads of Python run.
template <class Kernel>
auto without_gil(Kernel&& kernel) {
  nb::gil_scoped_release release;
  return kernel();
}

inline std::vector<PoseMatrix> poses_of(const In<double, nb::shape<-1, 4, 4>>& array) {
  std::vector<PoseMatrix> poses(array.shape(0));
  if (!poses.empty()) std::memcpy(poses.data(), array.data(), poses.size() * sizeof(PoseMatrix));
  return poses;
}

inline PoseMatrix pose_of(const In<double, nb::shape<4, 4>>& array) {
  PoseMatrix pose;
  std::memcpy(pose.data(), array.data(), sizeof pose);
  return pose;
}

inline Vector6 vector6_of(const In<double, nb::shape<6>>& array) {
  Vector6 vector;
  std::memcpy(vector.data(), array.data(), sizeof vector);
  return vector;
}

// A twist, linear then angular.
inline Vector6 twist_of(const double* numbers) {
  Vector6 twist;
  for (std::size_t k = 0; k < 6; ++k) {
    require(std::fabs(numbers[k]) <= (k < 3 ? kMaxLinearMS : kMaxAngularRadS), "the twist is too fast");
    twist[k] = numbers[k];
  }
  return twist;
}

// Times of a scan's points, in seconds from its stamp.
using Times = In<float, nb::ndim<1>>;

inline void check_times(const Times& time_s, std::size_t points) {
  require(time_s.shape(0) == points, "there is not one time for each point");
  constexpr float kMostS = 100.0F;
  bool is_near = true;
  for (std::size_t i = 0; i < points; ++i) is_near &= time_s.data()[i] >= -kMostS && time_s.data()[i] <= kMostS;
  require(is_near, "a time is over 100 s from the scan's stamp, or not a number");
}

// Memory for numbers that a kernel writes, all of them.
template <class T>
std::unique_ptr<T[]> memory(std::size_t count) {
  return std::unique_ptr<T[]>(new T[count]);
}

// A NumPy array that owns the memory.
template <class T>
nb::ndarray<nb::numpy, T> array_of(std::unique_ptr<T[]>&& values, std::initializer_list<std::size_t> shape) {
  T* data = values.release();
  nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  return nb::ndarray<nb::numpy, T>(data, shape, owner);
}

// A NumPy array that owns the vector's memory.
template <class T>
nb::ndarray<nb::numpy, T> array_of(std::vector<T>&& values, std::initializer_list<std::size_t> shape) {
  auto* held = new std::vector<T>(std::move(values));
  nb::capsule owner(held, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::ndarray<nb::numpy, T>(held->data(), shape, owner);
}

// A NumPy array that owns the memory of matrices.
template <std::size_t N>
nb::ndarray<nb::numpy, double> array_of(std::vector<std::array<double, N>>&& matrices, std::initializer_list<std::size_t> shape) {
  auto* held = new std::vector<std::array<double, N>>(std::move(matrices));
  nb::capsule owner(held, [](void* p) noexcept { delete static_cast<std::vector<std::array<double, N>>*>(p); });
  return nb::ndarray<nb::numpy, double>(held->data(), shape, owner);
}

template <class T>
nb::ndarray<nb::numpy, T> array_of(std::vector<T>&& values) {
  return array_of(std::move(values), {values.size()});
}

}  // namespace firstfix::python
