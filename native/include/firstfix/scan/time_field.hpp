// The field of a cloud that has the times of its points, or looks like it.
#pragma once

#include <locale>
#include <sstream>
#include <string>

namespace firstfix {

struct TimeField {
  std::string name;             // two names with a plus between them: seconds and nanoseconds
  std::string type;             // of its numbers, as uint32
  double first = 0, last = 0;   // the least and the greatest number of a point that is a return
  std::string unit{};           // s, ms, us or ns; empty: the field was not understood
  std::string clock{};          // what the numbers count from: stamp, epoch (by the stamp's clock) or own; empty: not understood
  std::string why{};            // it was not understood

  // Drivers fill in zeros where they know no times.
  bool is_filling() const { return !(first < 0 || first > 0 || last < 0 || last > 0); }

  // The field in words: its name, type, range and unit.
  std::string described() const {
    constexpr std::size_t kShown = 60;  // characters of a name: those of strangers may be long
    std::ostringstream text;
    text.imbue(std::locale::classic());
    text.precision(15);
    text << shown(name, kShown) << " (" << type << ", " << first << " to " << last;
    if (!unit.empty()) text << " " << unit;
    text << ")";
    return text.str();
  }

  // The first characters of a text in UTF-8.
  static std::string shown(const std::string& text, std::size_t characters) {
    std::size_t at = 0;
    for (; at < text.size(); ++at) {
      if ((static_cast<unsigned char>(text[at]) & 0xC0U) != 0x80U && characters-- == 0) break;
    }
    return text.substr(0, at);
  }
};

}  // namespace firstfix
