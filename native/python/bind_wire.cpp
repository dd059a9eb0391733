#include <nanobind/stl/pair.h>

#include <string_view>

#include "arrays.hpp"
#include "firstfix/scan/usable_points.hpp"
#include "firstfix/scan/compact.hpp"
#include "firstfix/wire/compact_planes.hpp"
#include "firstfix/wire/compact_points.hpp"
#include "firstfix/wire/planes.hpp"
#include "firstfix/wire/range_image_points.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using Octets = In<std::uint8_t, nb::shape<-1>>;
using Planes = In<std::uint8_t, nb::shape<-1, -1>>;
using CosinesAndSines = In<double, nb::shape<2, -1>>;

detail::ByteSpan span_of(const Octets& octets) { return {octets.data(), octets.size()}; }

Angles angles_of(const CosinesAndSines& table) {
  const std::size_t count = table.shape(1);
  return {count, table.data(), table.data() + count};
}

// A column of numbers in Python's memory, at any address: nanobind would refuse one that is not aligned.
class Numbers {
 public:
  explicit Numbers(const nb::object& column) {
    if (PyObject_GetBuffer(column.ptr(), &view_, PyBUF_STRIDES | PyBUF_FORMAT) != 0) {
      PyErr_Clear();
      throw nb::type_error("a column is no array");
    }
  }
  ~Numbers() { PyBuffer_Release(&view_); }
  Numbers(const Numbers&) = delete;
  Numbers& operator=(const Numbers&) = delete;

  // The letter of the numbers' type in the module `struct`, of numbers in this processor's order of bytes; else 0.
  char type() const {
    const std::string_view format = view_.format == nullptr ? "" : view_.format;
    if (view_.ndim != 1 || format.empty() || format.size() > 2) return 0;
    return format.size() == 1 || format[0] == '=' ? format.back() : '\0';
  }

  std::size_t count() const { return static_cast<std::size_t>(view_.shape[0]); }

  template <class T>
  Column<T> column() const {
    return {static_cast<const unsigned char*>(view_.buf), view_.strides[0]};
  }

 private:
  Py_buffer view_{};
};

template <class T>
auto usable_of(const Numbers& x, const Numbers& y, const Numbers& z) {
  const std::size_t count = x.count();
  auto points = memory<float>(3 * count);
  auto usable = memory<bool>(count);
  std::size_t found = 0;
  without_gil([&] {
    found = usable_points(x.column<T>(), y.column<T>(), z.column<T>(), count, points.get(), usable.get());
  });
  return std::make_pair(array_of(std::move(points), {found, 3}), array_of(std::move(usable), {count}));
}

auto usable_of_any(const nb::object& of_x, const nb::object& of_y, const nb::object& of_z) {
  const Numbers x(of_x), y(of_y), z(of_z);
  const char type = x.type();
  if ((type != 'f' && type != 'd') || y.type() != type || z.type() != type) {
    throw nb::type_error("x, y and z must be rows of float32, or of float64");
  }
  require(y.count() == x.count() && z.count() == x.count(), "x, y and z differ in length");
  return type == 'f' ? usable_of<float>(x, y, z) : usable_of<double>(x, y, z);
}

}  // namespace

void bind_wire(nb::module_& module) {
  using namespace nb::literals;
  module.def("usable_points", &usable_of_any, "x"_a, "y"_a, "z"_a,
             nb::sig("def usable_points(x: NDArray[numpy.floating], y: NDArray[numpy.floating], z: NDArray[numpy.floating])"
                     " -> tuple[NDArray[numpy.float32], NDArray[numpy.bool_]]"));
  module.def(
      "all_within",
      [](In<float, nb::shape<-1, 3>> points, double limit_m) {
        return without_gil([&] { return all_within(points.data(), points.shape(0), limit_m); });
      },
      "points"_a.noconvert(), "limit_m"_a);
  module.def(
      "points_of_planes",
      [](Planes planes, double resolution_m, In<double, nb::shape<3>> origin) {
        const std::size_t bytes = planes.shape(0) / 3, count = planes.shape(1);
        require(planes.shape(0) == 6 || planes.shape(0) == 12, "a coordinate has 2 or 4 bytes");
        auto points = memory<float>(3 * count);
        without_gil([&] { points_of_planes(planes.data(), count, bytes, resolution_m, origin.data(), points.get()); });
        return array_of(std::move(points), {count, 3});
      },
      "planes"_a.noconvert(), "resolution_m"_a, "origin"_a);
  module.def(
      "intensity_of_planes",
      [](Planes planes, double scale, double offset) {
        const std::size_t bytes = planes.shape(0), count = planes.shape(1);
        require(bytes == 1 || bytes == 2, "an intensity has 1 or 2 bytes");
        auto intensity = memory<float>(count);
        without_gil([&] { intensity_of_planes(planes.data(), count, bytes, scale, offset, intensity.get()); });
        return array_of(std::move(intensity), {count});
      },
      "planes"_a.noconvert(), "scale"_a, "offset"_a);
  module.def(
      "range_image_points",
      [](Octets gaps, Octets ranges, std::uint32_t count, double resolution_m, CosinesAndSines azimuths,
         CosinesAndSines elevations) {
        require(gaps.size() >= (std::size_t{count} + 1) / 2 && ranges.size() >= count, "there are too few bytes");
        require(azimuths.shape(1) > 0 && azimuths.shape(1) < 65'536 && elevations.shape(1) < 65'536,
                "a grid has at most 65,535 columns and rows");
        auto points = memory<float>(3 * std::size_t{count});
        without_gil([&] {
          range_image_points(span_of(gaps), span_of(ranges), count, resolution_m, angles_of(azimuths),
                             angles_of(elevations), points.get());
        });
        return array_of(std::move(points), {count, 3});
      },
      "gaps"_a.noconvert(), "ranges"_a.noconvert(), "count"_a, "resolution_m"_a, "azimuths"_a, "elevations"_a);
  module.def(
      "compact_points",
      [](Planes planes, Octets low, In<std::int64_t, nb::shape<3>> lowest, In<std::int64_t, nb::shape<3>> size,
         double resolution_m) {
        const std::size_t count = planes.shape(1);
        require(planes.shape(0) == 4 && low.size() >= (3 * count + 1) / 2, "there are too few bytes");
        CompactGrid grid;
        grid.resolution_m = resolution_m;
        for (std::size_t axis = 0; axis < 3; ++axis) {
          grid.lowest[axis] = lowest(axis), grid.size[axis] = size(axis);
          require(grid.lowest[axis] >= -32'768 && grid.lowest[axis] < 32'768, "a lowest cell has 16 bits");
          require(grid.size[axis] >= 1 && grid.size[axis] < 65'536, "there are 1 to 65,535 cells along an axis");
        }
        auto points = memory<float>(3 * count);
        without_gil([&] { compact_points(planes.data(), low.data(), count, grid, points.get()); });
        return array_of(std::move(points), {count, 3});
      },
      "planes"_a.noconvert(), "low"_a.noconvert(), "lowest"_a, "size"_a, "resolution_m"_a);
  module.def(
      "compact_planes",
      [](In<float, nb::shape<-1, 3>> points, double resolution_m) {
        const std::size_t count = points.shape(0);
        require(count <= kMaxCompactPoints, "a compact query has at most 10,000 points");
        require(resolution_m >= 0.004 && resolution_m <= 1.0, "a step has 4 mm to 1 m");
        CompactPlanes made;
        const bool is_near = without_gil([&] {
          const bool within = all_within(points.data(), count, kMaxAbsCoordinate);
          if (within) made = compact_planes(points.data(), count, resolution_m);
          return within;
        });
        require(is_near, "a coordinate is not finite, or beyond 1000 m");
        std::vector<std::int64_t> box(made.box.lowest.begin(), made.box.lowest.end());
        box.insert(box.end(), made.box.size.begin(), made.box.size.end());
        return nb::make_tuple(array_of(std::move(box), {2, 3}), array_of(std::move(made.planes)),
                              array_of(std::move(made.low)), array_of(std::move(made.order)));
      },
      "points"_a, "resolution_m"_a,
      nb::sig("def compact_planes(points: NDArray[numpy.float32], resolution_m: float)"
              " -> tuple[NDArray[numpy.int64], NDArray[numpy.uint8], NDArray[numpy.uint8], NDArray[numpy.int64]]"));
  module.def(
      "levels_of_ranges",
      [](In<float, nb::shape<-1>> nearest_m, In<float, nb::shape<-1>> edges_m) {
        require(edges_m.size() < 255, "a level has 8 bits");
        return array_of(without_gil(
            [&] { return levels_of_ranges(nearest_m.data(), nearest_m.size(), edges_m.data(), edges_m.size()); }));
      },
      "nearest_m"_a, "edges_m"_a);
  module.def(
      "ranges_of_levels",
      [](Octets content, In<float, nb::shape<256>> levels_m, std::uint32_t directions) {
        require(content.size() >= (std::size_t{directions} + 7) / 8, "there are too few bytes");
        auto nearest_m = memory<float>(directions);
        without_gil([&] { ranges_of_levels(span_of(content), levels_m.data(), directions, nearest_m.get()); });
        return array_of(std::move(nearest_m), {directions});
      },
      "content"_a.noconvert(), "levels_m"_a, "directions"_a);
}

}  // namespace firstfix::python
