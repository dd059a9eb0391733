#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <tuple>
#include <vector>

#include "arrays.hpp"
#include "firstfix/changes/cell_counts.hpp"
#include "firstfix/changes/compared.hpp"
#include "firstfix/changes/unexplained.hpp"
#include "grid.hpp"
#include "rooms.hpp"
#include "tiles.hpp"

namespace firstfix::python {

namespace {

using Points = In<float, nb::shape<-1, 3>>;
using PoseArray = In<double, nb::shape<4, 4>>;
constexpr std::int32_t kMostColumns = 3600, kMostCellsAnEdge = 256;

nb::ndarray<nb::numpy, bool> flags_of(const std::vector<std::uint8_t>& values) {
  std::unique_ptr<bool[]> flags = memory<bool>(values.size());
  std::transform(values.begin(), values.end(), flags.get(), [](std::uint8_t value) { return value != 0; });
  return array_of(std::move(flags), {values.size()});
}

void check_reach(double reach_m) { require(reach_m > 0 && reach_m <= 1000, "points are compared from 0 to 1000 m"); }

auto compare_points(const Tiles& near, const Tiles& far, double fine_m, double reach_m, PoseArray T_map_sensor, Points returns,
                    std::int32_t columns) {
  check_reach(fine_m);
  check_reach(reach_m);
  require(columns >= 4 && columns <= kMostColumns && columns % 2 == 0, "there must be 4 to 3600 directions, an even number");
  ComparedPoints found;
  without_gil([&] {
    found.add(near.view, pose_of(T_map_sensor), 0.0F, static_cast<float>(fine_m));
    found.add(far.view, pose_of(T_map_sensor), static_cast<float>(fine_m), static_cast<float>(reach_m));
    found.compare(vectors_of(returns), columns);
  });
  const std::size_t count = found.size();
  auto gone = flags_of(found.gone), met = flags_of(found.met);
  return std::make_tuple(array_of(std::move(found.points), {count, 3}), gone, met);
}

nb::ndarray<nb::numpy, bool> unexplained_returns(Points returns, Points mapped, const Grid& fine, const Grid& coarse,
                                                 PoseArray T_map_sensor, Points around, Points below, double reach_m) {
  check_reach(reach_m);
  require(around.shape(0) <= 1000 && below.shape(0) <= 1000, "there are over 1000 places to look at");
  std::vector<std::uint8_t> is_new(returns.shape(0));
  without_gil([&] {
    unexplained(vectors_of(returns), vectors_of(mapped), fine.view, coarse.view, pose_of(T_map_sensor), vectors_of(around),
                vectors_of(below), static_cast<float>(reach_m), is_new.data());
  });
  return flags_of(is_new);
}

auto cell_counts(In<float, nb::shape<3, 3>> turn, In<float, nb::shape<3>> start, std::int32_t size, Points mapped, Flags gone,
                 Flags met, Points returns, Flags is_new, Points rays, In<float, nb::ndim<1>> until_m, double step_m) {
  require(size >= 1 && size <= kMostCellsAnEdge, "a cube has 1 to 256 cells along an edge");
  require(step_m > 1e-3 && step_m < 1e3, "the step of a ray must be 1 mm to 1 km");
  require(gone.shape(0) == mapped.shape(0) && met.shape(0) == mapped.shape(0), "mapped, gone and met differ in length");
  require(is_new.shape(0) == returns.shape(0), "returns and is_new differ in length");
  require(until_m.shape(0) == rays.shape(0), "rays and until_m differ in length");
  std::vector<std::int32_t> cells, counts;
  without_gil([&] {
    CellCounts cube(turn.data(), start.data(), size);
    for (std::size_t i = 0; i < mapped.shape(0); ++i) {
      if (bytes_of(gone)[i]) cube.add(mapped.data() + 3 * i, 0);
      if (bytes_of(met)[i]) cube.add(mapped.data() + 3 * i, 1);
    }
    for (std::size_t i = 0; i < returns.shape(0); ++i) {
      if (bytes_of(is_new)[i]) cube.add(returns.data() + 3 * i, 2);
    }
    for (std::size_t i = 0; i < rays.shape(0); ++i) {
      cube.add_ray(rays.data() + 3 * i, until_m.data()[i], static_cast<float>(step_m), 3);
    }
    cube.each([&](std::int32_t number, const CellCounts::Counts& found) {
      cells.push_back(number);
      counts.insert(counts.end(), found.begin(), found.end());
    });
  });
  const std::size_t count = cells.size();
  return std::make_tuple(array_of(std::move(cells), {count}), array_of(std::move(counts), {count, 4}));
}

}  // namespace

void bind_changes(nb::module_& module) {
  module.def("compare_points", &compare_points, nb::arg("near"), nb::arg("far"), nb::arg("fine_m"), nb::arg("reach_m"),
             nb::arg("T_map_sensor"), nb::arg("returns"), nb::arg("columns"));
  module.def("unexplained_returns", &unexplained_returns, nb::arg("returns"), nb::arg("mapped"), nb::arg("fine"),
             nb::arg("coarse"), nb::arg("T_map_sensor"), nb::arg("around"), nb::arg("below"), nb::arg("reach_m"));
  module.def("cell_counts", &cell_counts, nb::arg("turn"), nb::arg("start"), nb::arg("size"), nb::arg("mapped"),
             nb::arg("gone"), nb::arg("met"), nb::arg("returns"), nb::arg("is_new"), nb::arg("rays"), nb::arg("until_m"),
             nb::arg("step_m"));
}

}  // namespace firstfix::python
