// The library's exception as the Python class with its code.
#include <nanobind/nanobind.h>

#include <exception>

#include "firstfix/errors.hpp"
#include "rooms.hpp"

namespace firstfix::python {

namespace nb = nanobind;

void bind_errors() {
  nb::register_exception_translator([](const std::exception_ptr& raised, void*) {
    try {
      std::rethrow_exception(raised);
    } catch (const Error& error) {
      const nb::object kind = nb::module_::import_("firstfix.errors").attr("error_class")(error.code().c_str());
      PyErr_SetString(kind.ptr(), error.detail().c_str());
    }
  });
}

}  // namespace firstfix::python
