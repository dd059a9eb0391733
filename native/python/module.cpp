// The extension module. Its name tells the instruction set that it was compiled for.
#include <nanobind/nanobind.h>

#include "rooms.hpp"
#include "source_digest.hpp"

#define FIRSTFIX_TEXT_OF(name) #name
#define FIRSTFIX_TEXT(name) FIRSTFIX_TEXT_OF(name)

NB_MODULE(FIRSTFIX_MODULE, module) {
  module.attr("variant") = FIRSTFIX_TEXT(FIRSTFIX_MODULE) + 1;  // without the underscore
  module.attr("source_digest") = FIRSTFIX_SOURCE_DIGEST;
  firstfix::python::bind_errors();
  firstfix::python::bind_descriptor(module);
  firstfix::python::bind_mesh(module);
  firstfix::python::bind_registration(module);
  firstfix::python::bind_index(module);
  firstfix::python::bind_query(module);
  firstfix::python::bind_prepared_query(module);
  firstfix::python::bind_places(module);
  firstfix::python::bind_retrieval(module);
  firstfix::python::bind_scan(module);
  firstfix::python::bind_condense(module);
  firstfix::python::bind_ranking(module);
  firstfix::python::bind_search(module);
  firstfix::python::bind_map_search(module);
  firstfix::python::bind_simulation(module);
  firstfix::python::bind_surface(module);
  firstfix::python::bind_verification(module);
  firstfix::python::bind_changes(module);
  firstfix::python::bind_wire(module);
}
