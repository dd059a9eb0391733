#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <cmath>
#include <cstdint>
#include <optional>
#include <tuple>
#include <utility>

#include "arrays.hpp"
#include "firstfix/scan/condense.hpp"
#include "layered_grid.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

// Rings, sectors, max_range_m and layer edges.
using Descriptor = std::tuple<std::size_t, std::size_t, double, Edges>;

LayeredOccupancy descriptor_of(const Descriptor& given) {
  const auto& [rings, sectors, max_range_m, edges_m] = given;
  LayeredOccupancy made{rings, sectors, max_range_m, {}};
  require(edges_m.shape(0) <= 100, "a descriptor has too many layers");
  made.layer_edges_m.assign(edges_m.data(), edges_m.data() + edges_m.shape(0));
  return made;
}

nb::object described_of(std::optional<ScanDescriptor>&& described) {
  if (!described) return nb::none();
  return nb::make_tuple(array_of(std::move(described->occupancy)), array_of(std::vector<double>(described->up.begin(), described->up.end())),
                        described->height_m);
}

nb::object condensed(const In<float, nb::shape<-1, 3>>& points, const std::optional<Times>& time_s, double min_range_m, double max_range_m,
                     double voxel_m, double default_height_m, const std::optional<Descriptor>& descriptor,
                     const std::optional<In<double, nb::shape<3>>>& gravity, std::size_t most) {
  const std::size_t count = points.shape(0);
  require(count <= kMaxPoints, "a scan has too many points");
  if (time_s) check_times(*time_s, count);
  DescriptorParameters parameters{min_range_m, max_range_m, voxel_m, default_height_m, std::nullopt};
  if (descriptor) parameters.descriptor = descriptor_of(*descriptor);
  std::optional<Gravity> down;
  if (gravity) down = Gravity{(*gravity)(0), (*gravity)(1), (*gravity)(2)};
  const float no_time = 0;  // of a scan without points the times have no memory
  const float* const times = !time_s ? nullptr : count == 0 ? &no_time : time_s->data();
  CompactScan made = without_gil([&] { return condense(Returns{points.data(), times, count}, parameters, down, most); });
  auto kept = memory<float>(3 * made.points.size());
  if (!made.points.empty()) std::memcpy(kept.get(), made.points.data(), made.points.size() * sizeof(Point));
  nb::object kept_s = nb::none();
  if (made.time_s) kept_s = nb::cast(array_of(std::move(*made.time_s)));
  return nb::make_tuple(array_of(std::move(kept), {made.points.size(), 3}), array_of(std::move(made.nearest_m)), kept_s,
                        described_of(std::move(made.described)));
}

}  // namespace

void bind_condense(nb::module_& module) {
  using namespace nb::literals;
  module.def("condensed", &condensed, "points"_a, "time_s"_a.none(), "min_range_m"_a, "max_range_m"_a, "voxel_m"_a, "default_height_m"_a,
             "descriptor"_a.none(), "gravity"_a.none(), "most"_a,
             nb::sig("def condensed(points: NDArray[numpy.float32], time_s: NDArray[numpy.float32] | None, min_range_m: float,"
                     " max_range_m: float, voxel_m: float, default_height_m: float,"
                     " descriptor: tuple[int, int, float, NDArray[numpy.float32]] | None, gravity: NDArray[numpy.float64] | None,"
                     " most: int) -> tuple[NDArray[numpy.float32], NDArray[numpy.float32], NDArray[numpy.float32] | None,"
                     " tuple[NDArray[numpy.uint8], NDArray[numpy.float64], float] | None]"));
}

}  // namespace firstfix::python
