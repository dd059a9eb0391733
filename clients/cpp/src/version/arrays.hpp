// Arrays in a version's files, where they lie in memory: .npy, safetensors, and the codes of a FAISS index.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "firstfix/retrieval/key_codes.hpp"
#include "mapped_file.hpp"

namespace firstfix::version {

// Type of an array's numbers, as NumPy writes it: "<f4", "<i4", "|u1", "|b1".
template <class T>
const char* type_name();

// A C-contiguous array in a mapped file.
struct Array {
  const std::uint8_t* data = nullptr;
  std::string type;
  std::vector<std::size_t> shape;

  // Its numbers. Throws Error "corrupt_version" if it has another type or shape. shape: 0 stands for any size.
  template <class T>
  const T* of(const std::string& name, const std::vector<std::size_t>& wanted) const {
    bool fits = type == type_name<T>() && shape.size() == wanted.size();
    for (std::size_t axis = 0; fits && axis < shape.size(); ++axis) fits = wanted[axis] == 0 || shape[axis] == wanted[axis];
    if (!fits) throw Error("corrupt_version", name + " has another type or shape than it must have");
    return reinterpret_cast<const T*>(data);
  }
};

// The array of a .npy file.
Array npy_array(const MappedFile& file);

// The arrays of a safetensors file, by name.
std::map<std::string, Array> named_arrays(const MappedFile& file);

// A safetensors file, and its arrays by name. Each function throws Error "corrupt_version" if there is no such array.
class ArrayFile {
 public:
  explicit ArrayFile(MappedFile&& file) : file_(std::move(file)), arrays_(named_arrays(file_)) {}

  // Its numbers, as Array::of.
  template <class T>
  const T* of(const char* name, const std::vector<std::size_t>& wanted) const {
    return array(name).of<T>(file_.name() + ": " + name, wanted);
  }

  // Its size along an axis.
  std::size_t shape(const char* name, std::size_t axis) const {
    const Array& found = array(name);
    if (axis >= found.shape.size()) refuse(std::string(name) + " has too few axes");
    return found.shape[axis];
  }

  // Number of its numbers.
  std::size_t count(const char* name) const;

  void release() const { file_.release(); }

  [[noreturn]] void refuse(const std::string& what) const { file_.refuse(what); }

 private:
  const Array& array(const char* name) const {
    const auto found = arrays_.find(name);
    if (found == arrays_.end()) refuse("the array " + std::string(name) + " is missing");
    return found->second;
  }

  MappedFile file_;
  std::map<std::string, Array> arrays_;
};

// The codes of an index of 8 bits a number, of all keys in one list (IndexScalarQuantizer, QT_8bit, L2).
struct FaissCodes {
  const std::uint8_t* codes = nullptr;
  std::size_t count = 0, numbers = 0;
  std::vector<float> lowest, range;

  KeyCodes view() const { return {codes, count, numbers, lowest.data(), range.data()}; }
};

FaissCodes faiss_codes(const MappedFile& file);

}  // namespace firstfix::version
