// Fields of a version's JSON files. Each is checked.
#pragma once

#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "firstfix/errors.hpp"

namespace firstfix::version {

using Json = nlohmann::json;

[[noreturn]] inline void refuse(const std::string& what) { throw Error("corrupt_version", what); }

inline Json parsed(const char* begin, std::size_t size, const std::string& name) {
  Json data = Json::parse(begin, begin + size, nullptr, false);
  if (!data.is_object()) refuse(name + " is not a JSON object");
  return data;
}

inline const Json& field(const Json& object, const char* name) {
  if (!object.is_object()) refuse(std::string(name) + " is not in an object");
  const auto found = object.find(name);
  if (found == object.end()) refuse(std::string(name) + " is missing");
  return *found;
}

inline double number(const Json& value, const char* name, double least, double most) {
  if (!value.is_number()) refuse(std::string(name) + " is not a number");
  const double found = value.get<double>();
  if (!(found >= least && found <= most)) refuse(std::string(name) + " is out of range");
  return found;
}

inline double number_in(const Json& object, const char* name, double least, double most) {
  return number(field(object, name), name, least, most);
}

inline std::size_t whole_in(const Json& object, const char* name, double least, double most) {
  const double found = number_in(object, name, least, most);
  if (found != std::floor(found)) refuse(std::string(name) + " is not a whole number");
  return static_cast<std::size_t>(found);
}

inline std::string text_in(const Json& object, const char* name) {
  const Json& value = field(object, name);
  if (!value.is_string()) refuse(std::string(name) + " is not a text");
  return value.get<std::string>();
}

inline std::vector<double> numbers_in(const Json& object, const char* name, std::size_t fewest, std::size_t most, double reach) {
  const Json& list = field(object, name);
  if (!list.is_array() || list.size() < fewest || list.size() > most) refuse(std::string(name) + " is not a list of the right length");
  std::vector<double> values;
  for (const Json& one : list) values.push_back(number(one, name, -reach, reach));
  return values;
}

}  // namespace firstfix::version
