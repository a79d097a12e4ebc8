// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <strings.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "cli/http/file_body.h"

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

struct HttpAnswer {
  int status = 200;
  HttpHeaders headers;
  std::string text;
  std::unique_ptr<FileBody> body;  // in place of `text`
  bool is_known = false;           // the client has shown that it may ask
  bool closes = false;             // the connection ends with it
};

}  // namespace l4d::cli
