// firstfix_clouds OUT FILE...: reads PointCloud2 messages, and writes of each what was read, for a comparison with the Python reader.
//
// A line a file: "error CODE: TEXT", or "ok POINTS STAMP FRAME NOT_FINITE TOO_FAR FAR SPREAD WITH_INTENSITY WITH_TIMES", a tab, and the
// time field with its clock and why. Bytes that are no printable ASCII are written as \\xHH. OUT gets the numbers of each as float32:
// points, then intensities, then times.
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "firstfix/ros/point_cloud2.hpp"

namespace {

void write(std::ofstream& out, const float* numbers, std::size_t count) {
  out.write(reinterpret_cast<const char*>(numbers), static_cast<std::streamsize>(count * sizeof(float)));
}

void say(const char* text) {
  for (; *text != 0; ++text) {
    const auto byte = static_cast<unsigned char>(*text);
    if (byte < 0x20 || byte > 0x7E || byte == '\\') std::printf("\\x%02x", static_cast<unsigned>(byte));
    else std::putchar(byte);
  }
}

void read(const char* path, std::ofstream& out) {
  std::ifstream in(path, std::ios::binary);
  const std::vector<char> content{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  const std::vector<std::uint8_t> body(content.begin(), content.end());  // of exactly this size: a sanitizer sees what is read beyond
  try {
    const auto [scan, frame] = firstfix::ros::read_point_cloud2({body.data(), body.size()});
    const firstfix::Dropped& dropped = scan.dropped;
    std::printf("ok %zu %.17g ", scan.points.size(), scan.stamp_s.value_or(0));
    say(frame.c_str());
    std::printf(" %zu %zu %.17g %.17g %d %d", dropped.not_finite, dropped.too_far, dropped.far_m, dropped.spread_m,
                scan.intensity ? 1 : 0, scan.time_s ? 1 : 0);
    if (scan.time_field) {
      for (const std::string& text : {scan.time_field->described(), scan.time_field->clock, scan.time_field->why}) {
        std::putchar('\t'), say(text.c_str());
      }
    }
    std::putchar('\n');
    write(out, firstfix::numbers_of(scan.points), 3 * scan.points.size());
    if (scan.intensity) write(out, scan.intensity->data(), scan.intensity->size());
    if (scan.time_s) write(out, scan.time_s->data(), scan.time_s->size());
  } catch (const firstfix::Error& error) {
    std::printf("error "), say(error.what()), std::putchar('\n');
  }
}

}  // namespace

int main(int argc, char** argv) {
  std::ofstream out(argc > 1 ? argv[1] : "", std::ios::binary);
  for (int i = 2; i < argc; ++i) read(argv[i], out);
  return out.good() ? 0 : 1;
}
