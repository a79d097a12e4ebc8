// SPDX-License-Identifier: Apache-2.0
// A player over l4d.hpp and sockets, as player_http.c is: it plays a stream, or the streams of a
// playlist (.m3u8), from an HTTP server, on one thread. POSIX; HTTP/1.1 without TLS, redirects and
// kept connections, which libraries of HTTP have.
//
//   player_http http://HOST[:PORT]/PATH/scene.l4d [SECONDS]
//   c++ -std=c++17 player_http.cc $(pkg-config --cflags --libs l4dcodec)
#include <fcntl.h>
#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "l4d/playback.hpp"

namespace {

constexpr double kFrameSeconds = 1.0 / 30;

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// The parts of an http:// URL; no host: it is none.
struct Url {
  std::string host, port = "80", path;

  explicit Url(const std::string& text) {
    const std::string scheme = "http://";
    const size_t slash = text.find('/', scheme.size());
    if (text.compare(0, scheme.size(), scheme) != 0 || slash == std::string::npos) return;
    host = text.substr(scheme.size(), slash - scheme.size());
    path = text.substr(slash);
    if (const size_t colon = host.find(':'); colon != std::string::npos) {
      port = host.substr(colon + 1);
      host.resize(colon);
    }
  }
};

// What a URI of the playlist means: a URL, or a path from the server or from the playlist.
std::string resolve(const std::string& base, const std::string& uri) {
  if (uri.find("://") != std::string::npos) return uri;
  const size_t kept = uri.front() == '/' ? base.find('/', 7) : base.rfind('/') + 1;
  return base.substr(0, kept) + uri;
}

// A request that is under way, on a connection of its own.
class Connection {
 public:
  // Sends GET with these header lines. Looking up a name takes as long as it takes: other players
  // do it on another thread.
  Connection(const Url& url, const std::string& lines)
      : text_("GET " + url.path + " HTTP/1.1\r\nHost: " + url.host + ":" + url.port + "\r\n" +
              lines + "Connection: close\r\n\r\n") {
    addrinfo hints{}, *found = nullptr;
    hints.ai_socktype = SOCK_STREAM;
    if (getaddrinfo(url.host.c_str(), url.port.c_str(), &hints, &found) != 0) return;
    fd_ = socket(found->ai_family, found->ai_socktype, found->ai_protocol);
    fcntl(fd_, F_SETFL, fcntl(fd_, F_GETFL) | O_NONBLOCK);
    is_open_ = connect(fd_, found->ai_addr, found->ai_addrlen) == 0 || errno == EINPROGRESS;
    freeaddrinfo(found);
  }
  ~Connection() {
    if (fd_ >= 0) close(fd_);
  }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  bool is_open() const { return is_open_; }
  bool has_head() const { return has_head_; }
  pollfd wanted() const {
    return {fd_, static_cast<short>(sent_ < text_.size() ? POLLOUT : POLLIN), 0};
  }

  // Sends and receives what the socket takes and has. False once the request has ended.
  bool pump(const std::function<void(const l4d_answer&)>& answered,
            const std::function<void(const char*, size_t)>& received) {
    while (sent_ < text_.size()) {
      const ssize_t n = send(fd_, text_.data() + sent_, text_.size() - sent_, 0);
      if (n < 0) return errno == EAGAIN || errno == ENOTCONN;
      sent_ += static_cast<size_t>(n);
    }
    std::vector<char> bytes(65536);
    for (;;) {
      const ssize_t n = recv(fd_, bytes.data(), bytes.size(), 0);
      if (n < 0 && (errno == EAGAIN || errno == EINTR)) return true;
      if (n <= 0) return false;
      if (has_head_) {
        received(bytes.data(), static_cast<size_t>(n));
        continue;
      }
      head_.append(bytes.data(), static_cast<size_t>(n));
      const size_t end = head_.find("\r\n\r\n");
      if (end == std::string::npos && head_.size() > 8192) return false;
      if (end == std::string::npos) continue;
      has_head_ = true;
      const std::string body = head_.substr(end + 4);
      head_.resize(end + 2);
      answered(answer());
      received(body.data(), body.size());
    }
  }

 private:
  // The value of a header; "": there is none.
  std::string header(const std::string& name) const {
    std::string lower = head_;
    std::transform(lower.begin(), lower.end(), lower.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    const size_t at = lower.find("\r\n" + name + ":");
    if (at == std::string::npos) return "";
    const size_t begin = head_.find_first_not_of(" \t", at + name.size() + 3);
    return head_.substr(begin, head_.find("\r\n", begin) - begin);
  }
  l4d_answer answer() const {
    l4d_answer a = L4D_INIT(l4d_answer);
    const auto number = [](const std::string& text, size_t at) {
      return at < text.size() ? std::strtoull(text.c_str() + at, nullptr, 10) : 0;
    };
    a.status = static_cast<uint32_t>(number(head_, head_.find(' ')));
    const std::string range = header("content-range"), tag = header("etag");
    a.offset = number(range, range.find_first_of("0123456789*"));
    if (!range.empty()) a.total_bytes = number(range, range.find('/') + 1);
    if (a.status == 200) a.total_bytes = number(header("content-length"), 0);
    if (!tag.empty()) a.version = std::hash<std::string>()(tag) | 1;
    a.retry_after = std::atof(header("retry-after").c_str());
    return a;
  }

  std::string text_, head_;
  size_t sent_ = 0;
  int fd_ = -1;
  bool is_open_ = false, has_head_ = false;
};

class Player {
 public:
  explicit Player(std::string url) : url_(std::move(url)) {}

  // Returns whether the stream could be played.
  bool play(double seconds) {
    const double begun = now();
    const bool is_list = url_.size() > 5 && url_.compare(url_.size() - 5, 5, ".m3u8") == 0;
    is_list ? engine_.open_playlist(begun, url_) : engine_.open(begun, url_);
    engine_.play(begun);
    l4d_playback_state state{};
    for (double due = begun, said = begun; now() < begun + seconds;) {
      for (const l4d_playback_item& item : engine_.update(now())) obey(item);
      state = engine_.state();
      if (state.stream == L4D_STREAM_FAILED || state.motion == L4D_MOTION_ENDED) break;
      if (now() >= due) {
        due = now() + kFrameSeconds;
        if (state.ready != 0) show(state, &said);
      }
      wait(std::min(state.wake_at, due));
    }
    if (state.stream == L4D_STREAM_FAILED) {
      std::fprintf(stderr, "player_http: the stream cannot be played: %s\n",
                   l4d_playback_cause_name(state.cause));
      return false;
    }
    std::printf("shown for %.1f s, of which %.1f s waiting, %llu requests\n",
                state.end - state.begin, state.waited_seconds,
                static_cast<unsigned long long>(state.requests));
    return true;
  }

 private:
  void obey(const l4d_playback_item& item) {
    if (item.kind == L4D_ITEM_REQUEST) start(item);
    if (item.kind == L4D_ITEM_CANCEL) connections_.erase(item.id);
    if (item.kind != L4D_ITEM_EVENT || item.event != L4D_EVENT_RETRY) return;
    std::fprintf(stderr, "again in %.2f s: %s\n", item.value, l4d_playback_cause_name(item.cause));
  }

  void start(const l4d_playback_item& item) {
    const Url url(item.source == 0 ? url_ : resolve(url_, engine_.uri(item.source)));
    if (url.host.empty()) return engine_.finished(now(), item.id, L4D_TRANSFER_FORBIDDEN);
    std::string lines;
    if ((item.flags & (L4D_REQUEST_WHOLE | L4D_REQUEST_PLAYLIST)) == 0) {
      lines = "Range: bytes=" + std::to_string(item.offset) + "-";
      if (item.size > 0) lines += std::to_string(item.offset + item.size - 1);
      lines += "\r\n";
    }
    if ((item.flags & (L4D_REQUEST_FRESH | L4D_REQUEST_PLAYLIST)) != 0) {
      lines += "Cache-Control: no-cache\r\n";
    }
    if (!connections_.try_emplace(item.id, url, lines).first->second.is_open()) {
      connections_.erase(item.id);
      engine_.finished(now(), item.id, L4D_TRANSFER_FAILED);
    }
  }

  // The picture of this moment. A real player takes more than positions, and draws.
  void show(const l4d_playback_state& state, double* said) {
    const double time = std::clamp(state.anchor_time + (now() - state.anchor_now) * state.velocity,
                                   state.ready_from, state.ready_until);
    const size_t count = engine_.slice(time).count();
    if (now() < *said) return;
    std::printf("%.2f s: %zu Gaussians, rung %u of %u, %llu bytes\n", time, count, state.rung + 1,
                state.num_rungs, static_cast<unsigned long long>(state.received_bytes));
    std::fflush(stdout);
    *said = now() + 1;
  }

  // Waits until a socket has something, but not beyond `until`.
  void wait(double until) {
    std::vector<pollfd> fds;
    std::vector<uint32_t> ids;
    for (const auto& [id, connection] : connections_) {
      fds.push_back(connection.wanted());
      ids.push_back(id);
    }
    const double left = std::clamp(until - now(), 0.0, 1.0);
    if (poll(fds.data(), fds.size(), static_cast<int>(1000 * left) + 1) <= 0) return;
    for (size_t i = 0; i < fds.size(); ++i) {
      if (fds[i].revents == 0) continue;
      const uint32_t id = ids[i];
      Connection& connection = connections_.at(id);
      const bool goes_on = connection.pump(
          [&](const l4d_answer& a) { engine_.answered(now(), id, a); },
          [&](const char* bytes, size_t n) { engine_.received(now(), id, bytes, n); });
      if (goes_on) continue;
      engine_.finished(now(), id, connection.has_head() ? L4D_TRANSFER_ENDED : L4D_TRANSFER_FAILED);
      connections_.erase(id);
    }
  }

  std::string url_;
  l4d::PlaybackHandle engine_;
  std::map<uint32_t, Connection> connections_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2 || Url(argv[1]).host.empty()) {
    std::fprintf(stderr, "usage: player_http http://HOST[:PORT]/PATH [SECONDS]\n");
    return 2;
  }
  std::signal(SIGPIPE, SIG_IGN);  // a server that hangs up is no reason to end
  try {
    return Player(argv[1]).play(argc > 2 ? std::atof(argv[2]) : 1e9) ? 0 : 1;
  } catch (const l4d::Error& error) {
    std::fprintf(stderr, "player_http: %s\n", error.what());
    return 1;
  }
}
