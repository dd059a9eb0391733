// Memory for the numbers that each scan needs anew while it is reduced.
#pragma once

#include <cstddef>
#include <memory>

namespace firstfix::detail {

// A program that gives its large blocks back after each scan gets them from the system again page by page, which takes a robot
// longer than what it does with them.
template <class T>
class KeptMemory {
 public:
  // Room for `count` of them, with any values: also for those that it gave before.
  T* of(std::size_t count) {
    if (count > size_) {
      values_.reset();
      values_.reset(new T[count]);
      size_ = count;
    }
    return values_.get();
  }

  const T* values() const { return values_.get(); }

 private:
  std::unique_ptr<T[]> values_;
  std::size_t size_ = 0;
};

}  // namespace firstfix::detail
