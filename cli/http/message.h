// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <strings.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace l4d::cli {

using HttpHeaders = std::vector<std::pair<std::string, std::string>>;

struct HttpRequest {
  std::string method;
  std::string path;  // as it came, without what follows "?"
  HttpHeaders headers;
  int peer_port = 0;

  size_t count(const char* name) const {
    size_t n = 0;
    for (const auto& [key, value] : headers) n += ::strcasecmp(key.c_str(), name) == 0;
    return n;
  }
  // Of several of a name the first, "" where there is none.
  std::string header(const char* name) const {
    for (const auto& [key, value] : headers) {
      if (::strcasecmp(key.c_str(), name) == 0) return value;
    }
    return "";
  }
};

// What follows the headers of an answer, where it is not a short text.
class HttpBody {
 public:
  virtual ~HttpBody() = default;
  virtual uint64_t size() const = 0;
  // The next bytes, at most n: how many, or 0 to cut the connection. Called by one thread at a
  // time, until size() bytes have come.
  virtual size_t read(char* to, size_t n) = 0;
};

struct HttpAnswer {
  int status = 200;
  HttpHeaders headers;
  std::string text;
  std::unique_ptr<HttpBody> body;  // in place of `text`
  bool is_known = false;           // the client has shown that it may ask
  bool closes = false;             // the connection ends with it
};

}  // namespace l4d::cli
