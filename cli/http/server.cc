// SPDX-License-Identifier: Apache-2.0
#include "cli/http/server.h"

#include <algorithm>
#include <atomic>
#include <cstring>
#include <random>
#include <utility>

#include "cli/http/byte_range.h"
#include "cli/http/embedded.h"
#include "cli/http/entity_tag.h"
#include "cli/http/file_body.h"
#include "cli/http/folder.h"
#include "cli/http/line.h"
#include "cli/http/listener.h"
#include "cli/http/peer.h"
#include "cli/text/escape.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

constexpr const char* kPlaylist = ".m3u8";  // behind the name of a file
// Paths of pages and of the player. Names of files and folders that are served have no leading dot.
constexpr const char* kPlay = ".play/";
constexpr const char* kPlayer = ".player/";
constexpr const char* kPicture = ".picture/";

std::string random_token() {
  std::random_device device;
  std::string token;
  for (int k = 0; k < 4; ++k) token += format("%08x", device());
  return token;
}

bool begins_with(const std::string& text, const std::string& begin) {
  return text.compare(0, begin.size(), begin) == 0;
}

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

const EmbeddedFile* find(const std::vector<EmbeddedFile>& files, const std::string& name) {
  const auto it = std::find_if(files.begin(), files.end(),
                               [&](const EmbeddedFile& file) { return name == file.name; });
  return it == files.end() ? nullptr : &*it;
}

std::string content_of(const EmbeddedFile& file) {
  return std::string(reinterpret_cast<const char*>(file.data), file.size);
}

HttpAnswer text_answer(std::string text, const char* type) {
  HttpAnswer answer;
  answer.text = std::move(text);
  answer.headers = {{"Content-Type", type}};
  return answer;
}

HttpAnswer refusal(int status, const char* why) {
  HttpAnswer answer = text_answer(std::string(why) + "\n", "text/plain");
  answer.status = status;
  return answer;
}

HttpAnswer redirect(int status, const std::string& to) {
  HttpAnswer answer;
  answer.status = status;
  answer.headers = {{"Location", to}};
  return answer;
}

HttpAnswer page_answer(std::string text, const std::string& sources) {
  HttpAnswer answer = text_answer(std::move(text), type_of(".html"));
  answer.headers.emplace_back("Content-Security-Policy",
                              "default-src 'none'; " + sources +
                                  "; style-src 'unsafe-inline'; base-uri 'none'; "
                                  "frame-ancestors 'none'");
  return answer;
}

HttpAnswer embedded(const std::vector<EmbeddedFile>& files, const std::string& name) {
  const EmbeddedFile* file = find(files, name);
  if (file == nullptr) return refusal(404, "not found");
  return text_answer(content_of(*file), type_of(file->name));
}

// The player, showing `source`.
HttpAnswer page_of(const EmbeddedFile& player, const std::string& root, const std::string& source) {
  std::string text = content_of(player);
  // A file here may become another one: what is at work on it goes on.
  replace(text, "src=\"scene.l4d\"", "src=\"" + root + source + "\" reload");
  replace(text, "src=\"player.js\"", "src=\"" + root + kPlayer + "player.js\"");
  return page_answer(std::move(text),
                     "script-src 'self' 'wasm-unsafe-eval'; worker-src 'self'; "
                     "connect-src 'self' data:; img-src 'self' data:");
}

// The page whose pictures this process draws. at: the path of what it takes.
HttpAnswer picture_page(const std::string& at) {
  std::string text = content_of(*find(picture_files(), "index.html"));
  replace(text, "src=\"page.js\"", "src=\"" + at + "page.js\"");
  return page_answer(std::move(text), "script-src 'self'; connect-src 'self'; img-src data: blob:");
}

}  // namespace

struct Server::Parts {
  ServerOptions options;
  Folder folder;
  Line line;
  Listener listener;
  std::string root;     // "/TOKEN/"
  std::string landing;  // "/" and as many digits
  std::atomic<bool> has_landed{false};
  std::string origin, url, landing_url;
  std::atomic<uint64_t> requests{0}, bytes{0};

  explicit Parts(const ServerOptions& given)
      : options(given),
        folder(given.folder),
        line(given.megabits, given.delay_ms),
        listener(given.port),
        root("/" + random_token() + "/"),
        landing("/" + random_token()),
        origin(format("http://%s:%d", Listener::kAddress, listener.port())),
        url(origin + root),
        landing_url(origin + landing) {}

  HttpAnswer answer(const HttpRequest& request) {
    ++requests;
    HttpAnswer answer = checked(request);
    for (const auto& [name, value] : {std::pair("X-Content-Type-Options", "nosniff"),
                                      std::pair("Referrer-Policy", "no-referrer"),
                                      std::pair("Cross-Origin-Resource-Policy", "same-origin"),
                                      std::pair("Cache-Control", "no-cache")}) {
      answer.headers.emplace_back(name, value);
    }
    return answer;
  }

  // What strangers get, and the others their answer.
  HttpAnswer checked(const HttpRequest& request) {
    const std::string host = request.header("Host");
    const std::string number = ":" + std::to_string(listener.port());
    if (host != Listener::kAddress + number && host != "localhost" + number) {
      return refusal(403, "another host");
    }
    if (request.method != "GET" && request.method != "HEAD") {
      HttpAnswer answer = refusal(405, "GET and HEAD alone");
      answer.headers.emplace_back("Allow", "GET, HEAD");
      return answer;
    }
    const std::string path = percent_decoded(request.path);
    if (path == landing && is_own_user(request.peer_port, listener.port()) &&
        !has_landed.exchange(true)) {
      return redirect(303, root);
    }
    if (!begins_with(path, root)) return refusal(404, "not found");
    if (!line.begin()) return refusal(503, "the server ends");
    HttpAnswer answer = named(path.substr(root.size()), request);
    answer.is_known = true;
    return answer;
  }

  HttpAnswer named(const std::string& name, const HttpRequest& request) {
    if (options.pictures.draw) {
      if (name.empty()) return picture_page(root + kPicture);
      if (begins_with(name, kPicture)) return picture(name.substr(std::strlen(kPicture)));
      return refusal(404, "not found");
    }
    if (name.empty() && !options.file.empty()) return page(options.file);
    if (begins_with(name, kPlay)) return page(name.substr(std::strlen(kPlay)));
    if (begins_with(name, kPlayer)) {
      return embedded(player_files(), name.substr(std::strlen(kPlayer)));
    }
    if (name.empty()) return list(name);
    if (options.file.empty() && name.back() == '/' && name.size() > 1) {
      return list(name.substr(0, name.size() - 1));
    }
    return send(name, request);
  }

  HttpAnswer picture(const std::string& name) const {
    if (name == "scene.json") return text_answer(options.pictures.scene, "application/json");
    PictureRequest wanted;
    if (!parse_picture(name, &wanted)) return embedded(picture_files(), name);
    return text_answer(options.pictures.draw(wanted), "image/png");
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

  // Where there is no file of this name: the playlist of one, or the way to a folder.
  HttpAnswer send_other(const std::string& name) const {
    if (ends_with(name, kPlaylist)) {
      std::string text = playlist_of(name.substr(0, name.size() - std::strlen(kPlaylist)));
      if (!text.empty()) return text_answer(std::move(text), type_of(name));
    }
    if (options.file.empty() && folder.has_folder(name)) {
      return redirect(301, root + percent_encoded(name) + "/");
    }
    return refusal(404, "not found");
  }

  HttpAnswer list(const std::string& name) const {
    if (!folder.has_folder(name)) return refusal(404, "not found");
    std::string text =
        "<!doctype html><html lang=en><meta charset=utf-8><title>l4dcodec</title>"
        "<link rel=icon href=\"data:,\"><ul>\n";
    const std::vector<Folder::Entry> entries = folder.list(name);
    if (entries.empty() || (name.empty() && !folder.may_have_streams())) {
      text += "<li>There is no stream in this folder yet.\n";
    }
    for (const Folder::Entry& entry : entries) {
      const std::string to = name.empty() ? entry.name : name + "/" + entry.name;
      const char* before = entry.is_folder || player_files().empty() ? "" : kPlay;
      const char* after = entry.is_folder ? "/" : "";
      text += "<li><a href=\"" + root + before + percent_encoded(to) + after + "\">" +
              marked_up(entry.name) + after + "</a>\n";
    }
    return text_answer(text + "</ul></html>\n", type_of(".html"));
  }

  HttpAnswer page(const std::string& name) const {
    const EmbeddedFile* player = find(player_files(), "index.html");
    if (player == nullptr || !is_served(name) || !folder.has_file(name)) {
      return refusal(404, "not found");
    }
    return page_of(*player, root,
                   percent_encoded(name) + (playlist_of(name).empty() ? "" : kPlaylist));
  }

  HttpAnswer send(const std::string& name, const HttpRequest& request) {
    const std::shared_ptr<ServedFile> file = is_served(name) ? folder.open(name) : nullptr;
    if (file == nullptr) return send_other(name);
    HttpAnswer answer = part_of(file, request);
    if (answer.body != nullptr) answer.headers.emplace_back("Content-Type", type_of(name));
    answer.headers.emplace_back("Accept-Ranges", "bytes");
    answer.headers.emplace_back("ETag", file->tag);
    return answer;
  }

  // What the conditions and the range of a request leave of a file.
  HttpAnswer part_of(const std::shared_ptr<ServedFile>& file, const HttpRequest& request) {
    const uint64_t size = file->state.size;
    if (request.count("If-Match") > 0 && !names_tag(request.header("If-Match"), file->tag, false)) {
      return refusal(412, "another file");
    }
    HttpAnswer answer;
    if (names_tag(request.header("If-None-Match"), file->tag, true)) {
      answer.status = 304;
      answer.body = body_of(file, 0, size);  // its size is that of the answer with the file
      return answer;
    }
    const std::string condition = request.header("If-Range");
    const bool wants_part =
        request.method == "GET" && (condition.empty() || condition == file->tag);
    const ByteRange range = parse_byte_range(wants_part ? request.header("Range") : "", size);
    if (range.kind == ByteRange::kUnsatisfiable) {
      answer = refusal(416, "no such range");
      answer.headers.emplace_back("Content-Range", "bytes */" + std::to_string(size));
      return answer;
    }
    if (range.kind == ByteRange::kWhole) {
      answer.body = body_of(file, 0, size);
      return answer;
    }
    answer.status = 206;
    answer.headers.emplace_back("Content-Range", "bytes " + std::to_string(range.begin) + "-" +
                                                     std::to_string(range.end - 1) + "/" +
                                                     std::to_string(size));
    answer.body = body_of(file, range.begin, range.end);
    return answer;
  }

  std::unique_ptr<FileBody> body_of(const std::shared_ptr<ServedFile>& file, uint64_t begin,
                                    uint64_t end) {
    return std::make_unique<FileBody>(file, begin, end, line, bytes);
  }
};

Server::Server(const ServerOptions& options) : parts_(std::make_unique<Parts>(options)) {}

Server::~Server() = default;

const std::string& Server::url() const { return parts_->url; }

const std::string& Server::landing_url() const { return parts_->landing_url; }

int Server::port() const { return parts_->listener.port(); }

ServerCounts Server::run(const std::function<bool()>& stopped) {
  Parts& p = *parts_;
  p.listener.run([&](const HttpRequest& request) { return p.answer(request); }, stopped,
                 [&] { p.line.cut(); });
  return {p.requests, p.bytes};
}

}  // namespace l4d::cli
