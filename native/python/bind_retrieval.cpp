#include <algorithm>

#include "arrays.hpp"
#include "firstfix/retrieval/nearest_in_lists.hpp"
#include "firstfix/retrieval/spread_out.hpp"
#include "rooms.hpp"

namespace firstfix::python {

void bind_retrieval(nb::module_& module) {
  module.def(
      "nearest_in_lists",
      [](In<float, nb::shape<-1, -1>> queries, In<std::int64_t, nb::shape<-1, -1>> probed, In<float, nb::shape<-1, -1>> keys,
         In<std::int64_t, nb::shape<-1>> start, std::size_t most) {
        const std::size_t count = queries.shape(0), numbers = queries.shape(1), known = keys.shape(0);
        require(probed.shape(0) == count, "there is not one row of lists for each query");
        require(keys.shape(1) == numbers, "a query has not as many numbers as a key");
        require(known < std::size_t{1} << 32, "there are too many keys");
        require(start.shape(0) > 0 && start.data()[0] == 0 && std::is_sorted(start.data(), start.data() + start.shape(0)) &&
                    start.data()[start.shape(0) - 1] == static_cast<std::int64_t>(known),
                "the lists do not hold every key once");
        const auto lists = static_cast<std::int64_t>(start.shape(0) - 1);
        require(std::all_of(probed.data(), probed.data() + probed.size(), [&](auto list) { return 0 <= list && list < lists; }),
                "there is no such list");
        require(0 < most && most <= known, "more are wanted than there are keys, or none");
        std::vector<std::int64_t> found(count * most);
        without_gil([&] {
          nearest_in_lists({keys.data(), numbers, start.data(), start.shape(0) - 1}, queries.data(), count, probed.data(),
                           probed.shape(1), most, found.data());
        });
        return array_of(std::move(found), {count, most});
      },
      nb::arg("queries"), nb::arg("probed"), nb::arg("keys"), nb::arg("start"), nb::arg("most"));
  module.def(
      "spread_out",
      [](In<double, nb::shape<-1, 3>> position_m, In<double, nb::shape<-1>> yaw_rad, std::size_t at_most, double spot_m,
         double spot_cosine, std::size_t at_most_a_spot) {
        const std::size_t count = position_m.shape(0);
        require(yaw_rad.shape(0) == count, "a pose has one position and one yaw");
        return array_of(without_gil([&] {
          return spread_out(position_m.data(), yaw_rad.data(), count, at_most, {spot_m, spot_cosine, at_most_a_spot});
        }));
      },
      nb::arg("position_m"), nb::arg("yaw_rad"), nb::arg("at_most"), nb::arg("spot_m"), nb::arg("spot_cosine"),
      nb::arg("at_most_a_spot"));
}

}  // namespace firstfix::python
