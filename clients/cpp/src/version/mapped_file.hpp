// A file of a version, memory-mapped: processes that read it share its pages.
#pragma once

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "firstfix/errors.hpp"

namespace firstfix::version {

class MappedFile {
 public:
  // bytes: that the file must have.
  MappedFile(const std::string& path, const std::string& name, std::uint64_t bytes) : name_(name) {
    const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (file < 0) throw Error("corrupt_version", name + " cannot be read");
    struct stat found {};
    void* mapped = MAP_FAILED;
    const bool fits = ::fstat(file, &found) == 0 && S_ISREG(found.st_mode) && static_cast<std::uint64_t>(found.st_size) == bytes;
    if (fits && bytes > 0) mapped = ::mmap(nullptr, bytes, PROT_READ, MAP_SHARED, file, 0);
    ::close(file);
    if (!fits) throw Error("corrupt_version", name + " has not the size that the manifest says");
    if (mapped == MAP_FAILED) throw Error("corrupt_version", name + " cannot be mapped into memory");
    data_ = static_cast<const std::uint8_t*>(mapped);
    size_ = bytes;
  }
  MappedFile(MappedFile&& other) noexcept
      : name_(std::move(other.name_)), data_(std::exchange(other.data_, nullptr)), size_(std::exchange(other.size_, 0)) {}
  MappedFile& operator=(MappedFile&&) = delete;
  ~MappedFile() {
    if (data_ != nullptr) ::munmap(const_cast<std::uint8_t*>(data_), size_);
  }

  const std::string& name() const { return name_; }
  const std::uint8_t* data() const { return data_; }
  std::size_t size() const { return size_; }

  // Gives its pages back, which were read once to check them. What is read again is mapped again.
  void release() const {
    if (data_ != nullptr) ::madvise(const_cast<std::uint8_t*>(data_), size_, MADV_DONTNEED);
  }

  [[noreturn]] void refuse(const std::string& what) const { throw Error("corrupt_version", name_ + ": " + what); }

 private:
  std::string name_;
  const std::uint8_t* data_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace firstfix::version
