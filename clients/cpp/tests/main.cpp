#include <cstdio>
#include <cstdlib>

#include "programs.hpp"

int main(int argc, char** argv) {
  using namespace firstfix::test;
  const std::string part = argc > 1 ? argv[1] : "";
  if (part == "conformance" && argc == 3) return conformance(std::string(argv[2]) + "/");
  if (part == "hostile" && argc == 3) return hostile(std::string(argv[2]) + "/");
  if (part == "calls" && argc == 6) return calls(argv[2], argv[3], argv[4], std::atof(argv[5]));
  std::fputs("usage: firstfix_tests conformance FOLDER | hostile FOLDER | calls URL CALL MAP TIMEOUT_S\n", stderr);
  return 2;
}
