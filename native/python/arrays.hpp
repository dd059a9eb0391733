// Arrays that cross the border to Python. A kernel sees plain pointers; everything else is checked here.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstddef>
#include <initializer_list>
#include <memory>
#include <utility>
#include <vector>

namespace firstfix::python {

namespace nb = nanobind;

// A C-contiguous NumPy array that is only read. A scan of another type or layout is copied to this one first.
template <class T, class... Shape>
using In = nb::ndarray<const T, Shape..., nb::c_contig, nb::device::cpu>;

// Throws ValueError.
inline void require(bool holds, const char* message) {
  if (!holds) throw nb::value_error(message);
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

}  // namespace firstfix::python
