# The header-only library. The C++ client includes this file too.
add_library(firstfix_core INTERFACE)
add_library(firstfix::core ALIAS firstfix_core)
set_target_properties(firstfix_core PROPERTIES EXPORT_NAME core)
target_compile_features(firstfix_core INTERFACE cxx_std_17)
target_include_directories(firstfix_core INTERFACE
  $<BUILD_INTERFACE:${CMAKE_CURRENT_LIST_DIR}/../include> $<INSTALL_INTERFACE:include>)
# A fused multiply-add rounds once where the protocol rounds twice. Compilers for ARM use it unless it is switched off.
target_compile_options(firstfix_core INTERFACE $<$<CXX_COMPILER_ID:GNU,Clang,AppleClang>:-ffp-contract=off>)
