// The exception of this library. Its code says what went wrong and never changes.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>

namespace firstfix {

// A scan that is not localized is not an error: the answer then has no pose.
//
// code() is one of the protocol's codes (clients/PROTOCOL.md, Errors). The service sent it, or this library refused the
// input itself. Two codes exist in this library only: "unreachable" (no service answered) and "unreadable" (the answer
// is not from a firstfix service).
class Error : public std::runtime_error {
 public:
  Error(std::string code, const std::string& detail)
      : std::runtime_error(code + ": " + detail), code_(std::move(code)), detail_(detail) {}

  const std::string& code() const noexcept { return code_; }
  const std::string& detail() const noexcept { return detail_; }

 private:
  std::string code_;
  std::string detail_;
};

}  // namespace firstfix
