// SPDX-License-Identifier: Apache-2.0
#include "cli/http/peer.h"

#include <unistd.h>

#include <fstream>
#include <sstream>
#include <string>

#include "cli/text/units.h"

namespace l4d::cli {
namespace {

constexpr const char* kLists[] = {"/proc/net/tcp", "/proc/net/tcp6"};

// Addresses of the lists, of both families, end in the four bytes of IPv4.
bool is_end(const std::string& address, int port) {
  const std::string end = format("0100007F:%04X", static_cast<unsigned>(port));
  return address.size() >= end.size() &&
         address.compare(address.size() - end.size(), end.size(), end) == 0;
}

}  // namespace

bool tells_users() { return ::access(kLists[0], R_OK) == 0; }

bool is_own_user(int peer_port, int own_port) {
  for (const char* list : kLists) {
    std::ifstream lines(list);
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line);
      std::string number, from, to, state, queues, timer, retransmits;
      unsigned long user = 0;
      if (!(words >> number >> from >> to >> state >> queues >> timer >> retransmits >> user)) {
        continue;
      }
      if (is_end(from, peer_port) && is_end(to, own_port)) return user == ::geteuid();
    }
  }
  return false;
}

}  // namespace l4d::cli
