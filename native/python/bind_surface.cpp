#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "arrays.hpp"
#include "firstfix/registration/normals.hpp"
#include "firstfix/registration/thin_surface.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace {

using Vectors = In<float, nb::shape<-1, 3>>;

void require_metres(const Vectors& points) {
  constexpr float kFurthestM = 1e15F;  // the square of a distance is still a number
  const bool usable = std::all_of(points.data(), points.data() + points.size(),
                                  [](float metres) { return std::fabs(metres) <= kFurthestM; });
  require(usable && points.shape(0) < std::numeric_limits<std::uint32_t>::max(),
          "the points of a surface are not finite, too far away, or too many");
}

}  // namespace

void bind_surface(nb::module_& module) {
  using namespace nb::literals;
  module.def(
      "surface_normals",
      [](Vectors points, std::optional<Vectors> to_viewer, bool two_faces) {
        const std::size_t count = points.shape(0);
        require(!to_viewer || to_viewer->shape(0) == count, "there is not one direction for each point");
        require_metres(points);
        std::vector<float> normals;
        std::vector<std::uint8_t> oriented;
        without_gil([&] {
          normals.resize(3 * count);
          oriented.resize(count);
          surface_normals(vectors_of(points), to_viewer ? to_viewer->data() : nullptr, two_faces, normals.data(),
                          oriented.data());
        });
        return std::make_tuple(array_of(std::move(normals), {count, 3}), array_of(std::move(oriented), {count}));
      },
      "points"_a, "to_viewer"_a = nb::none(), "two_faces"_a = false);
  module.def(
      "thin_surface",
      [](Vectors points, Vectors normals, In<bool, nb::shape<-1>> oriented, double voxel_m) {
        const std::size_t count = points.shape(0);
        require(normals.shape(0) == count && oriented.shape(0) == count, "there is not one normal for each point");
        ThinnedSurface thinned;
        without_gil([&] {
          // a byte of a view as bool may hold more than 0 and 1
          const auto* sure = reinterpret_cast<const std::uint8_t*>(oriented.data());
          thinned = thin_surface(vectors_of(points), vectors_of(normals), sure, voxel_m);
        });
        const std::size_t left = thinned.oriented.size();
        return std::make_tuple(array_of(std::move(thinned.points), {left, 3}),
                               array_of(std::move(thinned.normals), {left, 3}),
                               array_of(std::move(thinned.oriented), {left}));
      },
      "points"_a, "normals"_a, "oriented"_a, "voxel_m"_a);
}

}  // namespace firstfix::python
