// Reads a scan from a PCD file (ascii or binary, fields x y z of four or eight bytes), a body of the protocol's own encodings
// (.ffscan, which may have times), a serialised sensor_msgs/PointCloud2 (.cdr, which may have times), or raw little-endian float32. A
// body of the protocol may hold several scans, or a compact one.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <sstream>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "firstfix/ros/point_cloud2.hpp"
#include "firstfix/scan/scan.hpp"
#include "firstfix/scan/sequence.hpp"
#include "firstfix/wire/query.hpp"
#include "firstfix/wire/scan.hpp"
#include "firstfix/wire/sequence.hpp"

namespace firstfix::example {

struct Field {
  std::string name;
  std::size_t bytes = 0, count = 1, offset = 0;
  bool real = false;
};

inline double value_of(const char* at, const Field& field) {
  if (field.bytes == 4) {
    float v = 0;
    std::memcpy(&v, at, sizeof v);
    return static_cast<double>(v);
  }
  double v = 0;
  std::memcpy(&v, at, sizeof v);
  return v;
}

inline std::vector<std::string> words_after(std::istringstream& line) {
  return {std::istream_iterator<std::string>(line), std::istream_iterator<std::string>()};
}

inline std::size_t small_number(const std::string& text) {
  std::size_t value = 0;
  for (const char c : text) {
    if (c < '0' || c > '9' || value > 100'000'000) throw Error("malformed_data", "a number of the PCD header is not valid");
    value = value * 10 + static_cast<std::size_t>(c - '0');
  }
  return value;
}

struct PcdHeader {
  std::vector<Field> fields;
  std::size_t points = 0, step = 0;
  std::string data;

  const Field& field(const std::string& name) const {
    for (const Field& one : fields) {
      if (one.name == name && one.real && one.count == 1 && (one.bytes == 4 || one.bytes == 8)) return one;
    }
    throw Error("unsupported_format", "the PCD file has no field " + name + " of 4 or 8 bytes");
  }

  std::size_t column(const std::string& name) const {
    std::size_t before = 0;
    for (const Field& one : fields) {
      if (one.name == name) return before;
      before += one.count;
    }
    return before;
  }
};

inline PcdHeader read_header(std::istream& in) {
  PcdHeader header;
  for (std::string line; header.data.empty() && std::getline(in, line);) {
    std::istringstream rest(line);
    std::string key;
    rest >> key;
    const std::vector<std::string> words = words_after(rest);
    if (key == "FIELDS") {
      for (const std::string& name : words) header.fields.push_back({name});
    } else if (key == "SIZE" || key == "TYPE" || key == "COUNT") {
      if (words.size() != header.fields.size()) throw Error("malformed_data", "the PCD header contradicts itself");
      for (std::size_t i = 0; i < words.size(); ++i) {
        if (key == "SIZE") header.fields[i].bytes = small_number(words[i]);
        if (key == "TYPE") header.fields[i].real = words[i] == "F";
        if (key == "COUNT") header.fields[i].count = small_number(words[i]);
      }
    } else if (key == "POINTS" && words.size() == 1) {
      header.points = small_number(words[0]);
    } else if (key == "DATA" && words.size() == 1) {
      header.data = words[0];
    }
  }
  for (Field& one : header.fields) {
    if (one.bytes > 8 || one.count > 10'000) throw Error("malformed_data", "a field of the PCD file is too large");
    one.offset = header.step;
    header.step += one.bytes * one.count;
  }
  if (header.points > kMaxPoints || header.step > 10'000) throw Error("too_large", "the PCD file has too many points");
  return header;
}

inline Scan read_pcd(std::istream& in) {
  const PcdHeader header = read_header(in);
  const Field* fields[] = {&header.field("x"), &header.field("y"), &header.field("z")};
  Scan scan;
  if (header.data == "binary") {
    std::vector<char> row(header.step);
    for (std::size_t i = 0; i < header.points; ++i) {
      if (!in.read(row.data(), static_cast<std::streamsize>(row.size()))) {
        throw Error("malformed_data", "the PCD file is cut off");
      }
      float xyz[3];
      for (int axis = 0; axis < 3; ++axis) {
        xyz[axis] = static_cast<float>(value_of(row.data() + fields[axis]->offset, *fields[axis]));
      }
      scan.points.push_back({xyz[0], xyz[1], xyz[2]});
    }
  } else if (header.data == "ascii") {
    const std::size_t columns[] = {header.column("x"), header.column("y"), header.column("z")};
    for (std::string line; scan.points.size() < header.points && std::getline(in, line);) {
      std::istringstream rest(line);
      const std::vector<std::string> words = words_after(rest);
      float xyz[3];
      for (int axis = 0; axis < 3; ++axis) {
        if (columns[axis] >= words.size()) throw Error("malformed_data", "a row of the PCD file is too short");
        char* end = nullptr;
        xyz[axis] = std::strtof(words[columns[axis]].c_str(), &end);
        if (end == words[columns[axis]].c_str()) throw Error("malformed_data", "a number of the PCD file is not valid");
      }
      scan.points.push_back({xyz[0], xyz[1], xyz[2]});
    }
  } else {
    throw Error("unsupported_format", "only ascii and binary PCD is supported, not " + header.data);
  }
  return scan;
}

inline bool ends_with(const std::string& path, const std::string& ending) {
  return path.size() > ending.size() && path.compare(path.size() - ending.size(), ending.size(), ending) == 0;
}

// All bytes of a file.
inline Bytes read_body(const std::string& path) {
  constexpr std::size_t kMostBytes = 257'000'000;  // of a message, as the service takes it
  std::ifstream in(path, std::ios::binary);
  if (!in) throw Error("not_found", "no such file: " + path);
  if (std::filesystem::file_size(path) > kMostBytes) throw Error("too_large", "the file has too many bytes");
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

inline Scan read_scan(const std::string& path) {
  if (ends_with(path, ".ffscan")) return decode_scan(read_body(path));
  if (ends_with(path, ".cdr")) return ros::read_point_cloud2(detail::span_of(read_body(path))).scan;
  std::ifstream in(path, std::ios::binary);
  if (!in) throw Error("not_found", "no such file: " + path);
  if (ends_with(path, ".pcd")) return read_pcd(in);
  Scan scan;
  for (float xyz[3]; in.read(reinterpret_cast<char*>(xyz), sizeof xyz);) {
    if (scan.points.size() == kMaxPoints) throw Error("too_large", "the file has over 2,000,000 points");
    scan.points.push_back({xyz[0], xyz[1], xyz[2]});
  }
  if (in.gcount() != 0) throw Error("malformed_data", "the file does not have a whole number of points");
  return scan;
}

using ScanOrSequence = std::variant<Scan, CompactScan, ScanSequence>;

inline ScanOrSequence read_scans(const std::string& path) {
  if (!ends_with(path, ".ffscan")) return read_scan(path);
  const Bytes body = read_body(path);
  const std::string magic(body.begin(), body.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(body.size(), 4)));
  if (magic == "FFSS") return decode_scans(body);
  if (magic != "FFQY") return decode_scan(body);
  Query query = decode_query(body);
  if (auto* compact = std::get_if<CompactScan>(&query)) return std::move(*compact);
  throw Error("unsupported_format", "a descriptor has no points: only a service answers it, with candidates");
}

}  // namespace firstfix::example
