// Points in the order of a KD tree, sixteen a leaf, and boxes around them: for each point, where its nearest ones are.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/bit_exact/vectors.hpp"
#include "firstfix/registration/select_item.hpp"

namespace firstfix::detail {

// An axis-aligned box.
struct Box {
  float low[3], high[3];

  Box() {
    std::fill_n(low, 3, std::numeric_limits<float>::infinity());
    std::fill_n(high, 3, -std::numeric_limits<float>::infinity());
  }

  void add(std::size_t axis, float from, float to) {
    low[axis] = std::min(low[axis], from);
    high[axis] = std::max(high[axis], to);
  }
};

// Boxes in a row, compared with another one eight at a time. The row is filled up with empty boxes, which are infinitely
// far from all others.
class BoxRow {
 public:
  static constexpr std::size_t kInStep = 8;

  explicit BoxRow(std::size_t count) : count_(count) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low_[axis].assign((count + kInStep - 1) / kInStep * kInStep, Box().low[axis]);
      high_[axis].assign(low_[axis].size(), Box().high[axis]);
    }
  }

  std::size_t size() const { return count_; }

  void add(std::size_t box, std::size_t axis, float from, float to) {
    low_[axis][box] = std::min(low_[axis][box], from);
    high_[axis][box] = std::max(high_[axis][box], to);
  }

  // The squared gaps between a box and eight of the row. No point of one is nearer to a point of the other.
  F8 gaps2(const Box& from, std::size_t first) const {
    F8 sum = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const F8 above = F8::at(&low_[axis][first]) - F8(from.high[axis]);
      const F8 below = F8(from.low[axis]) - F8::at(&high_[axis][first]);
      const F8 gap = most(most(above, below), F8(0));
      sum = sum + gap * gap;
    }
    return sum;
  }

  // The row of boxes around each eight of this one.
  BoxRow around() const {
    BoxRow outer((count_ + kInStep - 1) / kInStep);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      for (std::size_t i = 0; i < count_; ++i) outer.add(i / kInStep, axis, low_[axis][i], high_[axis][i]);
    }
    return outer;
  }

 private:
  std::size_t count_;
  std::vector<float> low_[3], high_[3];
};

class KdTree {
 public:
  static constexpr std::uint32_t kLeaf = 16;  // all leaves are full but the last

  // Points are finite, fewer than 2^32.
  explicit KdTree(Vectors<const float> points) : order_(points.size) {
    const std::size_t count = points.size;
    const std::size_t padded = (count + kLeaf - 1) / kLeaf * kLeaf;
    for (auto& axis : at_) axis.assign(padded, std::numeric_limits<float>::infinity());
    if (count == 0) return;
    std::vector<Item> items(count);
    for (std::size_t i = 0; i < count; ++i) {
      const float* p = points[i];
      items[i] = {{p[0], p[1], p[2]}, static_cast<std::uint32_t>(i)};
    }
    sort(items.data(), items.data() + count);
    BoxRow leaves(padded / kLeaf);
    for (std::size_t i = 0; i < count; ++i) {
      const Item& item = items[i];
      for (std::size_t axis = 0; axis < 3; ++axis) {
        at_[axis][i] = item.at[axis];
        leaves.add(i / kLeaf, axis, item.at[axis], item.at[axis]);
      }
      order_[i] = item.row;
    }
    boxes_.push_back(std::move(leaves));
    while (boxes_.back().size() > BoxRow::kInStep) boxes_.push_back(boxes_.back().around());
  }

  std::size_t size() const { return order_.size(); }
  // Coordinates along an axis in the tree's order. The last leaf is filled up with infinities.
  const float* at(std::size_t axis) const { return at_[axis].data(); }
  // Row of each point among those given.
  const std::vector<std::uint32_t>& order() const { return order_; }
  // Boxes of the leaves, then those around each eight of the row before. The last row has at most eight.
  const std::vector<BoxRow>& boxes() const { return boxes_; }

 private:
  struct Item {
    float at[3];
    std::uint32_t row;
  };

  // The axis along which items are furthest apart; of equal ones the first. All numbers of an item are compared at once, its
  // row too, which tells nothing. Two items in turns: a comparison then does not wait for the one before.
  static std::size_t widest_axis(const Item* begin, const Item* end) {
    typedef float Numbers __attribute__((vector_size(sizeof(Item))));
    Numbers low[2], high[2];
    for (Numbers* each : {&low[0], &low[1], &high[0], &high[1]}) std::memcpy(each, begin, sizeof *each);
    const auto take = [&](const Item* item, std::size_t turn) {
      Numbers here;
      std::memcpy(&here, item, sizeof here);
      low[turn] = here < low[turn] ? here : low[turn];
      high[turn] = here > high[turn] ? here : high[turn];
    };
    for (; end - begin >= 2; begin += 2) take(begin, 0), take(begin + 1, 1);
    if (begin != end) take(begin, 0);
    std::size_t widest = 0;
    float widths[3];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      widths[axis] = std::max(high[0][axis], high[1][axis]) - std::min(low[0][axis], low[1][axis]);
      if (widths[axis] > widths[widest]) widest = axis;
    }
    return widest;
  }

  static void sort(Item* begin, Item* end) {
    while (end - begin > kLeaf) {
      const std::size_t widest = widest_axis(begin, end);
      Item* middle = begin + ((end - begin) / 2 + kLeaf - 1) / kLeaf * kLeaf;
      select_item(begin, middle, end, [widest](const Item& item) { return item.at[widest]; });
      sort(begin, middle);
      begin = middle;
    }
  }

  std::vector<BoxRow> boxes_;
  std::vector<std::uint32_t> order_;
  std::vector<float> at_[3];
};

}  // namespace firstfix::detail
