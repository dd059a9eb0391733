// Decides which field of a cloud has the times of its points, and in which unit: as firstfix.formats.point_times of the service,
// which says why.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iomanip>
#include <limits>
#include <locale>
#include <optional>
#include <sstream>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "firstfix/bit_exact/sample.hpp"
#include "firstfix/ros/columns.hpp"
#include "firstfix/ros/time_names.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/time_field.hpp"

namespace firstfix::ros {

// time_s: (n) seconds from the stamp; points that are no returns may have the first return's. Nothing: not known.
struct PointTimes {
  std::optional<std::vector<float>> time_s;
  std::optional<TimeField> field;  // that was taken; else the first that looks like times and was not understood
};

namespace detail {

constexpr std::size_t kSampled = 1000;  // points that are looked at for a unit which no driver writes by itself
constexpr double kEpochS = 1e8;         // later than this, a time counts from the epoch

// As Python's format of this precision and form.
inline std::string digits_of(double number, int precision, bool is_fixed = false) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  if (is_fixed) text << std::fixed;
  text << std::setprecision(precision) << number;
  return text.str();
}

// Numbers of one field: of reals as double, of integers as such.
template <class Value>
class TimeNumbers {
 public:
  static constexpr bool kIsReal = std::is_floating_point_v<Value>;

  TimeNumbers(std::string name, NumberType type, std::vector<Value> values) : name_(std::move(name)), type_(type), values_(std::move(values)) {}

  // usable: of each point, whether it is a return; null: all count.
  PointTimes read(const std::vector<bool>* usable, std::optional<double> stamp_s) const {
    if (values_.empty()) return {};
    if (usable != nullptr && std::find(usable->begin(), usable->end(), false) == usable->end()) usable = nullptr;
    std::vector<Value> values = values_, taken = at(values, usable);
    auto [first, last] = bounds(taken);
    double without = 0;
    if constexpr (kIsReal) {
      if (!(std::isfinite(first) && std::isfinite(last))) {
        without = fill(values, usable);
        taken = at(values, usable);
        std::tie(first, last) = bounds(taken);
      }
    }
    TimeField field{name_, name_of(type_), static_cast<double>(first), static_cast<double>(last)};
    auto [unit, why] = unit_of(taken, first, last);
    if (without > kMostWithout) unit = nullptr, why = digits_of(100 * without, 0, true) + "% of the points have none";
    if (unit == nullptr) {
      field.why = why;
      return {std::nullopt, field};
    }
    const double span_s = span(first, last) * unit->seconds, first_s = static_cast<double>(first) * unit->seconds;
    field.clock = first_s > kEpochS ? "epoch" : "stamp";
    double begin_s = first_s;
    if (field.clock == "epoch") begin_s = first_s - stamp_s.value_or(first_s);
    if (!(begin_s >= -kMaxAbsTime && begin_s + span_s <= kMaxAbsTime)) {
      begin_s = 0, field.clock = "own";
      if (span_s > kMaxAbsTime) {
        field.clock.clear(), field.why = digits_of(span_s, 3) + " s are more than a scan takes";
        return {std::nullopt, field};
      }
    }
    field.unit = unit->name;
    std::vector<float> time_s;
    time_s.reserve(values.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double since = usable == nullptr || (*usable)[i] ? after(values[i], first) * unit->seconds : 0;
      time_s.push_back(static_cast<float>(since + begin_s));
    }
    return {std::move(time_s), field};
  }

 private:
  static constexpr double kMostWithout = 0.01;  // of the returns, whose time is NaN: each gets that of the point before
  using Found = std::pair<const Unit*, std::string>;

  static std::vector<Value> at(const std::vector<Value>& values, const std::vector<bool>* usable) {
    if (usable == nullptr) return values;
    std::vector<Value> made;
    for (std::size_t i = 0; i < values.size(); ++i) {
      if ((*usable)[i]) made.push_back(values[i]);
    }
    return made;
  }

  // The least and the greatest; not a number if one is not.
  static std::pair<Value, Value> bounds(const std::vector<Value>& values) {
    Value least = values.front(), most = values.front();
    for (const Value value : values) {
      if constexpr (kIsReal) {
        if (std::isnan(value)) return {value, value};
      }
      least = std::min(least, value), most = std::max(most, value);
    }
    return {least, most};
  }

  // Gives each that is not finite the number of the point before. Returns the share of these.
  static double fill(std::vector<Value>& values, const std::vector<bool>* usable) {
    std::size_t counted = 0, with = 0, first = values.size();
    std::vector<bool> has;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const bool is_usable = usable == nullptr || (*usable)[i];
      has.push_back(is_usable && std::isfinite(static_cast<double>(values[i])));
      counted += is_usable ? 1 : 0, with += has[i] ? 1 : 0;
      if (has[i] && first == values.size()) first = i;
    }
    Value before = first < values.size() ? values[first] : Value{};
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (has[i]) before = values[i];
      else values[i] = before;
    }
    return 1 - static_cast<double>(with) / static_cast<double>(counted);
  }

  static double span(Value first, Value last) {
    if constexpr (kIsReal) return last - first;
    else return static_cast<double>(static_cast<std::uint64_t>(last) - static_cast<std::uint64_t>(first));
  }

  // In the field's own numbers, as nanoseconds since the epoch are finer than a double. Those below the first wrap round, as in a
  // number of the field's size.
  double after(Value value, Value first) const {
    if constexpr (kIsReal) {
      return value - first;
    } else {
      const std::size_t bytes = bytes_of(type_);
      if (bytes < 4) return static_cast<double>(value) - static_cast<double>(first);
      const std::uint64_t difference = static_cast<std::uint64_t>(value) - static_cast<std::uint64_t>(first);
      if (std::is_signed_v<Value>) {
        if (bytes == 4) return static_cast<double>(static_cast<std::int32_t>(static_cast<std::uint32_t>(difference)));
        return static_cast<double>(static_cast<std::int64_t>(difference));
      }
      return static_cast<double>(bytes == 4 ? difference & 0xFFFFFFFFU : difference);
    }
  }

  // The unit in which the numbers of the returns span a scan; or none, and why they do in none.
  Found unit_of(const std::vector<Value>& taken, Value first, Value last) const {
    const double least = static_cast<double>(first), most = static_cast<double>(last), all = span(first, last);
    const double largest = std::max(-least, most);
    if (!(all < 0 || all > 0)) return {nullptr, "all are equal"};
    if (type_ == NumberType::float32) {
      constexpr double kFinest = 50;  // steps of a float32 in a turn, at least
      const auto size = static_cast<float>(largest);
      const auto step = static_cast<double>(std::nextafter(size, std::numeric_limits<float>::infinity()) - size);
      if (all < kFinest * step) return {nullptr, "a float32 of this size has steps of " + digits_of(step, 3) + ": too coarse for a turn"};
    }
    if (const Unit* named = unit_in_name(plain_name(name_))) {
      const double span_s = all * named->seconds;
      if (kUnits[0].least_s <= span_s && span_s <= kLongestS) return {named, ""};
      return {nullptr, digits_of(span_s, 3) + " s are not the time of a scan"};
    }
    for (const Unit& unit : kUnits) {
      const bool is_s = unit.seconds >= 1, is_usual = unit.most_s >= kLongestS;
      double most_s = unit.most_s;
      // a short part of a turn in milliseconds looks like more seconds
      if (is_s && !(least >= kEpochS || largest <= kMaxAbsTime)) most_s = kLongestTurnS;
      const double span_s = all * unit.seconds;
      if (!(unit.least_s <= span_s && span_s <= most_s) || (is_s && !kIsReal)) continue;
      if (most * unit.seconds > kTodayS[1]) continue;  // of a finer unit, with the span of a few points
      if (is_usual) {
        const std::string why = why_no_turn(taken, least, most, all, span_s);
        return {why.empty() ? &unit : nullptr, why};
      }
      const double coarser = (&unit - 1)->seconds;
      if (kTodayS[0] <= least * coarser && least * coarser <= kTodayS[1]) {
        return {nullptr, "by the clock these are " + digits_of(all * coarser, 3) + " s, more than a scan takes"};
      }
      if (!is_spread(taken, all)) return {nullptr, "most of the points have nearly the same"};
      if (all >= static_cast<double>(taken.size() - 1) && all <= static_cast<double>(taken.size() - 1) && is_counted(taken)) {
        return {nullptr, "they are the numbers of the points"};
      }
      return {&unit, ""};
    }
    return {nullptr, "in no unit they span a turn, or a part of one"};
  }

  // Why numbers that would be the seconds or nanoseconds of joined turns are none; empty: they may be.
  static std::string why_no_turn(const std::vector<Value>& taken, double first, double last, double all, double span_s) {
    const auto are = [&](double low, double high) { return !(first < low || first > low || last < high || last > high); };
    if (are(0, 1) || are(-0.5, 0.5)) {
      return digits_of(first, 6) + " to " + digits_of(last, 6) + " are shares of a turn, without its time";
    }
    if (!(span_s > kLongestTurnS)) return "";
    for (const double number : some_of(taken)) {
      if (number > first + all / 4 && number < last - all / 4) return "";
    }
    return "they are in two parts, as if they had begun anew";
  }

  // Whether the numbers fill their span, as those of a turn do.
  static bool is_spread(const std::vector<Value>& taken, double all) {
    constexpr double kFilled = 0.3;          // of the span, the middle 90 % of the points: a few stray numbers are no turn
    constexpr std::ptrdiff_t kLeastLevels = 8;  // different numbers in a turn: fewer are the rounding of a large number
    std::vector<Value> levels;
    for (const std::int64_t row : firstfix::detail::rows_by_chance(taken.size(), kSampled)) levels.push_back(taken[static_cast<std::size_t>(row)]);
    std::sort(levels.begin(), levels.end());
    std::vector<double> some(levels.begin(), levels.end());
    const double low = quantile(some, 0.05), high = quantile(some, 0.95);
    return high - low >= kFilled * all && std::unique(levels.begin(), levels.end()) - levels.begin() >= kLeastLevels;
  }

  static std::vector<double> some_of(const std::vector<Value>& taken) {
    std::vector<double> some;
    for (const std::int64_t row : firstfix::detail::rows_by_chance(taken.size(), kSampled)) {
      some.push_back(static_cast<double>(taken[static_cast<std::size_t>(row)]));
    }
    return some;
  }

  // Of ascending numbers, with a straight line between two of them.
  static double quantile(const std::vector<double>& some, double share) {
    const double at = share * static_cast<double>(some.size() - 1), below = std::floor(at), part = at - below;
    const auto number = static_cast<std::size_t>(below);
    const double low = some[number], high = some[std::min(number + 1, some.size() - 1)], step = high - low;
    return part >= 0.5 ? high - step * (1 - part) : low + step * part;
  }

  // Whether each is one more than that before, in numbers of the field's size.
  bool is_counted(const std::vector<Value>& taken) const {
    for (std::size_t i = 1; i < taken.size(); ++i) {
      double step;
      if constexpr (kIsReal) {
        step = taken[i] - taken[i - 1];
        if (type_ == NumberType::float32) step = static_cast<double>(static_cast<float>(step));
      } else {
        const std::uint64_t all_bits = static_cast<std::uint64_t>(taken[i]) - static_cast<std::uint64_t>(taken[i - 1]);
        step = static_cast<double>(all_bits & (~std::uint64_t{0} >> (64 - 8 * bytes_of(type_))));
      }
      if (step < 1 || step > 1) return false;
    }
    return true;
  }

  static constexpr double kTodayS[] = {1e9, 4.1e9};  // since the epoch, of the years 2001 to 2099

  std::string name_;
  NumberType type_;
  std::vector<Value> values_;
};

struct TimeCandidate {
  const Column* column;
  const Column* nanoseconds = nullptr;  // then the other has the whole seconds
};

// The fields whose names may mean times, by precedence.
inline std::vector<TimeCandidate> time_candidates(const std::vector<Column>& columns) {
  std::vector<std::pair<std::string, const Column*>> by_name;
  const auto find = [&by_name](const std::string& name) {
    return std::find_if(by_name.begin(), by_name.end(), [&name](const auto& one) { return one.first == name; });
  };
  for (const Column& column : columns) {
    const std::string plain = plain_name(column.name);
    if (find(plain) == by_name.end()) by_name.emplace_back(plain, &column);
  }
  std::vector<TimeCandidate> found;
  constexpr const char *kSeconds = "timesecond", *kNanoseconds = "timenanosecond";  // one time in two fields: Hesai's SDK
  if (find(kSeconds) != by_name.end() && find(kNanoseconds) != by_name.end()) {
    found.push_back({find(kSeconds)->second, find(kNanoseconds)->second});
    by_name.erase(find(kSeconds));
    by_name.erase(find(kNanoseconds));
  }
  for (const char* const name : kTimeNames) {
    if (find(name) != by_name.end()) found.push_back({find(name)->second});
  }
  for (const auto& [plain, column] : by_name) {
    const bool is_known = std::find(kTimeNames.begin(), kTimeNames.end(), plain) != kTimeNames.end();
    if (!is_known && is_time_name(plain)) found.push_back({column});
  }
  return found;
}

// Of each point, whether it is a return: finite, and not at the origin.
inline std::vector<bool> returns_of(const Axes& xyz) {
  const std::vector<double> along[] = {xyz[0]->as<double>(), xyz[1]->as<double>(), xyz[2]->as<double>()};
  const auto rounded = [](double number, const Column& like) {
    return like.type == NumberType::float32 ? static_cast<double>(static_cast<float>(number)) : number;
  };
  std::vector<bool> found;
  for (std::size_t i = 0; i < along[0].size(); ++i) {
    double square = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const double own = rounded(along[axis][i] * along[axis][i], *xyz[axis]);
      square = axis == 0 ? own : rounded(square + own, *xyz[0]);
    }
    found.push_back(square > 0 && std::isfinite(square));
  }
  return found;
}

inline std::int64_t whole_of(double number) {  // as processors convert what does not fit
  return std::fabs(number) < 9.2e18 ? static_cast<std::int64_t>(number) : std::numeric_limits<std::int64_t>::min();
}
inline std::int64_t whole_of(std::int64_t number) { return number; }
inline std::int64_t whole_of(std::uint64_t number) { return static_cast<std::int64_t>(number); }

// Both fields of one time, as nanoseconds.
inline std::vector<std::int64_t> joined_ns(const Column& seconds, const Column& nanoseconds) {
  std::vector<std::int64_t> made(seconds.size());
  const auto add = [&made](const Column& column, std::uint64_t ns) {
    std::visit([&](const auto& values) {
      for (std::size_t i = 0; i < made.size(); ++i) {
        made[i] = static_cast<std::int64_t>(static_cast<std::uint64_t>(made[i]) + ns * static_cast<std::uint64_t>(whole_of(values[i])));
      }
    }, column.values());
  };
  add(seconds, 1'000'000'000), add(nanoseconds, 1);
  return made;
}

// usable: of each point, whether it is a return; filled in when it is needed. Nothing: no point is one.
template <class Value>
std::optional<PointTimes> read_times(const TimeNumbers<Value>& numbers, const Axes& xyz, std::vector<bool>& usable,
                                     std::optional<double> stamp_s) {
  PointTimes found = numbers.read(nullptr, stamp_s);
  // most drivers give right times of all points; those by another clock count from the first return
  if (found.time_s && !(found.field && found.field->clock == "own")) return found;
  if (usable.empty()) usable = returns_of(xyz);
  if (std::find(usable.begin(), usable.end(), true) == usable.end()) return std::nullopt;
  return numbers.read(&usable, stamp_s);
}

}  // namespace detail

// columns: of numbers, all of them and x, y and z. stamp_s: of the cloud, in seconds since the epoch; nothing: not known.
inline PointTimes point_times(const std::vector<Column>& columns, const Axes& xyz, std::optional<double> stamp_s) {
  std::vector<bool> usable;
  std::optional<TimeField> failed;
  for (const detail::TimeCandidate& one : detail::time_candidates(columns)) {
    std::optional<PointTimes> found;
    if (one.nanoseconds != nullptr) {
      const detail::TimeNumbers<std::int64_t> numbers(one.column->name + "+" + one.nanoseconds->name, NumberType::int64,
                                                      detail::joined_ns(*one.column, *one.nanoseconds));
      found = detail::read_times(numbers, xyz, usable, stamp_s);
    } else {
      std::visit(
          [&](auto values) {
            using Value = typename decltype(values)::value_type;
            const detail::TimeNumbers<Value> numbers(one.column->name, one.column->type, std::move(values));
            found = detail::read_times(numbers, xyz, usable, stamp_s);
          },
          one.column->values());
    }
    if (!found) break;
    if (found->time_s) return *found;
    if (!failed || (failed->is_filling() && found->field)) failed = found->field;
  }
  return {std::nullopt, failed};
}

}  // namespace firstfix::ros
