// A number as Python writes it: the fewest digits that are read as the same number. The service's messages have such.
#pragma once

#include <cmath>
#include <cstdlib>
#include <iomanip>
#include <locale>
#include <sstream>
#include <string>

namespace firstfix::version {

inline std::string number_text(double value) {
  if (std::isnan(value)) return "nan";
  const std::string sign = std::signbit(value) ? "-" : "";
  if (std::isinf(value)) return sign + "inf";
  std::string digits;
  int exponent = 0;
  for (int precision = 0; precision < 17; ++precision) {
    std::ostringstream text;  // in any locale: d.ddde+XX
    text.imbue(std::locale::classic());
    text << std::scientific << std::setprecision(precision) << std::fabs(value);
    std::istringstream again(text.str());
    again.imbue(std::locale::classic());
    double found = 0;
    again >> found;
    const std::size_t at = text.str().find('e');
    digits = text.str().substr(0, 1) + (precision > 0 ? text.str().substr(2, at - 2) : "");
    exponent = std::atoi(text.str().c_str() + at + 1);
    if (found == std::fabs(value)) break;
  }
  const int count = static_cast<int>(digits.size());
  const auto first = [&](int number) { return digits.substr(0, static_cast<std::size_t>(number)); };
  const auto after = [&](int number) { return digits.substr(static_cast<std::size_t>(number)); };
  if (exponent < -4 || exponent >= 16) {
    const std::string power = std::to_string(std::abs(exponent));
    return sign + first(1) + (count > 1 ? "." + after(1) : "") + (exponent < 0 ? "e-" : "e+") + (power.size() < 2 ? "0" : "") + power;
  }
  const auto zeros = [](int number) { return std::string(static_cast<std::size_t>(number), '0'); };
  if (exponent < 0) return sign + "0." + zeros(-exponent - 1) + digits;
  if (count <= exponent + 1) return sign + digits + zeros(exponent + 1 - count) + ".0";
  return sign + first(exponent + 1) + "." + after(exponent + 1);
}

}  // namespace firstfix::version
