// The files of a version, each compared with the manifest before it is read.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "mapped_file.hpp"

namespace firstfix::version {

class VersionFolder {
 public:
  // Reads the manifest. A folder whose name is a sha256, as in a store, must have a manifest with this sha256.
  explicit VersionFolder(const std::string& folder);

  const std::string& version() const { return version_; }
  bool has(const std::string& name) const { return files_.count(name) != 0; }

  // Throws Error "corrupt_version" if the file is missing or another one.
  MappedFile file(const std::string& name) const;

 private:
  struct Entry {
    std::uint64_t bytes;
    std::string sha256;
  };

  std::string folder_, version_;
  std::map<std::string, Entry> files_;
};

}  // namespace firstfix::version
