// Signatures of zenoh queries and their replies (clients/protocol/signatures.md). Needs libcrypto.
#pragma once

#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <firstfix/errors.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace firstfix {

using Digest = std::array<unsigned char, 32>;
using Nonce = std::array<unsigned char, 16>;

// What a query asks, besides its payload.
struct Asked {
  std::string key;                                              // expression, as it is sent
  std::vector<std::pair<std::string, std::string>> parameters;  // of the selector, in any order
  std::string encoding;                                         // of the payload; empty without one
};

namespace detail {

inline void append_number(std::string& bytes, std::uint64_t value, int size) {
  for (int k = 0; k < size; ++k) bytes.push_back(static_cast<char>(value >> (8 * k) & 0xFF));
}

inline void append_counted(std::string& bytes, std::string_view text) {
  append_number(bytes, text.size(), 4);
  bytes.append(text);
}

inline void append_digest(std::string& bytes, const Digest& digest) { bytes.append(digest.begin(), digest.end()); }

inline Digest sha256(std::string_view bytes) {
  Digest digest;
  if (EVP_Digest(bytes.data(), bytes.size(), digest.data(), nullptr, EVP_sha256(), nullptr) != 1) {
    throw Error("internal", "libcrypto has no SHA-256");
  }
  return digest;
}

inline Digest keyed_hash(const Digest& key, std::string_view message) {
  Digest digest;
  const auto* data = reinterpret_cast<const unsigned char*>(message.data());
  if (HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()), data, message.size(), digest.data(), nullptr) ==
      nullptr) {
    throw Error("internal", "libcrypto has no HMAC-SHA256");
  }
  return digest;
}

inline bool is_hexadecimal(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

inline std::string asked_message(const Asked& asked) {
  auto pairs = asked.parameters;
  const auto is_zenohs_own = [](const auto& pair) { return !pair.first.empty() && pair.first.front() == '_'; };
  pairs.erase(std::remove_if(pairs.begin(), pairs.end(), is_zenohs_own), pairs.end());
  std::sort(pairs.begin(), pairs.end());  // std::string compares bytes as unsigned
  std::string message;
  append_counted(message, asked.key);
  append_counted(message, asked.encoding);
  for (const auto& [name, value] : pairs) {
    append_counted(message, name);
    append_counted(message, value);
  }
  return message;
}

}  // namespace detail

// Signs queries and checks their replies with an API key, which is never sent itself.
class QuerySigner {
 public:
  // Throws Error invalid_option if the text is no API key.
  explicit QuerySigner(std::string_view api_key) {
    if (api_key.size() != 81 || api_key.substr(0, 4) != "ffx_" || api_key[16] != '_' ||
        !detail::is_hexadecimal(api_key.substr(4, 12)) || !detail::is_hexadecimal(api_key.substr(17))) {
      throw Error("invalid_option", "an API key is ffx_, 12 characters of 0-9 and a-f, _ and 64 more of them");
    }
    key_id_ = api_key.substr(4, 12);
    const Digest secret = detail::sha256(api_key.substr(17));
    query_key_ = detail::keyed_hash(secret, "firstfix zenoh v1 query");
    answer_key_ = detail::keyed_hash(secret, "firstfix zenoh v1 answer");
  }

  // Returns the attachment of a query. The nonce must be random, and new for each query that is sent.
  std::string sign(const Asked& asked, std::string_view payload, std::uint64_t time_ms, const Nonce& nonce) const {
    std::string attachment = "FFQ1" + key_id_;
    detail::append_number(attachment, time_ms, 8);
    attachment.append(nonce.begin(), nonce.end());
    detail::append_digest(attachment, detail::sha256(payload));
    detail::append_digest(attachment, detail::keyed_hash(query_key_, attachment + detail::asked_message(asked)));
    return attachment;
  }

  // Returns the encoding of a reply without its signature; nothing if the reply is not the service's to this query.
  std::optional<std::string> checked_encoding(std::string_view attachment, bool is_ok, std::string_view signed_encoding,
                                              std::string_view payload) const {
    constexpr std::string_view mark = ";firstfix-v1=";
    constexpr std::size_t digits = 64;
    if (attachment.size() != 104 || signed_encoding.size() < mark.size() + digits) return std::nullopt;
    const std::size_t end = signed_encoding.size() - mark.size() - digits;
    if (signed_encoding.substr(end, mark.size()) != mark) return std::nullopt;
    const std::string_view encoding = signed_encoding.substr(0, end);
    std::string message(attachment.substr(72));
    message.push_back(is_ok ? '\1' : '\0');
    detail::append_counted(message, encoding);
    detail::append_digest(message, detail::sha256(payload));
    std::string right;
    for (const unsigned char byte : detail::keyed_hash(answer_key_, message)) {
      right.push_back("0123456789abcdef"[byte >> 4]);
      right.push_back("0123456789abcdef"[byte & 15]);
    }
    if (CRYPTO_memcmp(right.data(), signed_encoding.data() + end + mark.size(), digits) != 0) return std::nullopt;
    return std::string(encoding);
  }

 private:
  std::string key_id_;
  Digest query_key_{}, answer_key_{};
};

}  // namespace firstfix
