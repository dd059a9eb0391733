// Serves 3D-BBS (its installed library, on the CPU) to bbs.py: a map once, then one levelled scan after the other.
//
//   bbs_driver MAP LEVEL_M LEVELS SCORE LIMIT_MS THREADS
//
// MAP holds float64 x, y, z of each point. LEVEL_M is the edge of the finest voxels, LEVELS the number of doublings.
// SCORE is the least share of a scan's points that must lie in occupied voxels. In: uint64 number of points, then
// float64 x, y, z each. Out: "ready" after the voxel maps are built; then for each scan 17 float64: the share of its
// points that lie in occupied voxels, 0 if it was not localized, and the pose T_map_level row by row. All numbers are little-endian.

#include <cpu_bbs3d/bbs3d.hpp>

#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

using Points = std::vector<Eigen::Vector3d>;
using RowMajor = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;

constexpr std::uint64_t kMostPoints = 100'000'000;

Points read_points(std::istream& in, std::uint64_t count) {
  if (count > kMostPoints) throw std::runtime_error("too many points");
  Points points(count);
  for (auto& point : points) in.read(reinterpret_cast<char*>(point.data()), 3 * sizeof(double));
  if (!in) throw std::runtime_error("the points end too early");
  return points;
}

Points read_map(const std::string& path) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in) throw std::runtime_error("cannot open " + path);
  const auto bytes = static_cast<std::uint64_t>(in.tellg());
  in.seekg(0);
  return read_points(in, bytes / (3 * sizeof(double)));
}

void serve(cpu::BBS3D& bbs) {
  std::uint64_t count = 0;
  while (std::cin.read(reinterpret_cast<char*>(&count), sizeof count)) {
    bbs.set_src_points(read_points(std::cin, count));
    bbs.localize();
    const double share = bbs.has_localized() ? bbs.get_best_score_percentage() : 0.0;
    RowMajor pose = RowMajor::Identity();
    if (bbs.has_localized()) pose = bbs.get_global_pose();
    std::cout.write(reinterpret_cast<const char*>(&share), sizeof share);
    std::cout.write(reinterpret_cast<const char*>(pose.data()), sizeof(double) * 16);
    std::cout.flush();
  }
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 7) throw std::runtime_error("usage: bbs_driver MAP LEVEL_M LEVELS SCORE LIMIT_MS THREADS");
  const Points map = read_map(argv[1]);
  cpu::BBS3D bbs;
  bbs.set_tar_points(map, std::atof(argv[2]), std::atoi(argv[3]));
  bbs.set_trans_search_range(map);
  bbs.set_score_threshold_percentage(std::atof(argv[4]));
  bbs.enable_timeout();
  bbs.set_timeout_duration_in_msec(std::atoi(argv[5]));
  bbs.set_num_threads(std::atoi(argv[6]));
  std::cout << "ready\n" << std::flush;
  serve(bbs);
  return 0;
} catch (const std::exception& error) {
  std::cerr << "bbs_driver: " << error.what() << '\n';
  return 1;
}
