// SPDX-License-Identifier: Apache-2.0
#include "cli/http/server.h"

#include <httplib.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <mutex>
#include <random>
#include <thread>

#include "cli/common.h"
#include "cli/http/byte_range.h"
#include "cli/http/entity_tag.h"
#include "cli/http/folder.h"
#include "cli/http/player.h"
#include "cli/text/escape.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

constexpr size_t kThreads = 32;  // connections: browsers keep six open
constexpr size_t kPiece = size_t{16} << 10;
constexpr const char* kHost = Server::kAddress;
constexpr const char* kPlaylist = ".m3u8";  // behind the name of a file

std::string random_token() {
  std::random_device device;
  std::string token;
  for (int k = 0; k < 4; ++k) token += format("%08x", device());
  return token;
}

// All answers share one line of a given speed.
class Line {
 public:
  Line(double megabits, uint32_t delay_ms) : megabits_(megabits), delay_(delay_ms) {}
  void begin() const { std::this_thread::sleep_for(delay_); }
  // Waits until n more bytes have passed.
  void pass(size_t n) {
    if (!(megabits_ > 0)) return;
    const std::chrono::duration<double> takes(8.0 * static_cast<double>(n) / (megabits_ * 1e6));
    Clock::time_point until;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      free_ = std::max(free_, Clock::now()) + std::chrono::duration_cast<Clock::duration>(takes);
      until = free_;
    }
    std::this_thread::sleep_until(until);
  }

 private:
  using Clock = std::chrono::steady_clock;
  const double megabits_;
  const std::chrono::milliseconds delay_;
  std::mutex mutex_;
  Clock::time_point free_;
};

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

const char* type_of(const std::string& name) {
  return ends_with(name, ".html")   ? "text/html; charset=utf-8"
         : ends_with(name, ".js")   ? "text/javascript"
         : ends_with(name, ".wasm") ? "application/wasm"
         : ends_with(name, ".l4d")  ? "model/l4d"
         : ends_with(name, ".m3u8") ? "application/vnd.apple.mpegurl"
                                    : "application/octet-stream";
}

void replace(std::string& text, const std::string& what, const std::string& with) {
  const size_t at = text.find(what);
  if (at != std::string::npos) text.replace(at, what.size(), with);
}

const PlayerFile* player_file(const std::string& name) {
  for (const PlayerFile& file : player_files()) {
    if (name == file.name) return &file;
  }
  return nullptr;
}

std::string content_of(const PlayerFile& file) {
  return std::string(reinterpret_cast<const char*>(file.data), file.size);
}

}  // namespace

struct Server::Parts {
  ServerOptions options;
  Folder folder;
  httplib::Server http;
  Line line;
  int port = 0;
  std::string root;  // "/TOKEN/"
  std::string url;
  std::atomic<uint64_t> requests{0}, bytes{0};

  explicit Parts(const ServerOptions& given)
      : options(given),
        folder(given.folder),
        line(given.megabits, given.delay_ms),
        root("/" + random_token() + "/") {
    http.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
    http.set_keep_alive_max_count(1u << 30);
    http.set_payload_max_length(0);
    http.set_tcp_nodelay(true);
    // The library's default lets another program listen at the same port.
    http.set_socket_options([](socket_t socket) {
      const int yes = 1;
      ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    });
    http.set_default_headers({{"X-Content-Type-Options", "nosniff"},
                              {"Referrer-Policy", "no-referrer"},
                              {"Cross-Origin-Resource-Policy", "same-origin"},
                              {"Cache-Control", "no-cache"}});
    http.set_pre_routing_handler(
        [this](const httplib::Request& request, httplib::Response& response) {
          answer_alone(request, response);
          return httplib::Server::HandlerResponse::Handled;
        });
    // The library refuses a Range that it does not understand before it asks anybody.
    const httplib::Server::HandlerWithResponse again = [this](const httplib::Request& request,
                                                              httplib::Response& response) {
      if (response.status != 416 || response.has_header("Content-Range")) {
        return httplib::Server::HandlerResponse::Unhandled;
      }
      response.status = 200;
      answer_alone(request, response);
      return httplib::Server::HandlerResponse::Handled;
    };
    http.set_error_handler(again);
  }

  // Without the library's own ranges, which know neither If-Range nor 416.
  void answer_alone(const httplib::Request& request, httplib::Response& response) {
    const_cast<httplib::Request&>(request).ranges.clear();
    answer(request, response);
  }

  void refuse(httplib::Response& response, int status, const char* why) const {
    response.status = status;
    response.set_content(std::string(why) + "\n", "text/plain");
  }

  void answer(const httplib::Request& request, httplib::Response& response) {
    ++requests;
    const std::string host = request.get_header_value("Host");
    const std::string number = ":" + std::to_string(port);
    if (host != kHost + number && host != "localhost" + number) {
      return refuse(response, 403, "another host");
    }
    if (request.method != "GET" && request.method != "HEAD") {
      response.set_header("Allow", "GET, HEAD");
      return refuse(response, 405, "GET and HEAD alone");
    }
    if (request.path.compare(0, root.size(), root) != 0) return refuse(response, 404, "not found");
    line.begin();
    const std::string name = request.path.substr(root.size());
    const std::string play = "play/", files = "player/";
    if (name.empty() && !options.file.empty()) return page(options.file, response);
    if (name.compare(0, play.size(), play) == 0) return page(name.substr(play.size()), response);
    if (name.compare(0, files.size(), files) == 0) {
      const PlayerFile* file = player_file(name.substr(files.size()));
      if (file == nullptr) return refuse(response, 404, "not found");
      return response.set_content(content_of(*file), type_of(file->name));
    }
    if (name.empty()) return list(name, response);
    if (options.file.empty() && name.back() == '/' && name.size() > 1) {
      return list(name.substr(0, name.size() - 1), response);
    }
    send(name, request, response);
  }

  bool is_served(const std::string& name) const {
    return options.file.empty() || name == options.file;
  }

  // "" where the file plays without one.
  std::string playlist_of(const std::string& name) const {
    const std::string path = is_served(name) ? folder.path_of(name) : "";
    if (path.empty() || !options.playlist) return "";
    return options.playlist(path, percent_encoded(name.substr(name.rfind('/') + 1)));
  }

  // Whether the name is that of a file and this ending, and the file has a playlist.
  bool send_playlist(const std::string& name, httplib::Response& response) const {
    if (!ends_with(name, kPlaylist)) return false;
    const std::string text = playlist_of(name.substr(0, name.size() - std::strlen(kPlaylist)));
    if (text.empty()) return false;
    response.set_content(text, type_of(name));
    return true;
  }

  void list(const std::string& name, httplib::Response& response) const {
    if (!folder.has_folder(name)) return refuse(response, 404, "not found");
    std::string text =
        "<!doctype html><html lang=en><meta charset=utf-8><title>l4dcodec</title>"
        "<link rel=icon href=\"data:,\"><ul>\n";
    for (const Folder::Entry& entry : folder.list(name)) {
      // Paths of these names are the server's own.
      if (name.empty() && (entry.name == "play" || entry.name == "player")) continue;
      const std::string to = name.empty() ? entry.name : name + "/" + entry.name;
      const char* before = entry.is_folder || player_files().empty() ? "" : "play/";
      const char* after = entry.is_folder ? "/" : "";
      text += "<li><a href=\"" + root + before + percent_encoded(to) + after + "\">" +
              marked_up(entry.name) + after + "</a>\n";
    }
    response.set_content(text + "</ul></html>\n", type_of(".html"));
  }

  void page(const std::string& name, httplib::Response& response) const {
    const PlayerFile* file = player_file("index.html");
    if (file == nullptr || !is_served(name) || !folder.has_file(name)) {
      return refuse(response, 404, "not found");
    }
    std::string text = content_of(*file);
    const std::string source = percent_encoded(name) + (playlist_of(name).empty() ? "" : kPlaylist);
    replace(text, "src=\"scene.l4d\"", "src=\"" + root + source + "\"");
    replace(text, "src=\"player.js\"", "src=\"" + root + "player/player.js\"");
    response.set_header(
        "Content-Security-Policy",
        "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; "
        "connect-src 'self' data:; img-src 'self' data:; style-src 'unsafe-inline'; "
        "base-uri 'none'; frame-ancestors 'none'");
    response.set_content(text, type_of(".html"));
  }

  void send(const std::string& name, const httplib::Request& request, httplib::Response& response) {
    const std::shared_ptr<ServedFile> file = is_served(name) ? folder.open(name) : nullptr;
    if (file == nullptr) {
      if (send_playlist(name, response)) return;
      if (options.file.empty() && folder.has_folder(name)) {
        response.set_redirect(root + percent_encoded(name) + "/", 301);
        return;
      }
      return refuse(response, 404, "not found");
    }
    const std::string size = std::to_string(file->size);
    response.set_header("Accept-Ranges", "bytes");
    response.set_header("ETag", file->tag);
    if (request.has_header("If-Match") &&
        !names_tag(request.get_header_value("If-Match"), file->tag, false)) {
      return refuse(response, 412, "another file");
    }
    if (names_tag(request.get_header_value("If-None-Match"), file->tag, true)) {
      response.status = 304;
      response.set_header("Content-Length", size);  // that of the answer with the file
      return;
    }
    const std::string condition = request.get_header_value("If-Range");
    const bool wants_part =
        request.method == "GET" && (condition.empty() || condition == file->tag);
    ByteRange range =
        parse_byte_range(wants_part ? request.get_header_value("Range") : "", file->size);
    if (range.kind == ByteRange::kUnsatisfiable) {
      response.set_header("Content-Range", "bytes */" + size);
      return refuse(response, 416, "no such range");
    }
    response.status = 200;
    if (range.kind == ByteRange::kPart) {
      response.status = 206;
      response.set_header("Content-Range", "bytes " + std::to_string(range.begin) + "-" +
                                               std::to_string(range.end - 1) + "/" + size);
    } else {
      range.end = file->size;
    }
    if (range.end == range.begin) return response.set_content("", type_of(name));
    response.set_content_provider(
        range.end - range.begin, type_of(name),
        [this, file, range](size_t offset, size_t left, httplib::DataSink& sink) {
          char piece[kPiece];
          const ssize_t n = ::pread(file->fd, piece, std::min(left, kPiece),
                                    static_cast<off_t>(range.begin + offset));
          if (n <= 0) return false;
          line.pass(static_cast<size_t>(n));
          bytes += static_cast<uint64_t>(n);
          return sink.write(piece, static_cast<size_t>(n));
        });
  }
};

Server::Server(const ServerOptions& options) : parts_(std::make_unique<Parts>(options)) {
  Parts& p = *parts_;
  p.port = options.port;
  if (options.port == 0) {
    p.port = p.http.bind_to_any_port(kHost);
  } else if (!p.http.bind_to_port(kHost, options.port)) {
    p.port = -1;
  }
  if (p.port < 0) {
    throw Failure(L4D_ERR_IO, format("port %d of %s cannot be had", options.port, kHost));
  }
  p.url = format("http://%s:%d%s", kHost, p.port, p.root.c_str());
}

Server::~Server() = default;

const std::string& Server::url() const { return parts_->url; }

int Server::port() const { return parts_->port; }

ServerCounts Server::run(const std::function<bool()>& stopped) {
  httplib::Server& http = parts_->http;
  std::thread listener([&] { http.listen_after_bind(); });
  while (!stopped()) std::this_thread::sleep_for(std::chrono::milliseconds(100));
  while (!http.is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  http.stop();
  listener.join();
  return {parts_->requests, parts_->bytes};
}

}  // namespace l4d::cli
