#include "finding_texts.hpp"

#include <algorithm>
#include <cstddef>
#include <iomanip>
#include <iterator>
#include <locale>
#include <sstream>
#include <stdexcept>

#include "finding_kinds.hpp"

namespace firstfix::version {
namespace {

// A number in the form of Python's: g, .4g, .2f, ,.0f, .1e or .0%.
std::string formatted(double number, const std::string& form) {
  const bool has_commas = form.front() == ',';
  const std::size_t point = form.find('.');
  const char kind = form.back();
  std::ostringstream text;
  text.imbue(std::locale::classic());
  if (point != form.npos) text << std::setprecision(form[point + 1] - '0');
  if (kind == 'f' || kind == '%') text << std::fixed;
  if (kind == 'e') text << std::scientific;
  text << (kind == '%' ? 100 * number : number);
  std::string made = text.str();
  const std::size_t end = std::min(made.find('.'), made.size()), begin = made.front() == '-' ? 1 : 0;
  for (std::size_t at = end; has_commas && at > begin + 3;) made.insert(at -= 3, ",");
  return kind == '%' ? made + "%" : made;
}

}  // namespace

std::string filled(const std::string& text, const std::map<std::string, double>& numbers,
                   const std::map<std::string, std::string>& words) {
  std::string made;
  std::size_t at = 0;
  for (std::size_t open = text.find('{'); open != text.npos; open = text.find('{', at)) {
    const std::size_t close = text.find('}', open), colon = std::min(text.find(':', open), close);
    const std::string name = text.substr(open + 1, colon - open - 1);
    made += text.substr(at, open - at);
    made += colon == close ? words.at(name) : formatted(numbers.at(name), text.substr(colon + 1, close - colon - 1));
    at = close + 1;
  }
  return made + text.substr(at);
}

Finding found(const std::string& code, const std::map<std::string, double>& numbers, const std::map<std::string, std::string>& words) {
  const auto* const kind = std::find_if(std::begin(kFindingKinds), std::end(kFindingKinds),
                                        [&code](const FindingKind& one) { return one.code == code; });
  if (kind == std::end(kFindingKinds)) throw std::logic_error("no finding has the code " + code);
  return {kind->code, kind->severity, filled(kind->text, numbers, words), filled(kind->remedy, numbers, words), numbers, kFindingsPage};
}

}  // namespace firstfix::version
