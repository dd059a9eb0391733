// Normals of a surface from each point's neighbours: the axis along which they spread least.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

#include "firstfix/bit_exact/lanes.hpp"
#include "firstfix/registration/kd_tree.hpp"

namespace firstfix {

namespace detail {

// Sums over the neighbours of some points: their number, offsets and products of offsets.
constexpr std::size_t kSums = 10;  // 1, x, y, z, xx, xy, xz, yy, yz, zz
struct Neighbourhoods {
  FloatLanes sum[kSums];
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
        for (std::vector<float>* along : {&eye_[axis], &facing_[axis]}) along->resize(order.size() + KdTree::kLeaf);
        for (std::size_t i = 0; i < order.size(); ++i) {
          eye_[axis][i] = to_viewer[3 * order[i] + axis];
          facing_[axis][i] = facing[3 * order[i] + axis];
        }
      }
    }
  }

  // Of the points from `first` on, up to the end of their leaf.
  Neighbourhoods around(std::size_t first) {
    own_ = first / KdTree::kLeaf;
    const std::size_t used = std::min(kFloatLanes, tree_.size() - first);
    box_ = Box();
    for (std::size_t axis = 0; axis < 3; ++axis) {
      here_[axis] = load_lanes(tree_.at(axis) + first);
      for (std::size_t i = 0; i < used; ++i) box_.add(axis, tree_.at(axis)[first + i], tree_.at(axis)[first + i]);
    }
    if constexpr (kSidesMatter) {
      for (std::size_t axis = 0; axis < 3; ++axis) viewer_[axis] = load_lanes(&eye_[axis][first]);
      behind_ = -kGrazing * root_lanes(viewer_[0] * viewer_[0] + viewer_[1] * viewer_[1] + viewer_[2] * viewer_[2]);
    }
    float farthest2[kFloatLanes] = {};  // nothing is nearer to a lane without a point
    std::fill_n(farthest2, used, std::numeric_limits<float>::max());
    for (FloatLanes& lanes : nearest2_) lanes = load_lanes(farthest2);
    FloatLanes own[KdTree::kLeaf];
    find_distances(own_, own);
    for (const FloatLanes& away2 : own) insert(away2);
    worst2_ = most_of_lanes(nearest2_[kNearest - 1]);
    leaves_.clear();
    compared_ = 0;
    find_leaves(tree_.boxes().size() - 1, 0);
    compare();
    return sums();
  }

 private:
  static constexpr std::size_t kNearest = 10;
  static constexpr float kOtherSide = 4.0F;
  static constexpr std::size_t kTogether = 64 / KdTree::kLeaf;  // leaves whose points have a bit each in one word

  // Squared distances of the points of a leaf from each of the lanes' points, as they count.
  void find_distances(std::size_t leaf, FloatLanes* away2_of) const {
    const std::size_t begin = leaf * KdTree::kLeaf;
    const float *x = tree_.at(0) + begin, *y = tree_.at(1) + begin, *z = tree_.at(2) + begin;
    const FloatLanes here[3] = {here_[0], here_[1], here_[2]};
    for (std::size_t i = 0; i < KdTree::kLeaf; ++i) {
      const FloatLanes dx = here[0] - x[i], dy = here[1] - y[i], dz = here[2] - z[i];
      FloatLanes away2 = dx * dx + dy * dy + dz * dz;
      if constexpr (kSidesMatter) {
        const FloatLanes along = viewer_[0] * facing_[0][begin + i] + viewer_[1] * facing_[1][begin + i] +
                                 viewer_[2] * facing_[2][begin + i];
        away2 = along < behind_ ? kOtherSide * kOtherSide * away2 : away2;
      }
      away2_of[i] = away2;
    }
  }

  // One bit for each of a leaf's points that is near enough for some lane.
  template <class Near>
  static std::uint32_t points_that_are(const FloatLanes* away2_of, Near near) {
    IntLanes found{}, bit = IntLanes{} + 1;
    for (std::size_t i = 0; i < KdTree::kLeaf; ++i, bit += bit) found |= near(away2_of[i]) & bit;
    return all_bits(found);
  }

  // Puts a distance among the ten nearest of each lane where it is one.
  void insert(FloatLanes away2) {
    for (FloatLanes& here : nearest2_) {
      const IntLanes is_nearer = away2 < here;
      const FloatLanes least = is_nearer ? away2 : here;
      away2 = is_nearer ? here : away2;
      here = least;
    }
  }

  // Finds the leaves, within eight boxes of a row, where one of the ten nearest may be: in the order of the tree.
  void find_leaves(std::size_t row, std::size_t first) {
    std::uint32_t left = bits_of(tree_.boxes()[row].gaps2(box_, first) <= F8(worst2_));
    for (; left != 0; left &= left - 1) {
      const std::size_t number = first + static_cast<std::size_t>(__builtin_ctz(left));
      if (row > 0) {
        find_leaves(row - 1, number * BoxRow::kInStep);
      } else {
        leaves_.push_back(number);
        if (leaves_.size() == compared_ + kTogether) compare();
      }
    }
  }

  // Compares the points of the leaves found since the last call with the ten nearest so far.
  void compare() {
    if (away2_.size() < leaves_.size() * KdTree::kLeaf) away2_.resize((leaves_.size() + kTogether) * KdTree::kLeaf);
    FloatLanes* away2 = away2_.data() + compared_ * KdTree::kLeaf;
    const FloatLanes bound = nearest2_[kNearest - 1];
    std::uint64_t left = 0;
    for (std::size_t k = 0; compared_ < leaves_.size(); ++k, ++compared_) {
      FloatLanes* of_leaf = away2 + k * KdTree::kLeaf;
      find_distances(leaves_[compared_], of_leaf);
      const std::uint64_t nearer = points_that_are(of_leaf, [bound](FloatLanes each) { return each < bound; });
      left |= (leaves_[compared_] == own_ ? 0 : nearer) << (k * KdTree::kLeaf);
    }
    for (; left != 0; left &= left - 1) insert(away2[__builtin_ctzll(left)]);
    worst2_ = most_of_lanes(nearest2_[kNearest - 1]);
  }

  Neighbourhoods sums() const {
    Neighbourhoods made{};
    const FloatLanes one = all_lanes(1), zero{}, reach2 = nearest2_[kNearest - 1];
    for (std::size_t first = 0; first < leaves_.size(); first += kTogether) {
      const FloatLanes* away2 = away2_.data() + first * KdTree::kLeaf;
      std::uint64_t left = 0;
      for (std::size_t k = 0; k < std::min(kTogether, leaves_.size() - first); ++k) {
        left |= static_cast<std::uint64_t>(points_that_are(away2 + k * KdTree::kLeaf,
                                                           [reach2](FloatLanes each) { return each <= reach2; }))
                << (k * KdTree::kLeaf);
      }
      for (; left != 0; left &= left - 1) {
        const auto bit = static_cast<std::size_t>(__builtin_ctzll(left));
        const std::size_t i = leaves_[first + bit / KdTree::kLeaf] * KdTree::kLeaf + bit % KdTree::kLeaf;
        const IntLanes inside = away2[bit] <= reach2;
        const FloatLanes dx = inside ? tree_.at(0)[i] - here_[0] : zero, dy = inside ? tree_.at(1)[i] - here_[1] : zero,
                         dz = inside ? tree_.at(2)[i] - here_[2] : zero;
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

  const KdTree& tree_;
  std::vector<float> eye_[3], facing_[3];  // in the tree's order, with room to load lanes from any of them
  FloatLanes here_[3]{}, viewer_[3]{}, behind_{};
  FloatLanes nearest2_[kNearest]{};  // squared distances of the ten nearest, ascending
  Box box_;                          // of the lanes' points
  float worst2_ = 0;                 // the largest of all lanes' tenth
  std::size_t own_ = 0;              // the lanes' leaf
  std::vector<std::size_t> leaves_;  // where one of the ten nearest may be
  std::vector<FloatLanes> away2_;    // distances of the leaves' points
  std::size_t compared_ = 0;         // leaves
};

// The elements besides the diagonal of a matrix whose largest is about 1, without those that are as good as 0. Products of
// these would be subnormal numbers, for which a processor takes some hundred cycles each.
inline F16 without_least(const F16& elements) {
  return choose(most(elements, F16(0) - elements) < F16(1e-18F), F16(0), elements);
}

// One rotation of Jacobi's method in the plane of p and q, in every lane; r is the third axis. vp and vq are the axes.
// Inlined, so that its matrices stay in registers.
__attribute__((always_inline)) inline void rotate_plane(F16& pp, F16& qq, F16& pq, F16& pr, F16& qr, F16* vp, F16* vq) {
  pq = without_least(pq);
  const F16 gap = qq - pp;
  const F16 below = most(gap, F16(0) - gap) + root(gap * gap + F16(4) * (pq * pq));
  const F16 tangent = choose(gap < F16(0), F16(-2), F16(2)) * pq / most(below, F16(1e-30F));
  const F16 cosine = F16(1) / root(tangent * tangent + F16(1)), sine = tangent * cosine;
  pp = pp - tangent * pq;
  qq = qq + tangent * pq;
  pq = F16(0);
  const auto rotate = [cosine, sine](F16& a, F16& b) {
    const F16 before = a;
    a = cosine * before - sine * b;
    b = sine * before + cosine * b;
  };
  rotate(pr, qr);
  for (std::size_t k = 0; k < 3; ++k) rotate(vp[k], vq[k]);
}

// The unit axes (3) along which neighbourhoods spread least. sums: as those of Neighbourhoods. Sixteen at once: a rotation is
// one long chain of operations, each of which waits for the last, so there is time for a second register beside it.
inline void least_axes(const F16 (&sums)[kSums], F16 (&axes)[3]) {
  const F16* s = sums;
  const F16 share = F16(1) / most(s[0], F16(1));
  F16 xx = s[4] - s[1] * s[1] * share, xy = s[5] - s[1] * s[2] * share, xz = s[6] - s[1] * s[3] * share;
  F16 yy = s[7] - s[2] * s[2] * share, yz = s[8] - s[2] * s[3] * share, zz = s[9] - s[3] * s[3] * share;
  const F16 scale = F16(1) / most(most(xx, most(yy, zz)), F16(1e-30F));
  for (F16* element : {&xx, &xy, &xz, &yy, &yz, &zz}) *element = *element * scale;
  F16 vx[3] = {1, 0, 0}, vy[3] = {0, 1, 0}, vz[3] = {0, 0, 1};
  constexpr int kSweeps = 4;
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    rotate_plane(xx, yy, xy, xz, yz, vx, vy);
    rotate_plane(xx, zz, xz, xy, yz, vx, vz);
    rotate_plane(yy, zz, yz, xy, xz, vy, vz);
  }
  // of equal ones, the first: points of a level line are on a wall
  for (std::size_t k = 0; k < 3; ++k) axes[k] = choose(xx <= least(yy, zz), vx[k], choose(yy <= zz, vy[k], vz[k]));
}

}  // namespace detail

namespace detail {

// As surface_normals. facing: see NeighbourSearch.
template <bool kSidesMatter>
void normals_around(const KdTree& tree, const float* to_viewer, const float* facing, float* normals, std::uint8_t* oriented) {
  NeighbourSearch<kSidesMatter> search(tree, to_viewer, facing);
  for (std::size_t begin = 0; begin < tree.size(); begin += KdTree::kLeaf) {
    const std::size_t end = std::min<std::size_t>(begin + KdTree::kLeaf, tree.size());
    F16 sums[kSums] = {}, least[3];
    for (std::size_t first = begin; first < end; first += kFloatLanes) {
      const Neighbourhoods found = search.around(first);
      for (std::size_t k = 0; k < kSums; ++k) sums[k].part[(first - begin) / kFloatLanes] = found.sum[k];
    }
    least_axes(sums, least);
    float axes[3][KdTree::kLeaf];
    for (std::size_t k = 0; k < 3; ++k) std::memcpy(axes[k], least[k].part, sizeof axes[k]);
    for (std::size_t i = begin; i < end; ++i) {
      const std::size_t row = tree.order()[i];
      const float* eye = to_viewer == nullptr ? nullptr : to_viewer + 3 * row;
      float along = 0, length2 = 0;
      for (std::size_t k = 0; eye != nullptr && k < 3; ++k) {
        along += axes[k][i - begin] * eye[k];
        length2 += eye[k] * eye[k];
      }
      for (std::size_t k = 0; k < 3; ++k) normals[3 * row + k] = along < 0 ? -axes[k][i - begin] : axes[k][i - begin];
      oriented[row] = std::fabs(along) > kGrazing * std::sqrt(length2) ? 1 : 0;
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
