// HTTP with retries within one deadline. Problem documents become errors.
#pragma once

#include <curl/curl.h>

#include <chrono>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "firstfix/client.hpp"

namespace firstfix {

// The end of a call, shared by all its attempts and waits.
class Deadline {
 public:
  explicit Deadline(double timeout_s);
  double left_s() const;  // throws "deadline_exceeded" if no time is left
  bool allows(double wait_s) const;
  Error exceeded() const;

 private:
  std::chrono::steady_clock::time_point end_;
  double timeout_s_;
};

struct Request {
  std::string path;  // its segments are escaped
  Strings query;     // not escaped
  std::vector<std::string> headers;
  const Bytes* body = nullptr;  // null: a GET request
  bool tell_deadline = false;   // send the remaining time as the option deadline_ms
};

struct Reply {
  long status = 0;
  std::string body, media_type;
  std::optional<double> retry_after_s;
};

// Sends requests. No request changes anything at the service, so it can be sent again. Thread-safe.
class Client::Http {
 public:
  Http(const std::string& url, const Settings& settings);
  ~Http();
  Http(const Http&) = delete;
  Http& operator=(const Http&) = delete;

  // Returns a successful answer; throws otherwise.
  Reply send(const Request& request, const Deadline& deadline);

  static std::string escaped(const std::string& text);

 private:
  struct Outcome {
    std::optional<Reply> reply;    // absent: no answer
    std::optional<Error> failure;  // absent: success
    bool again = false;
  };

  CURL* borrow();
  void give_back(CURL* handle);
  Outcome try_once(const Request& request, double left_s, const Deadline& deadline);

  std::string url_;
  Settings settings_;
  std::mutex mutex_;
  std::vector<CURL*> idle_;
};

}  // namespace firstfix
