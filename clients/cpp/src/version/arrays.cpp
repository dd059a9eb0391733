#include "arrays.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <regex>

#include "fields.hpp"

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "a version's files are little-endian");

namespace firstfix::version {

template <>
const char* type_name<float>() { return "<f4"; }
template <>
const char* type_name<std::int32_t>() { return "<i4"; }
template <>
const char* type_name<std::uint8_t>() { return "|u1"; }
template <>
const char* type_name<bool>() { return "|b1"; }

namespace {

constexpr std::size_t kMaxHeaderBytes = 1 << 20;

std::size_t bytes_of_type(const std::string& type) {
  return type == "<f4" || type == "<i4" ? 4 : type == "<f8" || type == "<i8" ? 8 : type == "|u1" || type == "|b1" ? 1 : 0;
}

// The bytes of an array; 0 if they are more than `most`, or its type is unknown.
bool has_bytes(const Array& array, std::size_t bytes) {
  std::size_t size = bytes_of_type(array.type);
  if (size == 0) return false;
  for (const std::size_t along : array.shape) {
    if (along != 0 && size > std::numeric_limits<std::size_t>::max() / along) return false;
    size *= along;
  }
  return size == bytes;
}

// Reads numbers of a file one after the other.
class Reading {
 public:
  explicit Reading(const MappedFile& file) : file_(file) {}

  template <class T>
  T next() {
    T value;
    std::memcpy(&value, bytes(sizeof value), sizeof value);
    return value;
  }

  const std::uint8_t* bytes(std::size_t count) {
    if (count > file_.size() - at_) file_.refuse("it is cut off");
    at_ += count;
    return file_.data() + at_ - count;
  }

  std::size_t left() const { return file_.size() - at_; }

 private:
  const MappedFile& file_;
  std::size_t at_ = 0;
};

}  // namespace

Array npy_array(const MappedFile& file) {
  Reading rest(file);
  if (std::memcmp(rest.bytes(6), "\x93NUMPY", 6) != 0) file.refuse("it is not a .npy file");
  const auto major = rest.next<std::uint8_t>();
  rest.next<std::uint8_t>();
  const std::size_t length = major == 1 ? rest.next<std::uint16_t>() : rest.next<std::uint32_t>();
  if (major > 2 || length > 4096) file.refuse("it is not a .npy file of version 1 or 2");
  const std::string header(reinterpret_cast<const char*>(rest.bytes(length)), length);
  static const std::regex form(R"(\{'descr': '([<|][a-z][1-8])', 'fortran_order': False, 'shape': \((\d{1,18}),(?: (\d{1,18}))?\), \} *\n)");
  std::smatch found;
  if (!std::regex_match(header, found, form)) file.refuse("it has no array of one or two axes");
  Array array{nullptr, found[1], {std::stoull(found[2])}};
  if (found[3].matched) array.shape.push_back(std::stoull(found[3]));
  if (!has_bytes(array, rest.left())) file.refuse("its array has another size");
  array.data = rest.bytes(rest.left());
  if (reinterpret_cast<std::uintptr_t>(array.data) % bytes_of_type(array.type) != 0) file.refuse("its array is not aligned");
  return array;
}

std::map<std::string, Array> named_arrays(const MappedFile& file) {
  static const std::map<std::string, std::string> kTypes{{"F32", "<f4"}, {"F64", "<f8"}, {"I32", "<i4"}, {"U8", "|u1"}, {"BOOL", "|b1"}};
  Reading rest(file);
  const auto length = rest.next<std::uint64_t>();
  if (length > std::min(kMaxHeaderBytes, rest.left())) file.refuse("it has no header");
  const Json header = parsed(reinterpret_cast<const char*>(rest.bytes(length)), length, file.name());
  const std::size_t size = rest.left();
  const std::uint8_t* content = rest.bytes(size);
  std::map<std::string, Array> arrays;
  for (const auto& [name, entry] : header.items()) {
    if (name == "__metadata__") continue;
    const auto type = kTypes.find(text_in(entry, "dtype"));
    if (type == kTypes.end()) file.refuse("an array has an unknown type");
    Array array{nullptr, type->second, {}};
    constexpr double kMost = 9e15;  // a double counts so many exactly
    for (const double along : numbers_in(entry, "shape", 0, 4, kMost)) {
      if (along < 0 || along != std::floor(along)) file.refuse("an array has no such shape");
      array.shape.push_back(static_cast<std::size_t>(along));
    }
    const std::vector<double> offsets = numbers_in(entry, "data_offsets", 2, 2, kMost);
    if (!(offsets[0] >= 0 && offsets[0] <= offsets[1] && offsets[1] <= static_cast<double>(size))) file.refuse("an array is cut off");
    const auto begin = static_cast<std::size_t>(offsets[0]), end = static_cast<std::size_t>(offsets[1]);
    if (!has_bytes(array, end - begin)) file.refuse("an array has another size than its shape");
    array.data = content + begin;
    if (reinterpret_cast<std::uintptr_t>(array.data) % bytes_of_type(array.type) != 0) file.refuse("an array is not aligned");
    arrays[name] = array;
  }
  return arrays;
}

std::size_t ArrayFile::count(const char* name) const {
  std::size_t count = 1;
  for (const std::size_t along : array(name).shape) count *= along;  // its bytes are in the file: no overflow
  return count;
}

FaissCodes faiss_codes(const MappedFile& file) {
  Reading rest(file);
  if (std::memcmp(rest.bytes(4), "IxSQ", 4) != 0) {
    throw Error("incompatible_version", file.name() + ": its keys lie in lists, which only a service searches");
  }
  const auto numbers = rest.next<std::int32_t>();
  const auto count = rest.next<std::int64_t>();
  rest.bytes(16);  // unused numbers
  const auto is_trained = rest.next<std::uint8_t>();
  const auto metric = rest.next<std::int32_t>(), kind = rest.next<std::int32_t>();
  rest.bytes(8);  // how the ranges were trained
  const auto of_quantizer = rest.next<std::uint64_t>(), code_bytes = rest.next<std::uint64_t>(), trained = rest.next<std::uint64_t>();
  constexpr std::int32_t kL2 = 1, kEightBits = 0;
  if (numbers < 1 || numbers > 1 << 20 || count < 0 || count >= std::int64_t{1} << 31 || is_trained != 1) file.refuse("its header is damaged");
  const auto width = static_cast<std::size_t>(numbers);
  if (metric != kL2 || kind != kEightBits || of_quantizer != width || code_bytes != width || trained != 2 * width) {
    file.refuse("its codes are not those of 8 bits a number");
  }
  FaissCodes made;
  made.numbers = width, made.count = static_cast<std::size_t>(count);
  for (std::vector<float>* part : {&made.lowest, &made.range}) {
    part->resize(width);
    std::memcpy(part->data(), rest.bytes(4 * width), 4 * width);
  }
  const auto bytes = rest.next<std::uint64_t>();
  if (bytes != rest.left() || bytes / width != made.count || bytes % width != 0) file.refuse("it has not one code for each key");
  made.codes = rest.bytes(bytes);
  return made;
}

}  // namespace firstfix::version
