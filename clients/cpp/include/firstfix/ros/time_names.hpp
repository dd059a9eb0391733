// Names of the fields that may have the times of a cloud's points, and the units of these.
#pragma once

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "firstfix/scan/scan.hpp"

namespace firstfix::ros::detail {

constexpr std::array<const char*, 11> kTimeNames = {"t", "offset_time", "time", "timestamp", "time_stamp", "time_offset",
                                                    "ts", "gps_time", "gpstime", "offset", "stamp"};
constexpr double kShortestTurnS = 0.02, kLongestTurnS = 0.25;  // half of a turn at 20 Hz; one at 5 Hz, with its jitter
constexpr double kLongestS = 2 * kMaxAbsTime;

inline std::string lower(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

inline bool ends_with(const std::string& text, const std::string& ending) {
  return text.size() >= ending.size() && text.compare(text.size() - ending.size(), ending.size(), ending) == 0;
}

inline std::string plain_name(const std::string& name) {
  constexpr const char* kCloudCompare = "scalar_";  // before the names of all fields that it does not know
  const std::string plain = lower(name);
  return plain.rfind(kCloudCompare, 0) == 0 ? plain.substr(7) : plain;
}

inline bool is_time_name(const std::string& name) {
  const std::string plain = plain_name(name);
  return std::find(kTimeNames.begin(), kTimeNames.end(), plain) != kTimeNames.end() || plain.find("time") != plain.npos ||
         plain.find("stamp") != plain.npos;
}

struct Unit {
  const char* name;
  double seconds, least_s, most_s;  // in which a scan's times span so much
};

// Seconds and nanoseconds are what drivers write: short parts of a turn, and joined turns, are taken too.
constexpr Unit kUnits[] = {{"s", 1.0, 1e-4, kLongestS},
                           {"ms", 1e-3, kShortestTurnS, kLongestTurnS},
                           {"us", 1e-6, kShortestTurnS, kLongestTurnS},
                           {"ns", 1e-9, 1e-3, kLongestS}};

// The unit that ends a name, as of time_offset_ns.
inline const Unit* unit_in_name(std::string plain) {
  if (ends_with(plain, "\n")) plain.pop_back();
  if (ends_with(plain, ")")) plain.pop_back();
  for (const char* seconds : {"seconds", "second", "sec", "s"}) {
    if (!ends_with(plain, seconds)) continue;
    const std::string before = plain.substr(0, plain.size() - std::string(seconds).size());
    constexpr std::pair<const char*, int> kPrefixes[] = {{"", 0}, {"m", 1}, {"milli", 1}, {"u", 2}, {"micro", 2}, {"n", 3}, {"nano", 3}};
    for (const auto& [prefix, unit] : kPrefixes) {
      for (const char* parting : {"_", " ", "("}) {
        if (ends_with(before, std::string(parting) + prefix)) return &kUnits[unit];
      }
    }
  }
  return nullptr;
}

}  // namespace firstfix::ros::detail
