#include "version_folder.hpp"

#include <openssl/evp.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <memory>
#include <utility>

#include "fields.hpp"

namespace firstfix::version {
namespace {

constexpr std::int64_t kFormat = 9;
constexpr std::uint64_t kMaxManifestBytes = 64 << 20, kMaxFileBytes = std::uint64_t{1} << 40;

std::string sha256_of(const std::uint8_t* data, std::size_t size) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned length = 0;
  if (EVP_Digest(data, size, digest.data(), &length, EVP_sha256(), nullptr) != 1 || length != 32) {
    throw Error("internal", "libcrypto cannot compute a sha256");
  }
  std::string text;
  for (unsigned i = 0; i < length; ++i) {
    text += "0123456789abcdef"[digest[i] >> 4];
    text += "0123456789abcdef"[digest[i] & 15];
  }
  return text;
}

bool is_sha256(const std::string& text) {
  return text.size() == 64 && std::all_of(text.begin(), text.end(), [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

// The last part of a path.
std::string name_of(std::string path) {
  while (!path.empty() && path.back() == '/') path.pop_back();
  return path.substr(path.rfind('/') + 1);  // npos + 1 is 0
}

}  // namespace

VersionFolder::VersionFolder(const std::string& folder) : folder_(folder) {
  const std::string path = folder + "/manifest.json";
  struct stat found {};
  if (::stat(path.c_str(), &found) != 0) throw Error("not_found", "there is no version in the folder " + folder + ": it has no manifest.json");
  if (found.st_size <= 0 || static_cast<std::uint64_t>(found.st_size) > kMaxManifestBytes) refuse("manifest.json is empty or too large");
  const MappedFile file(path, "manifest.json", static_cast<std::uint64_t>(found.st_size));
  version_ = sha256_of(file.data(), file.size());
  const std::string name = name_of(folder);
  if (is_sha256(name) && name != version_) refuse("manifest.json is not that of the version " + name);
  const Json manifest = parsed(reinterpret_cast<const char*>(file.data()), file.size(), "manifest.json");
  const Json& format = field(manifest, "format");
  if (!format.is_number_integer() || format.get<std::int64_t>() != kFormat) {
    throw Error("incompatible_version", "the version has another format than 9: build the map again, or update this library");
  }
  const Json& files = field(manifest, "files");
  if (!files.is_object()) refuse("files is not an object");
  for (const auto& [each, entry] : files.items()) {
    const double bytes = number_in(entry, "bytes", 0, static_cast<double>(kMaxFileBytes));
    const std::string sha256 = text_in(entry, "sha256");
    if (!is_sha256(sha256) || bytes != std::floor(bytes)) refuse("the manifest has no size and sha256 of " + each);
    files_[each] = {static_cast<std::uint64_t>(bytes), sha256};
  }
}

MappedFile VersionFolder::file(const std::string& name) const {
  const auto entry = files_.find(name);
  if (entry == files_.end()) refuse("the manifest has no " + name);
  MappedFile mapped(folder_ + "/" + name, name, entry->second.bytes);
  if (sha256_of(mapped.data(), mapped.size()) != entry->second.sha256) mapped.refuse("its sha256 is not that of the manifest");
  mapped.release();
  return mapped;
}

}  // namespace firstfix::version
