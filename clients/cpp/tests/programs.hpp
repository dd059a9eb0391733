// The parts of firstfix_tests. Each returns an exit code.
#pragma once

#include <string>

namespace firstfix::test {

int conformance(const std::string& folder);
int hostile(const std::string& folder);
int calls(const std::string& url, const std::string& call, const std::string& map_id, double timeout_s);

}  // namespace firstfix::test
