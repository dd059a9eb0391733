// What the client throws: one class, told apart by its code, which never changes.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>

namespace firstfix {

// "Not localized" is no error: it is an answer without a pose.
//
// code() is the protocol's (clients/PROTOCOL.md, Errors): of the service, or of this side where it refuses the
// input itself. Two belong to this side alone: "unreachable", no service answered, and "unreadable", what answered
// is no firstfix service.
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
