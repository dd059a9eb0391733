// Files of the golden vectors, and the plain form of bodies (clients/conformance/README.md).
#pragma once

#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "firstfix/client.hpp"

namespace firstfix::test {

inline Bytes read_file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error("cannot read " + path);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

inline std::string read_text(const std::string& path) {
  const Bytes bytes = read_file(path);
  return {bytes.begin(), bytes.end()};
}

inline std::uint8_t digit(char c) { return static_cast<std::uint8_t>(c <= '9' ? c - '0' : c - 'a' + 10); }

inline Bytes from_hex(const std::string& text) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 2) {
    bytes.push_back(static_cast<std::uint8_t>(digit(text[i]) << 4 | digit(text[i + 1])));
  }
  return bytes;
}

// The damaged bodies by name.
inline std::map<std::string, Bytes> read_damaged(const std::string& folder) {
  std::map<std::string, Bytes> bodies;
  const nlohmann::json digits = nlohmann::json::parse(read_text(folder + "damaged.json"));
  for (const auto& [name, text] : digits.items()) bodies[name] = from_hex(text.get<std::string>());
  return bodies;
}

// The body of a vector: a file, or "damaged.json#NAME".
inline Bytes read_body(const std::string& folder, const std::string& path) {
  static const std::map<std::string, Bytes> damaged = read_damaged(folder);
  const std::size_t mark = path.find('#');
  return mark == std::string::npos ? read_file(folder + path) : damaged.at(path.substr(mark + 1));
}

inline std::vector<float> read_floats(const std::string& path) {
  const Bytes bytes = read_file(path);
  detail::Reader rest(bytes.data(), bytes.size(), path);
  std::vector<float> values;
  while (rest.left() > 0) values.push_back(rest.get<float>());
  return values;
}

// A valid body in which every zstd frame is replaced by its content, and every length of a frame by 0.
inline Bytes plain_form(detail::ByteSpan body) {
  const auto length = [&body](std::size_t at, std::size_t bytes) {
    std::size_t value = 0;
    for (std::size_t i = 0; i < bytes; ++i) value |= std::size_t{body.data[at + i]} << (8 * i);
    return value;
  };
  const auto copy = [&body](Bytes& into, std::size_t from, std::size_t to) {
    into.insert(into.end(), body.data + from, body.data + to);
  };
  const auto content = [&body](Bytes& into, std::size_t from, std::size_t to) {
    detail::append(into, detail::decompressed({body.data + from, to - from}, 0, 100'000'000));
  };
  Bytes plain;
  const auto times = [&](std::size_t from) {  // returns their end
    const std::size_t end = from + 12 + length(from + 8, 4);
    copy(plain, from, from + 8);
    plain.insert(plain.end(), 4, 0);
    content(plain, from + 12, end);
    return end;
  };
  if (std::memcmp(body.data, "FFSC", 4) == 0) {
    copy(plain, 0, 6);
    const bool timed = body.data[5] > 4;
    const std::size_t after = timed ? times(6) : 6;
    if (body.data[5] % 4 == 2) {
      const std::size_t end = after + 30 + length(after + 26, 4);
      copy(plain, after, after + 26);
      plain.insert(plain.end(), 4, 0);
      content(plain, after + 30, end);
      content(plain, end, body.size);
      return plain;
    }
    copy(plain, after, after + 58);
    content(plain, after + 58, body.size);
    return plain;
  }
  copy(plain, 0, 8);
  std::size_t at = 8;
  if (std::memcmp(body.data, "FFSS", 4) == 0) {
    for (int left = body.data[5]; left > 0; --left) {
      const std::size_t size = length(at + 56, 4);
      copy(plain, at, at + 56);
      plain.insert(plain.end(), 4, 0);
      detail::append(plain, plain_form({body.data + at + 60, size}));
      at += 60 + size;
    }
    return plain;
  }
  if ((body.data[5] & 1) != 0) {
    const std::size_t count = length(at + 4, 2), first = length(at + 18, 2), second = length(at + 20, 2);
    copy(plain, at, at + 18);
    plain.insert(plain.end(), 4, 0);
    at += 22;
    content(plain, at, at + first);
    content(plain, at + first, at + first + second);
    at += first + second;
    copy(plain, at, at + 3 * ((count + 1) / 2));
    at += 3 * ((count + 1) / 2);
  }
  if ((body.data[5] & 2) != 0) {
    const std::size_t head = at + 32 + 4 * std::size_t{body.data[at + 1]}, end = head + length(at + 6, 2);
    copy(plain, at, at + 6);
    plain.insert(plain.end(), 2, 0);
    copy(plain, at + 8, head);
    content(plain, head, end);
    at = end;
  }
  if ((body.data[5] & 4) != 0) times(at);
  return plain;
}

}  // namespace firstfix::test
