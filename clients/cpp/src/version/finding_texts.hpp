// Findings in the words of a service.
#pragma once

#include <map>
#include <string>

#include "firstfix/answer/documents.hpp"

namespace firstfix::version {

// The finding of this code, one of firstfix.findings.scan_kinds, with these numbers, each rounded as its text says, and words that are no
// numbers.
Finding found(const std::string& code, const std::map<std::string, double>& numbers, const std::map<std::string, std::string>& words = {});

// A text with the names of numbers in braces, with these numbers.
std::string filled(const std::string& text, const std::map<std::string, double>& numbers,
                   const std::map<std::string, std::string>& words = {});

}  // namespace firstfix::version
