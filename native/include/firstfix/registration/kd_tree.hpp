// A KD tree of points that are all there: for each of them, what lies within its k nearest.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "firstfix/portable/lanes.hpp"

namespace firstfix::detail {

class KdTree {
 public:
  static constexpr std::size_t kLeaf = 16;

  struct Node {
    float low[3], high[3];
    std::uint32_t begin, end;  // its points, in the tree's order
    std::uint32_t right;       // the second child; 0: a leaf. The first child is the next node.
  };

  // Points are x y z x y z, finite, fewer than 2^32.
  KdTree(const float* points, std::size_t count) : order_(count) {
    for (std::size_t i = 0; i < count; ++i) order_[i] = static_cast<std::uint32_t>(i);
    for (auto* axis : {&x_, &y_, &z_}) axis->resize(count + kFloatLanes);
    if (count == 0) return;
    nodes_.reserve(count / 4 + 1);
    build(points, 0, static_cast<std::uint32_t>(count));
    for (std::size_t i = 0; i < count; ++i) {
      const float* p = points + 3 * std::size_t{order_[i]};
      x_[i] = p[0], y_[i] = p[1], z_[i] = p[2];
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
  std::uint32_t build(const float* points, std::uint32_t begin, std::uint32_t end) {
    const auto number = static_cast<std::uint32_t>(nodes_.size());
    Node node{{}, {}, begin, end, 0};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      node.low[axis] = std::numeric_limits<float>::infinity();
      node.high[axis] = -node.low[axis];
    }
    for (std::uint32_t i = begin; i < end; ++i) {
      const float* p = points + 3 * std::size_t{order_[i]};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        node.low[axis] = std::min(node.low[axis], p[axis]);
        node.high[axis] = std::max(node.high[axis], p[axis]);
      }
    }
    nodes_.push_back(node);
    if (end - begin <= kLeaf) return number;
    std::size_t widest = 0;
    for (std::size_t axis = 1; axis < 3; ++axis) {
      if (node.high[axis] - node.low[axis] > node.high[widest] - node.low[widest]) widest = axis;
    }
    const std::uint32_t middle = begin + ((end - begin) / 2 + 15) / 16 * 16;  // full leaves
    std::nth_element(order_.begin() + begin, order_.begin() + middle, order_.begin() + end,
                     [points, widest](std::uint32_t a, std::uint32_t b) {
                       return points[3 * std::size_t{a} + widest] < points[3 * std::size_t{b} + widest];
                     });
    build(points, begin, middle);
    const std::uint32_t right = build(points, middle, end);
    nodes_[number].right = right;
    return number;
  }

  std::vector<Node> nodes_;
  std::vector<std::uint32_t> order_;
  std::vector<float> x_, y_, z_;
};

}  // namespace firstfix::detail
