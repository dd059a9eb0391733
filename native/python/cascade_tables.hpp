// The tables of a version's retrieval, as Python hands them over.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

#include "arrays.hpp"
#include "firstfix/query/similar_places.hpp"
#include "firstfix/retrieval/cascade.hpp"
#include "layered_grid.hpp"

namespace firstfix::python {

using Table = In<std::int32_t, nb::ndim<1>>;
using Bits = In<std::uint8_t, nb::ndim<1>>;

// The tables, kept as long as a kernel may read them.
class CascadeTables {
 public:
  CascadeTables(In<float, nb::shape<-1, 3>> position_m, In<std::uint8_t, nb::ndim<2>> occupancy, std::size_t rings,
                std::size_t sectors, double max_range_m, const Edges& edges_m, std::size_t coefficients, Table representative,
                Table start, Table member, Table tile_row, In<std::int32_t, nb::ndim<2>> tile_begin,
                In<std::int32_t, nb::shape<2>> tile_low,
                std::optional<In<float, nb::ndim<2>>> projection, In<std::uint8_t, nb::ndim<2>> codes,
                In<float, nb::ndim<1>> lowest, In<float, nb::ndim<1>> range)
      : position_m_(position_m), occupancy_(occupancy), representative_(representative), start_(start), member_(member),
        tile_row_(tile_row), tile_begin_(tile_begin), projection_(projection), codes_(codes), lowest_(lowest), range_(range),
        grid_(grid_of(rings, sectors, max_range_m, edges_m)) {
    rings *= grid_.layers();
    const std::size_t count = occupancy.shape(0), clusters = representative.shape(0);
    const std::size_t spectra = std::min(coefficients, sectors / 2 + 1);
    require(occupancy.shape(1) == (rings * sectors + 7) / 8, "an occupancy has another number of cells");
    require(position_m.shape(0) == count && member.shape(0) == count && tile_row.shape(0) == count,
            "there is not one row for each template");
    require(coefficients >= 1, "a key keeps at least one coefficient");
    require(start.shape(0) == clusters + 1, "the starts of the clusters do not fit the clusters");
    require(tile_begin.shape(0) > 0 && tile_begin.shape(1) > 0, "the table of tiles is empty");
    require(!projection || projection->shape(0) == rings * spectra, "the projection does not fit the key");
    require(lowest.shape(0) == codes.shape(1) && range.shape(0) == codes.shape(1), "the codes have not one range a number");
    view.templates = {occupancy.data(), count, rings, sectors};
    view.position_m = position_m.data();
    view.tiles = {tile_row.data(), tile_begin.data(), tile_begin.shape(0), tile_begin.shape(1) - 1,
                  {tile_low.data()[0], tile_low.data()[1]}};
    view.clusters = {representative.data(), start.data(), member.data(), clusters};
    view.form = {coefficients, projection ? projection->data() : nullptr, projection ? projection->shape(1) : 0};
    view.keys = {codes.data(), codes.shape(0), codes.shape(1), lowest.data(), range.data()};
    view.check();
  }

  const std::uint8_t* checked(const Bits& occupancy) const {
    require(occupancy.shape(0) == view.templates.bytes(), "the occupancy has another number of cells");
    return occupancy.data();
  }

  // How a scan is described as the templates are, and which of them resemble it.
  Describe describe() const { return by_occupancy(view, grid_); }

  const LayeredGrid& grid() const { return grid_; }

  std::size_t templates() const { return view.templates.count; }

  Cascade view{};

 private:
  In<float, nb::shape<-1, 3>> position_m_;
  In<std::uint8_t, nb::ndim<2>> occupancy_;
  Table representative_, start_, member_, tile_row_;
  In<std::int32_t, nb::ndim<2>> tile_begin_;
  std::optional<In<float, nb::ndim<2>>> projection_;
  In<std::uint8_t, nb::ndim<2>> codes_;
  In<float, nb::ndim<1>> lowest_, range_;
  LayeredGrid grid_;
};

}  // namespace firstfix::python
