// Time that the stages of a query take.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace firstfix {

// Seconds by stage, in the order in which the stages began.
class StageTimes {
 public:
  using Seconds = std::vector<std::pair<std::string, double>>;

  const Seconds& seconds() const { return seconds_; }

  // Adds the time of some work to a stage. Returns what the work returns.
  template <class Work>
  auto of(const char* stage, Work&& work) {
    const Added added(*this, stage);
    return work();
  }

 private:
  using Clock = std::chrono::steady_clock;

  class Added {
   public:
    Added(StageTimes& times, const char* stage) : times_(times), at_(times.place_of(stage)) {}
    Added(const Added&) = delete;
    Added& operator=(const Added&) = delete;
    ~Added() { times_.seconds_[at_].second += std::chrono::duration<double>(Clock::now() - began_).count(); }

   private:
    StageTimes& times_;
    std::size_t at_;
    Clock::time_point began_ = Clock::now();
  };

  std::size_t place_of(const char* stage) {
    const auto known = std::find_if(seconds_.begin(), seconds_.end(), [&](const auto& one) { return one.first == stage; });
    if (known != seconds_.end()) return static_cast<std::size_t>(known - seconds_.begin());
    seconds_.emplace_back(stage, 0.0);
    return seconds_.size() - 1;
  }

  Seconds seconds_;
};

}  // namespace firstfix
