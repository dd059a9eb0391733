#include "false_accept_bound.hpp"

#include <string>

#include "fields.hpp"
#include "number_text.hpp"

namespace firstfix::version {

FalseAcceptBound::FalseAcceptBound(const VersionFolder& folder) {
  constexpr const char* kName = "false_accept_bound.json";
  if (!folder.has(kName)) return;
  const MappedFile file = folder.file(kName);
  const Json stored = parsed(reinterpret_cast<const char*>(file.data()), file.size(), kName);
  const Json& rows = field(stored, "rows");
  if (!rows.is_array()) file.refuse("rows is not a list");
  for (const Json& one : rows) {
    const Row row{number_in(one, "min_probability", 0, 1), number_in(one, "bound", 0, 1)};
    if (!rows_.empty() && !(rows_.back().min_probability < row.min_probability && rows_.back().bound >= row.bound)) {
      file.refuse("its rows are out of order");
    }
    rows_.push_back(row);
  }
}

double FalseAcceptBound::min_probability(double max_false_accept, const std::string& map_id) const {
  for (const Row& row : rows_) {
    if (row.bound <= max_false_accept) return row.min_probability;
  }
  const std::string asked = "max_false_accept " + number_text(max_false_accept) + ": ";
  const std::string of_map = map_id.empty() ? "this map" : "map " + map_id;
  throw Error("invalid_option", asked + (rows_.empty() ? "no bound was measured for " + of_map + ", build it again"
                                                       : "the least bound of " + of_map + " is " + number_text(rows_.back().bound)));
}

}  // namespace firstfix::version
