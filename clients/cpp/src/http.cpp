#include "http.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <memory>
#include <random>
#include <thread>

namespace firstfix {
namespace {

constexpr double kConnectTimeoutS = 5.0, kMaxRetryAfterS = 3600.0;
constexpr std::size_t kMaxReplyBytes = 16'000'000;

double uniform(double low, double high) {
  thread_local std::mt19937_64 generator{std::random_device{}()};
  return std::uniform_real_distribution<double>(low, high)(generator);
}

std::size_t on_body(char* data, std::size_t size, std::size_t count, void* reply) {
  std::string& body = static_cast<Reply*>(reply)->body;
  if (body.size() + size * count > kMaxReplyBytes) return 0;  // ends the transfer
  body.append(data, size * count);
  return size * count;
}

std::size_t on_header(char* data, std::size_t size, std::size_t count, void* into) {
  auto& reply = *static_cast<Reply*>(into);
  const std::string line(data, size * count);
  if (line.rfind("HTTP/", 0) == 0) reply.retry_after_s.reset();  // it belonged to an interim answer
  std::string name = line.substr(0, line.find(':'));
  std::transform(name.begin(), name.end(), name.begin(),
                 [](char c) { return static_cast<char>(std::tolower(static_cast<unsigned char>(c))); });
  if (name == "retry-after") {
    char* end = nullptr;
    const char* value = line.c_str() + name.size() + 1;
    const double seconds = std::strtod(value, &end);
    if (end != value && seconds >= 0 && seconds <= kMaxRetryAfterS) reply.retry_after_s = seconds;
  }
  return size * count;
}

bool is_passing(const std::string& code) {
  return code == "overloaded" || code == "rate_limited" || code == "store_unavailable" || code == "worker_lost";
}

std::string checked_url(std::string url) {
  while (!url.empty() && url.back() == '/') url.pop_back();
  const bool has_scheme = url.rfind("http://", 0) == 0 || url.rfind("https://", 0) == 0;
  const auto plain = [](char c) { return c > ' ' && c < 127 && c != '?' && c != '#'; };
  if (!has_scheme || url.find("://") + 3 >= url.size() || !std::all_of(url.begin(), url.end(), plain)) {
    throw Error("invalid_option", "the URL of the service must have the form http://HOST:PORT");
  }
  return url;
}

// The given key, or that of the environment. Error messages do not repeat it.
std::optional<std::string> credential(const std::optional<std::string>& given) {
  const char* found = std::getenv("FIRSTFIX_API_KEY");
  std::string key = given ? *given : std::string(found == nullptr ? "" : found);
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; };
  while (!key.empty() && blank(key.back())) key.pop_back();
  key.erase(key.begin(), std::find_if_not(key.begin(), key.end(), blank));
  if (key.empty()) return std::nullopt;
  if (!std::all_of(key.begin(), key.end(), [](char c) { return c > ' ' && c < 127; })) {
    throw Error("invalid_option", "the API key has invalid characters");
  }
  return key;
}

}  // namespace

Deadline::Deadline(double timeout_s)
    : end_(std::chrono::steady_clock::now() +
           std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(timeout_s))),
      timeout_s_(timeout_s) {}

double Deadline::left_s() const {
  const double left = std::chrono::duration<double>(end_ - std::chrono::steady_clock::now()).count();
  if (left <= 0) throw exceeded();
  return left;
}

bool Deadline::allows(double wait_s) const {
  return std::chrono::steady_clock::now() + std::chrono::duration<double>(wait_s) < end_;
}

Error Deadline::exceeded() const {
  return {"deadline_exceeded", "no answer within " + detail::comma_separated({timeout_s_}) + " s"};
}

Client::Http::Http(const std::string& url, const Settings& settings) : url_(checked_url(url)), settings_(settings) {
  if (!(settings.timeout_s > 0 && settings.timeout_s <= 86'400) || settings.retry.attempts < 1 ||
      !(settings.retry.first_wait_s >= 0 && settings.retry.max_wait_s >= 0)) {
    throw Error("invalid_option", "a timeout or a retry policy is out of range");
  }
  settings_.api_key = credential(settings.api_key);
  static std::once_flag once;
  std::call_once(once, [] { curl_global_init(CURL_GLOBAL_DEFAULT); });
}

Client::Http::~Http() {
  for (CURL* handle : idle_) curl_easy_cleanup(handle);
}

std::string Client::Http::escaped(const std::string& text) {
  static constexpr char kHex[] = "0123456789ABCDEF";
  std::string made;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) != 0 || c == '-' || c == '.' || c == '_' || c == '~') {
      made += c;
    } else {
      made += {'%', kHex[byte >> 4], kHex[byte & 15]};
    }
  }
  return made;
}

CURL* Client::Http::borrow() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (idle_.empty()) {
    CURL* made = curl_easy_init();
    if (made == nullptr) throw std::bad_alloc();
    return made;
  }
  CURL* handle = idle_.back();
  idle_.pop_back();
  return handle;
}

void Client::Http::give_back(CURL* handle) {
  const std::lock_guard<std::mutex> lock(mutex_);
  curl_easy_reset(handle);  // the connection stays
  idle_.push_back(handle);
}

Client::Http::Outcome Client::Http::try_once(const Request& request, double left_s, const Deadline& deadline) {
  std::string url = url_ + "/" + request.path;
  Strings query = request.query;
  const auto named = [](const auto& one) { return one.first == "deadline_ms"; };
  if (request.tell_deadline && std::none_of(query.begin(), query.end(), named)) {
    const double left_ms = std::clamp(std::floor(left_s * 1000), 1.0, 600'000.0);
    query.emplace_back("deadline_ms", detail::comma_separated({left_ms}));
  }
  const char* before = "?";
  for (const auto& [name, value] : query) {
    url += before + escaped(name) + "=" + escaped(value);
    before = "&";
  }
  const std::unique_ptr<CURL, std::function<void(CURL*)>> borrowed(borrow(), [this](CURL* one) { give_back(one); });
  CURL* handle = borrowed.get();
  curl_slist* list = nullptr;
  const auto add = [&list](const std::string& line) { list = curl_slist_append(list, line.c_str()); };
  add("Expect:");  // avoids a round trip before the body
  for (const std::string& line : request.headers) add(line);
  if (settings_.api_key) add("Authorization: Bearer " + *settings_.api_key);
  const std::unique_ptr<curl_slist, decltype(&curl_slist_free_all)> headers(list, &curl_slist_free_all);

  Reply reply;
  const auto left_ms = static_cast<long>(std::max(1.0, std::floor(left_s * 1000)));
  curl_easy_setopt(handle, CURLOPT_URL, url.c_str());
  curl_easy_setopt(handle, CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(handle, CURLOPT_FOLLOWLOCATION, 0L);
  curl_easy_setopt(handle, CURLOPT_TIMEOUT_MS, left_ms);
  curl_easy_setopt(handle, CURLOPT_CONNECTTIMEOUT_MS, std::min(left_ms, static_cast<long>(kConnectTimeoutS * 1000)));
  curl_easy_setopt(handle, CURLOPT_HTTPHEADER, headers.get());
  curl_easy_setopt(handle, CURLOPT_WRITEFUNCTION, &on_body);
  curl_easy_setopt(handle, CURLOPT_WRITEDATA, &reply);
  curl_easy_setopt(handle, CURLOPT_HEADERFUNCTION, &on_header);
  curl_easy_setopt(handle, CURLOPT_HEADERDATA, &reply);
  if (!settings_.ca_file.empty()) curl_easy_setopt(handle, CURLOPT_CAINFO, settings_.ca_file.c_str());
  if (request.body != nullptr) {
    curl_easy_setopt(handle, CURLOPT_POST, 1L);
    curl_easy_setopt(handle, CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(request.body->size()));
    curl_easy_setopt(handle, CURLOPT_POSTFIELDS, reinterpret_cast<const char*>(request.body->data()));
  }
  const CURLcode code = curl_easy_perform(handle);
  if (code != CURLE_OK) {
    double connect_s = 0;
    curl_easy_getinfo(handle, CURLINFO_PRETRANSFER_TIME, &connect_s);
    // If the connection was not made, another attempt may succeed: the deadline decides.
    if (code == CURLE_OPERATION_TIMEDOUT && connect_s > 0) return {std::nullopt, deadline.exceeded(), false};
    const bool hopeless = code == CURLE_PEER_FAILED_VERIFICATION || code == CURLE_SSL_CACERT_BADFILE ||
                          code == CURLE_URL_MALFORMAT || code == CURLE_WRITE_ERROR;
    const char* kind = code == CURLE_WRITE_ERROR ? "unreadable" : "unreachable";
    return {std::nullopt, Error(kind, "no answer from " + url_ + ": " + curl_easy_strerror(code)), !hopeless};
  }
  curl_easy_getinfo(handle, CURLINFO_RESPONSE_CODE, &reply.status);
  char* media_type = nullptr;
  curl_easy_getinfo(handle, CURLINFO_CONTENT_TYPE, &media_type);
  if (media_type != nullptr) reply.media_type = media_type;
  if (reply.status >= 200 && reply.status < 300) return {std::move(reply), std::nullopt, false};
  std::optional<Error> problem = parse_problem(reply.body, reply.status);
  // 502 and 504 without a problem document come from a proxy that lost its upstream.
  const bool again = problem ? is_passing(problem->code()) : reply.status == 502 || reply.status == 504;
  if (!problem) problem = Error("unreadable", url_ + " answered " + std::to_string(reply.status));
  return {std::move(reply), std::move(problem), again};
}

Reply Client::Http::send(const Request& request, const Deadline& deadline) {
  for (int attempt = 1;; ++attempt) {
    Outcome outcome = try_once(request, deadline.left_s(), deadline);
    if (!outcome.failure) return std::move(*outcome.reply);
    // Random over the whole interval, so that a fleet does not retry at the same time.
    const double longest = settings_.retry.first_wait_s * std::exp2(attempt - 1);
    double wait_s = uniform(0, std::min(settings_.retry.max_wait_s, longest));
    if (outcome.reply && outcome.reply->retry_after_s) wait_s = *outcome.reply->retry_after_s * uniform(1.0, 1.25);
    if (!outcome.again || attempt >= settings_.retry.attempts || !deadline.allows(wait_s)) throw *outcome.failure;
    std::this_thread::sleep_for(std::chrono::duration<double>(wait_s));
  }
}

}  // namespace firstfix
