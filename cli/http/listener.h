// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "cli/http/message.h"

namespace l4d::cli {

// HTTP/1.1 at a port of 127.0.0.1, within limits that hold before a request is looked at: those of
// Connections; kRequestBytes; kHeaderLines. Requests with a body are refused, and what breaks the
// grammar of HTTP; these connections end.
class Listener {
 public:
  static constexpr const char* kAddress = "127.0.0.1";
  static constexpr size_t kRequestBytes = size_t{32} << 10;  // what is kept of a connection
  static constexpr size_t kHeaderLines = 100;

  // port: 0 = any. Throws a Failure where it is taken. Clients can connect from now on, and wait.
  explicit Listener(int port);
  ~Listener();
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;

  int port() const { return port_; }
  // Called by several threads, one for each connection; what it throws is answered with 500.
  using Handler = std::function<HttpAnswer(const HttpRequest&)>;
  // Answers until stopped() says so, which is called ten times a second. Then calls before_end(),
  // which ends all waiting of handlers and bodies, and cuts all connections. Throws a Failure where
  // the system has no threads.
  void run(const Handler& handler, const std::function<bool()>& stopped,
           const std::function<void()>& before_end);

 private:
  int socket_ = -1;
  int port_ = 0;
};

}  // namespace l4d::cli
