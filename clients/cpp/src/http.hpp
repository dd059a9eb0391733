// HTTP with retries inside one deadline, and the service's problems as errors.
#pragma once

#include <curl/curl.h>

#include <chrono>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "firstfix/client.hpp"

namespace firstfix {

// A point in time that every try and every wait of one call shares.
class Deadline {
 public:
  explicit Deadline(double timeout_s);
  double left_s() const;  // throws "deadline_exceeded" where nothing is
  bool allows(double wait_s) const;
  Error exceeded() const;

 private:
  std::chrono::steady_clock::time_point end_;
  double timeout_s_;
};

struct Request {
  std::string path;  // its segments escaped
  Strings query;     // not escaped
  std::vector<std::string> headers;
  const Bytes* body = nullptr;  // none: GET
  bool tell_deadline = false;   // as the option deadline_ms, what is left of it
};

struct Reply {
  long status = 0;
  std::string body, media_type;
  std::optional<double> retry_after_s;
};

// Every request of it changes nothing at the service, so it may always be sent again. Thread-safe.
class Client::Http {
 public:
  Http(const std::string& url, const Settings& settings);
  ~Http();
  Http(const Http&) = delete;
  Http& operator=(const Http&) = delete;

  // A successful answer.
  Reply send(const Request& request, const Deadline& deadline);

  static std::string escaped(const std::string& text);

 private:
  struct Outcome {
    std::optional<Reply> reply;    // none: nobody answered
    std::optional<Error> failure;  // none: it succeeded
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
