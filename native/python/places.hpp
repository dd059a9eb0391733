// The tables of a version's templates by place, as Python hands them over.
#pragma once

#include <cstdint>

#include "arrays.hpp"
#include "firstfix/query/searched_map.hpp"

namespace firstfix::python {

// Tables of templates, kept as long as a kernel may read them.
class Places {
 public:
  Places(In<float, nb::shape<-1, 3>> position_m, In<float, nb::ndim<1>> height_m, In<std::int32_t, nb::ndim<1>> row,
         In<std::int32_t, nb::ndim<2>> begin, In<std::int32_t, nb::shape<2>> low)
      : position_m_(position_m), height_m_(height_m), row_(row), begin_(begin) {
    const std::size_t count = position_m.shape(0);
    require(height_m.shape(0) == count && row.shape(0) == count, "there is not one row for each template");
    require(begin.shape(0) > 0 && begin.shape(1) > 0, "the table of tiles is empty");
    view = {position_m.data(), height_m.data(), count,
            {row.data(), begin.data(), begin.shape(0), begin.shape(1) - 1, {low.data()[0], low.data()[1]}}};
    view.tiles.check(count);
  }

  TemplatePlaces view{};

 private:
  In<float, nb::shape<-1, 3>> position_m_;
  In<float, nb::ndim<1>> height_m_;
  In<std::int32_t, nb::ndim<1>> row_;
  In<std::int32_t, nb::ndim<2>> begin_;
};

class Aliases {
 public:
  Aliases(In<std::int32_t, nb::ndim<2>> row, In<std::uint8_t, nb::ndim<2>> turn, In<std::uint8_t, nb::ndim<2>> score)
      : row_(row), turn_(turn), score_(score) {
    for (const auto& other : {turn, score}) {
      require(other.shape(0) == row.shape(0) && other.shape(1) == row.shape(1), "an alias has one row, one turn and one score");
    }
    view = {row.data(), turn.data(), score.data(), row.shape(0), row.shape(1)};
    view.check();
  }

  AliasTable view{};

 private:
  In<std::int32_t, nb::ndim<2>> row_;
  In<std::uint8_t, nb::ndim<2>> turn_, score_;
};

}  // namespace firstfix::python
