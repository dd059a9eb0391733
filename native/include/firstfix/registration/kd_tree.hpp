// A KD tree of points that are all there: for each of them, what lies within its k nearest.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/bit_exact/vectors.hpp"

namespace firstfix::detail {

class KdTree {
 public:
  static constexpr std::uint32_t kLeaf = 16;

  struct Node {
    float low[3], high[3];
    std::uint32_t begin, end;  // its points, in the tree's order
    std::uint32_t right;       // the second child; 0: a leaf. The first child is the next node.
  };

  // Points are finite, fewer than 2^32.
  explicit KdTree(Vectors<const float> points) : order_(points.size) {
    const std::size_t count = points.size;
    for (auto* axis : {&x_, &y_, &z_}) axis->resize(count + kFloatLanes);
    if (count == 0) return;
    std::vector<Item> items(count);
    for (std::size_t i = 0; i < count; ++i) {
      const float* p = points[i];
      items[i] = {{p[0], p[1], p[2]}, static_cast<std::uint32_t>(i)};
    }
    nodes_.reserve(count / 4 + 1);
    build(items.data(), 0, static_cast<std::uint32_t>(count));
    for (std::size_t i = 0; i < count; ++i) {
      const Item& item = items[i];
      x_[i] = item.at[0], y_[i] = item.at[1], z_[i] = item.at[2];
      order_[i] = item.row;
    }
  }

  // Coordinates in the tree's order, with room to load lanes from any of them.
  const float* x() const { return x_.data(); }
  const float* y() const { return y_.data(); }
  const float* z() const { return z_.data(); }
  // Row of each point among those given.
  const std::vector<std::uint32_t>& order() const { return order_; }
  const std::vector<Node>& nodes() const { return nodes_; }

 private:
  struct Item {
    float at[3];
    std::uint32_t row;
  };

  std::uint32_t build(Item* items, std::uint32_t begin, std::uint32_t end) {
    const auto number = static_cast<std::uint32_t>(nodes_.size());
    Node node{{}, {}, begin, end, 0};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      node.low[axis] = std::numeric_limits<float>::infinity();
      node.high[axis] = -node.low[axis];
    }
    for (std::uint32_t i = begin; i < end; ++i) {
      for (std::size_t axis = 0; axis < 3; ++axis) {
        node.low[axis] = std::min(node.low[axis], items[i].at[axis]);
        node.high[axis] = std::max(node.high[axis], items[i].at[axis]);
      }
    }
    nodes_.push_back(node);
    if (end - begin <= kLeaf) return number;
    std::size_t widest = 0;
    for (std::size_t axis = 1; axis < 3; ++axis) {
      if (node.high[axis] - node.low[axis] > node.high[widest] - node.low[widest]) widest = axis;
    }
    const std::uint32_t middle = begin + ((end - begin) / 2 + kLeaf - 1) / kLeaf * kLeaf;  // full leaves
    std::nth_element(items + begin, items + middle, items + end,
                     [widest](const Item& a, const Item& b) { return a.at[widest] < b.at[widest]; });
    build(items, begin, middle);
    const std::uint32_t right = build(items, middle, end);
    nodes_[number].right = right;
    return number;
  }

  std::vector<Node> nodes_;
  std::vector<std::uint32_t> order_;
  std::vector<float> x_, y_, z_;
};

}  // namespace firstfix::detail
