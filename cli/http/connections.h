// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <list>
#include <mutex>

namespace l4d::cli {

// The open connections of a server, and how long each may keep it waiting. Clients on one machine
// can take any address of it, so what tells them apart is whether they have shown the token:
// strangers have fewer connections and less time. Where there are too many, the one that keeps the
// server waiting for longest makes room, and strangers do before others.
// For any thread. To end a connection is to shut its socket down: the thread that reads or writes
// it notices, and then calls end().
class Connections {
 public:
  static constexpr size_t kMost = 192;          // in all; browsers keep six open
  static constexpr size_t kMostStrangers = 64;  // of these
  using Seconds = std::chrono::seconds;
  // From the begin of the connection, or the end of the last answer, to a whole request.
  static constexpr Seconds kStranger{10};
  static constexpr Seconds kIdle{60};    // likewise, of clients that have shown the token
  static constexpr Seconds kTaking{60};  // to take a piece of an answer, of at most 16 KiB
  using Clock = std::chrono::steady_clock;

  class One {
   public:
    explicit One(int socket) : socket_(socket) {}

   private:
    friend class Connections;
    enum class Waits { kForRequest, kForTaking, kNo };  // what the server waits for
    const int socket_;
    bool known_ = false, ending_ = false;
    Waits waits_ = Waits::kForRequest;
    Clock::time_point since_ = Clock::now();
    std::list<One>::iterator place_;
  };

  // A connection has come. The result lives until end().
  One* begin(int socket);
  void end(One* one);
  void set_known(One* one);
  // The client is to send a request, to take bytes, or to wait for the server.
  void wait_for_request(One* one) { set(one, One::Waits::kForRequest); }
  void wait_for_taking(One* one) { set(one, One::Waits::kForTaking); }
  void work(One* one) { set(one, One::Waits::kNo); }
  // Ends those whose time is over; to be called several times a second.
  void end_late();

 private:
  void set(One* one, One::Waits waits);
  void make_room(One& newest);
  One* longest_waiting(bool of_strangers);
  static void shut_down(One& one);

  std::mutex mutex_;
  std::list<One> all_;
};

}  // namespace l4d::cli
