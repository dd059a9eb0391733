// A mesh, sorted into a tree of boxes so that a ray meets few of its triangles.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include "firstfix/bit_exact/lanes.hpp"

namespace firstfix {

// A bounding volume hierarchy: every node has up to eight boxes, every leaf up to eight triangles.
class TriangleTree {
 public:
  static constexpr int kWidth = 8;
  static constexpr int kMostLevels = 128;  // of nodes, whatever the mesh
  static constexpr float kMostAway = 1e9F;  // metres, of any coordinate

  struct Node {
    float low[3][kWidth], high[3][kWidth];  // boxes of the children; an empty box where there is none
    std::int32_t child[kWidth];             // a node, or ~leaf
  };

  struct Leaf {
    float corner[3][3][kWidth];  // [corner][axis][triangle]; the last triangle fills up
    std::int32_t count;
  };

  // Vertices (v, 3) in metres, within kMostAway. `count` triangles (count, 3), one or more, of vertex numbers below v.
  TriangleTree(const float* vertices, const std::uint32_t* triangles, std::size_t count) {
    std::vector<Box> boxes(count);
    Box whole;
    for (std::size_t i = 0; i < count; ++i) {
      for (int k = 0; k < 3; ++k) boxes[i].take(vertices + 3 * static_cast<std::size_t>(triangles[3 * i + k]));
      whole.take(boxes[i]);
    }
    // Boxes are widened by more than a float of the mesh's size is rounded, so that no ray slips past one.
    float size = 0;
    for (int a = 0; a < 3; ++a) size = std::max({size, std::fabs(whole.low[a]), std::fabs(whole.high[a])});
    margin_ = 8 * std::numeric_limits<float>::epsilon() * size + 1e-6F;
    std::vector<std::uint32_t> order(count);
    for (std::size_t i = 0; i < count; ++i) order[i] = static_cast<std::uint32_t>(i);
    vertices_ = vertices;
    triangles_ = triangles;
    boxes_ = &boxes;
    order_ = &order;
    nodes_.reserve(count / 16 + 1);
    leaves_.reserve(count / 4 + 1);
    build({0, count, whole}, 0);
  }

  const std::vector<Node>& nodes() const { return nodes_; }
  const std::vector<Leaf>& leaves() const { return leaves_; }

 private:
  struct Box {
    std::array<float, 3> low{kFar, kFar, kFar}, high{-kFar, -kFar, -kFar};

    void take(const float* point) {
      for (int a = 0; a < 3; ++a) {
        low[a] = std::min(low[a], point[a]);
        high[a] = std::max(high[a], point[a]);
      }
    }
    void take(const Box& box) {
      take(box.low.data());
      take(box.high.data());
    }
    float half_area() const {
      const float x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
      return x < 0 ? 0 : x * y + y * z + z * x;
    }
    float twice_centre(int axis) const { return low[axis] + high[axis]; }
  };

  struct Part {
    std::size_t begin, end;
    Box box;

    std::size_t count() const { return end - begin; }
  };

  static constexpr float kFar = std::numeric_limits<float>::infinity();
  static constexpr int kBins = 16;
  static constexpr int kLevelsOfHalves = 34;  // as many take any number of triangles

  // Adds the node of a part and all below it. Returns its number.
  std::int32_t build(const Part& whole, int level) {
    const auto number = static_cast<std::int32_t>(nodes_.size());
    nodes_.emplace_back();
    Part parts[kWidth] = {whole};
    int count = 1;
    while (count < kWidth) {  // the part with the largest surface is split next
      int widest = -1;
      for (int i = 0; i < count; ++i) {
        if (parts[i].count() <= kWidth) continue;
        if (widest < 0 || parts[i].box.half_area() > parts[widest].box.half_area()) widest = i;
      }
      if (widest < 0) break;
      const auto halves = split(parts[widest], level < kMostLevels - kLevelsOfHalves);
      parts[widest] = halves.first;
      parts[count++] = halves.second;
    }
    for (int i = 0; i < kWidth; ++i) {
      for (int a = 0; a < 3; ++a) {
        nodes_[number].low[a][i] = i < count ? parts[i].box.low[a] - margin_ : kFar;
        nodes_[number].high[a][i] = i < count ? parts[i].box.high[a] + margin_ : kFar;
      }
      nodes_[number].child[i] = 0;
    }
    for (int i = 0; i < count; ++i) {
      const std::int32_t child = parts[i].count() <= kWidth ? ~leaf(parts[i]) : build(parts[i], level + 1);
      nodes_[number].child[i] = child;  // the vector may have moved meanwhile
    }
    return number;
  }

  std::int32_t leaf(const Part& part) {
    Leaf made;
    made.count = static_cast<std::int32_t>(part.count());
    for (int i = 0; i < kWidth; ++i) {
      const std::size_t row = (*order_)[std::min(part.begin + static_cast<std::size_t>(i), part.end - 1)];
      for (int corner = 0; corner < 3; ++corner) {
        const float* vertex = vertices_ + 3 * static_cast<std::size_t>(triangles_[3 * row + corner]);
        for (int a = 0; a < 3; ++a) made.corner[corner][a][i] = vertex[a];
      }
    }
    leaves_.push_back(made);
    return static_cast<std::int32_t>(leaves_.size()) - 1;
  }

  // Splits by the surface area heuristic over the longest axis of the centres. In the middle where all are in one place,
  // or so deep that the tree would get too many levels.
  std::pair<Part, Part> split(const Part& part, bool by_area) {
    auto& order = *order_;
    const auto& boxes = *boxes_;
    float low[3] = {kFar, kFar, kFar}, high[3] = {-kFar, -kFar, -kFar};
    for (std::size_t i = part.begin; i < part.end; ++i) {
      for (int a = 0; a < 3; ++a) {
        const float centre = boxes[order[i]].twice_centre(a);
        low[a] = std::min(low[a], centre);
        high[a] = std::max(high[a], centre);
      }
    }
    int axis = 0;
    for (int a = 1; a < 3; ++a) {
      if (high[a] - low[a] > high[axis] - low[axis]) axis = a;
    }
    const float width = high[axis] - low[axis], scale = kBins / width * 0.99999F;
    std::size_t middle = part.begin;
    if (by_area && width > 0 && std::isfinite(scale)) {
      const auto bin_of = [&](std::uint32_t row) {
        return std::min(static_cast<int>((boxes[row].twice_centre(axis) - low[axis]) * scale), kBins - 1);
      };
      Box box[kBins];
      std::size_t count[kBins] = {};
      for (std::size_t i = part.begin; i < part.end; ++i) {
        const int bin = bin_of(order[i]);
        box[bin].take(boxes[order[i]]);
        ++count[bin];
      }
      const int cut = cheapest_cut(box, count);
      middle = static_cast<std::size_t>(std::partition(order.begin() + static_cast<std::ptrdiff_t>(part.begin),
                                                       order.begin() + static_cast<std::ptrdiff_t>(part.end),
                                                       [&](std::uint32_t row) { return bin_of(row) < cut; }) -
                                        order.begin());
    }
    if (middle == part.begin || middle == part.end) middle = part.begin + part.count() / 2;
    return {part_of(part.begin, middle), part_of(middle, part.end)};
  }

  // The first bin of the right side.
  static int cheapest_cut(const Box (&box)[kBins], const std::size_t (&count)[kBins]) {
    float right_cost[kBins] = {};
    Box side;
    std::size_t number = 0;
    for (int i = kBins - 1; i > 0; --i) {
      side.take(box[i]);
      number += count[i];
      right_cost[i] = side.half_area() * static_cast<float>(number);
    }
    side = Box();
    number = 0;
    int best = kBins / 2;
    float least = kFar;
    for (int i = 1; i < kBins; ++i) {
      side.take(box[i - 1]);
      number += count[i - 1];
      const float cost = side.half_area() * static_cast<float>(number) + right_cost[i];
      if (cost < least) {
        least = cost;
        best = i;
      }
    }
    return best;
  }

  Part part_of(std::size_t begin, std::size_t end) const {
    Part part{begin, end, {}};
    for (std::size_t i = begin; i < end; ++i) part.box.take((*boxes_)[(*order_)[i]]);
    return part;
  }

  std::vector<Node> nodes_;
  std::vector<Leaf> leaves_;
  float margin_ = 0;
  // of the construction only
  const float* vertices_ = nullptr;
  const std::uint32_t* triangles_ = nullptr;
  const std::vector<Box>* boxes_ = nullptr;
  std::vector<std::uint32_t>* order_ = nullptr;
};

// Goes through a tree in no order that means anything. open(node) says which children to go on with, one bit each;
// visit(leaf) says whether to go on at all.
template <typename Open, typename Visit>
void walk(const TriangleTree& tree, const Open& open, const Visit& visit) {
  std::int32_t stack[TriangleTree::kWidth * TriangleTree::kMostLevels];
  int depth = 0;
  stack[depth++] = 0;
  while (depth) {
    const std::int32_t at = stack[--depth];
    if (at < 0) {
      if (!visit(tree.leaves()[static_cast<std::size_t>(~at)])) return;
      continue;
    }
    const TriangleTree::Node& node = tree.nodes()[static_cast<std::size_t>(at)];
    for (std::uint32_t met = open(node); met; met &= met - 1) stack[depth++] = node.child[__builtin_ctz(met)];
  }
}

}  // namespace firstfix
