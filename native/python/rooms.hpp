// The bindings, one function for each room of the core.
#pragma once

#include <nanobind/nanobind.h>

namespace firstfix::python {

void bind_changes(nanobind::module_& module);
void bind_condense(nanobind::module_& module);
void bind_descriptor(nanobind::module_& module);
void bind_map_search(nanobind::module_& module);
void bind_mesh(nanobind::module_& module);
void bind_registration(nanobind::module_& module);
void bind_index(nanobind::module_& module);
void bind_query(nanobind::module_& module);
void bind_prepared_query(nanobind::module_& module);
void bind_places(nanobind::module_& module);
void bind_retrieval(nanobind::module_& module);
void bind_scan(nanobind::module_& module);
void bind_ranking(nanobind::module_& module);
void bind_search(nanobind::module_& module);
void bind_simulation(nanobind::module_& module);
void bind_surface(nanobind::module_& module);
void bind_verification(nanobind::module_& module);
void bind_errors();
void bind_wire(nanobind::module_& module);

}  // namespace firstfix::python
