// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "cli/http/picture_request.h"

namespace l4d::cli {

struct ServerOptions {
  std::string folder;  // what lies in it is served, nothing outside, and no name with a leading dot
  std::string file;    // the only name that is served of it; "" = every one
  // The playlist of a file of several streams, in which it has this URL; "" of a file that plays
  // without. Called by several threads, each time that one is asked for: the file may grow.
  std::function<std::string(const std::string& path, const std::string& url)> playlist;
  Pictures pictures;      // without `draw`: the player plays
  int port = 0;           // 0 = any
  double megabits = 0;    // a second, of all answers together; 0 = no limit
  uint32_t delay_ms = 0;  // before each answer
};

struct ServerCounts {
  uint64_t requests = 0;
  uint64_t bytes = 0;  // of files
};

// An HTTP/1.1 server (Listener) on 127.0.0.1, for people at this machine: its paths begin with a
// random token, and requests that name another host are refused, so that pages of others cannot
// read from it. GET and HEAD; single ranges and conditions on the ETag.
//   /TOKEN/            the page of `file`, or the streams and folders of `folder`
//   /TOKEN/NAME        a file; /TOKEN/NAME/: what is in a folder below
//   /TOKEN/NAME.m3u8   of a file NAME of several streams: its playlist, where no such file is
//   /TOKEN/.play/NAME  a page that plays it, in builds with the player
//   /TOKEN/.picture/.. what a page of pictures takes, where this process draws
// The landing, an address of its own, leads to /TOKEN/: once, and only programs of the user of this
// process. Who reads it in a list of processes has nothing.
class Server {
 public:
  // Throws a Failure where the port is taken.
  explicit Server(const ServerOptions& options);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  const std::string& url() const;          // "http://127.0.0.1:PORT/TOKEN/"
  const std::string& landing_url() const;  // "http://127.0.0.1:PORT/LANDING"
  int port() const;
  // Serves until stopped() says so, which is called ten times a second. To be called once.
  ServerCounts run(const std::function<bool()>& stopped);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace l4d::cli
