// SPDX-License-Identifier: Apache-2.0
#include "cli/http/server.h"

#include <fcntl.h>
#include <httplib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <mutex>
#include <random>
#include <thread>

#include "cli/common.h"
#include "cli/http/byte_range.h"
#include "cli/http/player.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

constexpr size_t kThreads = 32;  // connections: browsers keep six open
constexpr size_t kPiece = size_t{16} << 10;
constexpr const char* kHost = "127.0.0.1";

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

// An open file that ends with the answer.
struct File {
  int fd = -1;
  uint64_t size = 0;
  std::string tag;
  ~File() {
    if (fd >= 0) ::close(fd);
  }
};

// A name of one segment or more, each with a first character that is no dot.
bool is_plain(const std::string& name) {
  if (name.empty() || name.find_first_of(std::string("\\\0", 2)) != std::string::npos) return false;
  for (size_t at = 0; at != std::string::npos;) {
    const size_t end = name.find('/', at);
    const std::string segment = name.substr(at, end == std::string::npos ? end : end - at);
    if (segment.empty() || segment[0] == '.') return false;
    at = end == std::string::npos ? end : end + 1;
  }
  return true;
}

std::shared_ptr<File> open_file(const std::filesystem::path& folder, const std::string& name) {
  std::error_code error;
  const std::filesystem::path path = std::filesystem::canonical(folder / name, error);
  if (error) return nullptr;
  // Links may lead out of the folder.
  const auto [rest, unused] = std::mismatch(folder.begin(), folder.end(), path.begin(), path.end());
  (void)unused;
  if (rest != folder.end()) return nullptr;
  auto file = std::make_shared<File>();
  // Not to wait for whoever writes to a pipe.
  file->fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  struct stat about;
  if (file->fd < 0 || ::fstat(file->fd, &about) != 0 || !S_ISREG(about.st_mode)) return nullptr;
  file->size = static_cast<uint64_t>(about.st_size);
  file->tag = format("\"%llx-%llx-%llx\"", static_cast<unsigned long long>(about.st_ino),
                     static_cast<unsigned long long>(about.st_size),
                     static_cast<unsigned long long>(about.st_mtim.tv_sec) * 1000000000ull +
                         static_cast<unsigned long long>(about.st_mtim.tv_nsec));
  return file;
}

bool ends_with(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

const char* type_of(const std::string& name) {
  return ends_with(name, ".html")   ? "text/html; charset=utf-8"
         : ends_with(name, ".js")   ? "text/javascript"
         : ends_with(name, ".wasm") ? "application/wasm"
         : ends_with(name, ".l4d")  ? "model/l4d"
                                    : "application/octet-stream";
}

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '.' || c == '-' ||
                       c == '_' || c == '/';
    out += plain ? std::string(1, c) : format("%%%02X", static_cast<unsigned char>(c));
  }
  return out;
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
  std::filesystem::path folder;
  httplib::Server http;
  Line line;
  int port = 0;
  std::string root;  // "/TOKEN/"
  std::string url;
  std::atomic<uint64_t> requests{0}, bytes{0};

  explicit Parts(const ServerOptions& given)
      : options(given),
        folder(std::filesystem::canonical(given.folder)),
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
          // The library's own ranges know neither If-Range nor 416.
          const_cast<httplib::Request&>(request).ranges.clear();
          answer(request, response);
          return httplib::Server::HandlerResponse::Handled;
        });
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
    if (name.empty()) return begin_page(response);
    if (name.compare(0, play.size(), play) == 0) return page(name.substr(play.size()), response);
    if (name.compare(0, files.size(), files) == 0) {
      const PlayerFile* file = player_file(name.substr(files.size()));
      if (file == nullptr) return refuse(response, 404, "not found");
      return response.set_content(content_of(*file), type_of(file->name));
    }
    send(name, request, response);
  }

  bool is_served(const std::string& name) const {
    return is_plain(name) && (options.file.empty() || name == options.file);
  }

  void begin_page(httplib::Response& response) const {
    if (!options.file.empty()) return page(options.file, response);
    std::vector<std::string> names;
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
      const std::string name = entry.path().filename().string();
      if (ends_with(name, ".l4d") && is_plain(name)) names.push_back(name);
    }
    std::sort(names.begin(), names.end());
    std::string text =
        "<!doctype html><html lang=en><meta charset=utf-8><title>l4dcodec</title><ul>\n";
    for (const std::string& name : names) {
      const std::string path = escaped(name);
      text += "<li><a href=\"" + std::string(player_files().empty() ? "" : "play/") + path + "\">" +
              path + "</a>\n";
    }
    response.set_content(text + "</ul></html>\n", type_of(".html"));
  }

  void page(const std::string& name, httplib::Response& response) const {
    const PlayerFile* file = player_file("index.html");
    if (file == nullptr || !is_served(name)) return refuse(response, 404, "not found");
    std::string text = content_of(*file);
    replace(text, "src=\"scene.l4d\"", "src=\"" + root + escaped(name) + "\"");
    replace(text, "src=\"player.js\"", "src=\"" + root + "player/player.js\"");
    response.set_header(
        "Content-Security-Policy",
        "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; "
        "connect-src 'self' data:; img-src 'self' data:; style-src 'unsafe-inline'; "
        "base-uri 'none'; frame-ancestors 'none'");
    response.set_content(text, type_of(".html"));
  }

  void send(const std::string& name, const httplib::Request& request, httplib::Response& response) {
    const std::shared_ptr<File> file = is_served(name) ? open_file(folder, name) : nullptr;
    if (file == nullptr) return refuse(response, 404, "not found");
    response.set_header("Accept-Ranges", "bytes");
    response.set_header("ETag", file->tag);
    const std::string condition = request.get_header_value("If-Range");
    const bool wants_part = condition.empty() || condition == file->tag;
    ByteRange range =
        parse_byte_range(wants_part ? request.get_header_value("Range") : "", file->size);
    const std::string size = std::to_string(file->size);
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
