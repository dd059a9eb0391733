// Normals of a surface from each point's neighbours: the axis along which they spread least.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/registration/kd_tree.hpp"

namespace firstfix {

namespace detail {

// Sums over the neighbours of some points: their number, offsets and products of offsets.
struct Neighbourhoods {
  FloatLanes sum[10];  // 1, x, y, z, xx, xy, xz, yy, yz, zz
};

constexpr float kGrazing = 0.1F;  // sine: a surface at a lower angle may be seen from either side

// Neighbourhoods of points of one leaf, some lanes of them at once. The neighbours of a point are its ten nearest,
// itself among them, and all others that are no further. Where sides matter, a point counts as kOtherSide times as far
// away if it faces away from the viewer of the other. Sums go in the order of the tree, so they depend neither on the
// way to a leaf nor on the number of lanes.
template <bool kSidesMatter>
class NeighbourSearch {
 public:
  // to_viewer, facing: (count, 3) of the tree's points, in their own order; not read where sides do not matter. facing:
  // where to each point is turned, 0 if unknown.
  NeighbourSearch(const KdTree& tree, const float* to_viewer, const float* facing) : tree_(tree) {
    if constexpr (kSidesMatter) {
      const std::vector<std::uint32_t>& order = tree.order();
      for (std::size_t axis = 0; axis < 3; ++axis) {
        for (std::vector<float>* along : {&eye_[axis], &facing_[axis]}) along->resize(order.size() + kFloatLanes);
        for (std::size_t i = 0; i < order.size(); ++i) {
          eye_[axis][i] = to_viewer[3 * order[i] + axis];
          facing_[axis][i] = facing[3 * order[i] + axis];
        }
      }
    }
  }

  // Of the points from `first` on, up to `end`, which is that of their leaf.
  Neighbourhoods around(std::uint32_t first, std::uint32_t end) {
    const std::size_t used = std::min<std::size_t>(kFloatLanes, end - first);
    x_ = load_lanes(tree_.x() + first), y_ = load_lanes(tree_.y() + first), z_ = load_lanes(tree_.z() + first);
    if constexpr (kSidesMatter) {
      for (std::size_t axis = 0; axis < 3; ++axis) here_[axis] = load_lanes(&eye_[axis][first]);
      behind_ = -kGrazing * root_lanes(here_[0] * here_[0] + here_[1] * here_[1] + here_[2] * here_[2]);
    }
    bound(first, used);
    find_leaves(first, used);
    return sums();
  }

 private:
  static constexpr std::size_t kNearest = 10;
  static constexpr float kOtherSide = 4.0F;
  using Node = KdTree::Node;

  FloatLanes away2(std::uint32_t i) const {
    const FloatLanes dx = x_ - tree_.x()[i], dy = y_ - tree_.y()[i], dz = z_ - tree_.z()[i];
    return from_side(i, dx * dx + dy * dy + dz * dz);
  }

  // The squared distance of a point as it counts.
  FloatLanes from_side([[maybe_unused]] std::uint32_t i, const FloatLanes& away2) const {
    if constexpr (kSidesMatter) {
      const FloatLanes along = here_[0] * facing_[0][i] + here_[1] * facing_[1][i] + here_[2] * facing_[2][i];
      return along < behind_ ? kOtherSide * kOtherSide * away2 : away2;
    } else {
      return away2;
    }
  }

  // Box of the queries.
  void bound(std::uint32_t first, std::size_t used) {
    const float* coordinates[3] = {tree_.x() + first, tree_.y() + first, tree_.z() + first};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto [low, high] = std::minmax_element(coordinates[axis], coordinates[axis] + used);
      low_[axis] = *low, high_[axis] = *high;
    }
  }

  // No point of the node is nearer to a query than this.
  float gap2(const Node& node) const {
    float sum = 0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float gap = std::max(std::max(node.low[axis] - high_[axis], low_[axis] - node.high[axis]), 0.0F);
      sum += gap * gap;
    }
    return sum;
  }

  // Distances of the ten nearest, and the leaves where they may be.
  void find_leaves(std::uint32_t first, std::size_t used) {
    const std::vector<Node>& nodes = tree_.nodes();
    FloatLanes best[kNearest];  // ascending
    std::fill_n(best, kNearest, all_lanes(std::numeric_limits<float>::max()));
    leaves_.clear();
    stack_.assign(1, {0, 0});
    float worst2 = std::numeric_limits<float>::infinity();
    while (!stack_.empty()) {
      auto [gap, number] = stack_.back();
      stack_.pop_back();
      if (gap > worst2) continue;
      while (nodes[number].right != 0) {
        const std::uint32_t left = number + 1, right = nodes[number].right;
        const float to_left = gap2(nodes[left]), to_right = gap2(nodes[right]);
        const bool right_first = to_right < to_left || (to_right == to_left && first >= nodes[right].begin);
        const Found later = right_first ? Found{to_left, left} : Found{to_right, right};
        if (later.gap2 <= worst2) stack_.push_back(later);
        number = right_first ? right : left;
        gap = right_first ? to_right : to_left;
      }
      if (gap > worst2) continue;
      leaves_.push_back({gap, number});
      for (std::uint32_t i = nodes[number].begin; i < nodes[number].end; ++i) {
        FloatLanes away = away2(i);
        if (!any_lane(away < best[kNearest - 1])) continue;
        for (FloatLanes& here : best) {
          const IntLanes nearer = away < here;
          const FloatLanes least = nearer ? away : here;
          away = nearer ? here : away;
          here = least;
        }
      }
      float furthest[kFloatLanes];
      store_lanes(furthest, best[kNearest - 1]);
      worst2 = *std::max_element(furthest, furthest + used);
    }
    reach2_ = best[kNearest - 1];
    worst2_ = worst2;
  }

  Neighbourhoods sums() {
    const std::vector<Node>& nodes = tree_.nodes();
    std::sort(leaves_.begin(), leaves_.end(), [](const Found& a, const Found& b) { return a.node < b.node; });
    Neighbourhoods made{};
    const FloatLanes one = all_lanes(1), zero{};
    for (const Found& leaf : leaves_) {
      if (leaf.gap2 > worst2_) continue;
      for (std::uint32_t i = nodes[leaf.node].begin; i < nodes[leaf.node].end; ++i) {
        FloatLanes dx = tree_.x()[i] - x_, dy = tree_.y()[i] - y_, dz = tree_.z()[i] - z_;
        const IntLanes inside = from_side(i, dx * dx + dy * dy + dz * dz) <= reach2_;
        dx = inside ? dx : zero;
        dy = inside ? dy : zero;
        dz = inside ? dz : zero;
        FloatLanes* sum = made.sum;
        sum[0] += inside ? one : zero;
        sum[1] += dx;
        sum[2] += dy;
        sum[3] += dz;
        sum[4] += dx * dx;
        sum[5] += dx * dy;
        sum[6] += dx * dz;
        sum[7] += dy * dy;
        sum[8] += dy * dz;
        sum[9] += dz * dz;
      }
    }
    return made;
  }

  struct Found {
    float gap2;
    std::uint32_t node;
  };

  const KdTree& tree_;
  std::vector<float> eye_[3], facing_[3];  // in the tree's order, with room to load lanes from any of them
  FloatLanes x_{}, y_{}, z_{}, here_[3]{}, behind_{}, reach2_{};
  float low_[3]{}, high_[3]{}, worst2_ = 0;
  std::vector<Found> leaves_, stack_;
};

// One rotation of Jacobi's method in the plane of p and q, in every lane; r is the third axis. vp and vq are the axes.
inline void rotate_plane(FloatLanes& pp, FloatLanes& qq, FloatLanes& pq, FloatLanes& pr, FloatLanes& qr, FloatLanes* vp,
                         FloatLanes* vq) {
  const FloatLanes gap = qq - pp, least = all_lanes(1e-30F);
  const FloatLanes below = greater_lanes(gap, -gap) + root_lanes(gap * gap + 4.0F * (pq * pq));
  const FloatLanes tangent = (gap < 0.0F ? all_lanes(-2) : all_lanes(2)) * pq / greater_lanes(below, least);
  const FloatLanes cosine = 1.0F / root_lanes(tangent * tangent + 1.0F), sine = tangent * cosine;
  pp -= tangent * pq;
  qq += tangent * pq;
  pq = FloatLanes{};
  const auto rotate = [cosine, sine](FloatLanes& a, FloatLanes& b) {
    const FloatLanes before = a;
    a = cosine * before - sine * b;
    b = sine * before + cosine * b;
  };
  rotate(pr, qr);
  for (std::size_t k = 0; k < 3; ++k) rotate(vp[k], vq[k]);
}

// The unit axes (3) along which neighbourhoods spread least.
inline void least_axes(const Neighbourhoods& of, FloatLanes* axes) {
  const FloatLanes* s = of.sum;
  const FloatLanes one = all_lanes(1), share = 1.0F / greater_lanes(s[0], one);
  FloatLanes xx = s[4] - s[1] * s[1] * share, xy = s[5] - s[1] * s[2] * share, xz = s[6] - s[1] * s[3] * share;
  FloatLanes yy = s[7] - s[2] * s[2] * share, yz = s[8] - s[2] * s[3] * share, zz = s[9] - s[3] * s[3] * share;
  const FloatLanes scale = 1.0F / greater_lanes(greater_lanes(xx, greater_lanes(yy, zz)), all_lanes(1e-30F));
  for (FloatLanes* element : {&xx, &xy, &xz, &yy, &yz, &zz}) *element *= scale;
  FloatLanes vx[3] = {one, {}, {}}, vy[3] = {{}, one, {}}, vz[3] = {{}, {}, one};
  constexpr int kSweeps = 4;
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    rotate_plane(xx, yy, xy, xz, yz, vx, vy);
    rotate_plane(xx, zz, xz, xy, yz, vx, vz);
    rotate_plane(yy, zz, yz, xy, xz, vy, vz);
  }
  const FloatLanes least = lesser_lanes(yy, zz);  // of equal ones, the first: points of a level line are on a wall
  for (std::size_t k = 0; k < 3; ++k) axes[k] = xx <= least ? vx[k] : (yy <= zz ? vy[k] : vz[k]);
}

}  // namespace detail

namespace detail {

// As surface_normals. facing: see NeighbourSearch.
template <bool kSidesMatter>
void normals_around(const KdTree& tree, const float* to_viewer, const float* facing, float* normals, std::uint8_t* oriented) {
  NeighbourSearch<kSidesMatter> search(tree, to_viewer, facing);
  for (const KdTree::Node& leaf : tree.nodes()) {
    if (leaf.right != 0) continue;
    for (std::uint32_t first = leaf.begin; first < leaf.end; first += kFloatLanes) {
      const Neighbourhoods found = search.around(first, leaf.end);
      FloatLanes least[3];
      least_axes(found, least);
      float axes[3][kFloatLanes];
      for (std::size_t k = 0; k < 3; ++k) store_lanes(axes[k], least[k]);
      for (std::size_t lane = 0; lane < kFloatLanes && first + lane < leaf.end; ++lane) {
        const std::size_t row = tree.order()[first + lane];
        const float* eye = to_viewer == nullptr ? nullptr : to_viewer + 3 * row;
        float along = 0, length2 = 0;
        for (std::size_t k = 0; eye != nullptr && k < 3; ++k) {
          along += axes[k][lane] * eye[k];
          length2 += eye[k] * eye[k];
        }
        for (std::size_t k = 0; k < 3; ++k) normals[3 * row + k] = along < 0 ? -axes[k][lane] : axes[k][lane];
        oriented[row] = std::fabs(along) > kGrazing * std::sqrt(length2) ? 1 : 0;
      }
    }
  }
}

}  // namespace detail

// Unit normals of points, (count, 3) each. Points are finite and at most 1e15 m from the origin.
//
// `to_viewer` holds (count, 3) directions of any length, 0 if unknown, or is null. Where it is known, the normal is the
// one on the viewer's side. `oriented` tells whether that is sure.
//
// `two_faces`: the points lie on both faces of walls and slabs. Those on the other face then count as further away, so that
// few points on one face do not take their normals from the other. Which face a point is on, its direction to the viewer
// tells first, and then its normal, which tells it at low angles too. Each pass mends normals beside those it has mended.
inline void surface_normals(Vectors<const float> points, const float* to_viewer, bool two_faces, float* normals,
                            std::uint8_t* oriented) {
  const detail::KdTree tree(points);
  if (!two_faces || to_viewer == nullptr) return detail::normals_around<false>(tree, to_viewer, nullptr, normals, oriented);
  constexpr int kPasses = 3;
  std::vector<float> facing(to_viewer, to_viewer + 3 * points.size);
  for (int pass = 0; pass < kPasses; ++pass) {
    detail::normals_around<true>(tree, to_viewer, facing.data(), normals, oriented);
    for (std::size_t i = 0; i < facing.size(); ++i) facing[i] = oriented[i / 3] != 0 ? normals[i] : 0.0F;
  }
}

}  // namespace firstfix
