// When a query must be answered, and whether anybody still waits for its answer.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <limits>
#include <optional>

#include "firstfix/errors.hpp"

namespace firstfix {

// Whether a query is cancelled: a word, which another thread or another process may write, holds its number. Queries that come one
// after the other share a word: a late cancellation ends none of them but its own.
class Cancellation {
 public:
  using Word = std::atomic<std::uint64_t>;
  static_assert(Word::is_always_lock_free && sizeof(Word) == sizeof(std::uint64_t), "processes share a word");

  Cancellation() = default;  // never

  // word: must outlive the query.
  Cancellation(const Word& word, std::uint64_t number) : word_(&word), number_(number) {}

  bool is_requested() const { return word_ != nullptr && word_->load(std::memory_order_relaxed) == number_; }

 private:
  const Word* word_ = nullptr;
  std::uint64_t number_ = 0;
};

// A step of a search that would end later does not begin. A query that is cancelled ends without an answer.
class Deadline {
 public:
  using Clock = std::chrono::steady_clock;

  Deadline() = default;  // none

  // So many seconds after a time; infinite: none.
  static Deadline after_s(double seconds, Clock::time_point began = Clock::now()) {
    constexpr double kFarS = 1e8;
    Deadline made;
    const std::chrono::duration<double> after(std::max(seconds, -kFarS));
    if (seconds < kFarS) made.at_ = began + std::chrono::duration_cast<Clock::duration>(after);
    return made;
  }

  // The same time, of a query that may be cancelled.
  Deadline unless(const Cancellation& cancellation) const {
    Deadline made = *this;
    made.cancellation_ = cancellation;
    return made;
  }

  // Throws Error "query_cancelled" if the query is cancelled.
  double left_s() const {
    check_wanted();
    if (!at_) return std::numeric_limits<double>::infinity();
    return std::chrono::duration<double>(*at_ - Clock::now()).count();
  }

  // Throws as left_s. It is quick: a search asks before each pose that it aligns.
  void check_wanted() const {
    if (cancellation_.is_requested()) throw Error("query_cancelled", "nobody waits for the answer any more");
  }

 private:
  std::optional<Clock::time_point> at_;
  Cancellation cancellation_;
};

}  // namespace firstfix
