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
