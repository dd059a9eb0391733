# One module for each instruction set, from the same sources. Each is a shared object of its own with hidden symbols, so no
# function compiled for a newer processor can replace one of the same name in another. firstfix.native loads one of them.
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "" FORCE)
endif()
find_package(Python 3.10 REQUIRED COMPONENTS Interpreter Development.Module)
execute_process(COMMAND ${Python_EXECUTABLE} -m nanobind --cmake_dir
  OUTPUT_VARIABLE nanobind_ROOT OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
find_package(nanobind CONFIG REQUIRED)

set(FIRSTFIX_MODULES "" CACHE STRING "Modules to build; empty: all that the processor family has")
set(flags_baseline "")
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  set(flags_baseline -march=x86-64-v2)
  set(flags_avx2 -march=x86-64-v3)
  set(flags_avx512 -march=x86-64-v4 -mavx512vpopcntdq)
  set(modules baseline avx2 avx512)
else()
  set(modules baseline)
endif()
if(FIRSTFIX_MODULES)
  set(modules ${FIRSTFIX_MODULES})
endif()

# The sources' digest: builds on a kernel's result are made again when a kernel has changed.
set(generated ${CMAKE_CURRENT_BINARY_DIR}/generated)
add_custom_target(firstfix_digest BYPRODUCTS ${generated}/source_digest.hpp
  COMMAND ${CMAKE_COMMAND} -DSOURCE=${CMAKE_CURRENT_SOURCE_DIR} -DOUTPUT=${generated}/source_digest.hpp
    -P ${CMAKE_CURRENT_LIST_DIR}/source_digest.cmake)

# Outside a wheel the modules are built beside firstfix/native/__init__.py (scripts/native.sh).
set(package ${CMAKE_CURRENT_SOURCE_DIR}/../core/firstfix/native)
file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/python/*.cpp)
foreach(name ${modules})
  set(module _${name})
  nanobind_add_module(${module} NB_STATIC NOMINSIZE NB_DOMAIN firstfix${module} ${sources})
  add_dependencies(${module} firstfix_digest)
  target_link_libraries(${module} PRIVATE firstfix_core)
  target_include_directories(${module} PRIVATE ${generated})
  target_compile_definitions(${module} PRIVATE FIRSTFIX_MODULE=${module})
  target_compile_options(${module} PRIVATE -O3 ${flags_${name}} -fno-math-errno -fno-trapping-math -Wall -Wextra -Wno-psabi)
  if(FIRSTFIX_STRICT)
    target_compile_options(${module} PRIVATE -Werror)
  endif()
  if(NOT SKBUILD)
    set_target_properties(${module} PROPERTIES LIBRARY_OUTPUT_DIRECTORY ${package})
  else()
    install(TARGETS ${module} LIBRARY DESTINATION firstfix/native)
  endif()
endforeach()
