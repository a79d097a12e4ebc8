// SPDX-License-Identifier: Apache-2.0
#include "cli/http/listener.h"

#include <microhttpd.h>
#include <netinet/in.h>
#include <strings.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <chrono>
#include <cstring>
#include <memory>
#include <thread>
#include <utility>

#include "cli/command/context.h"
#include "cli/http/connections.h"
#include "cli/text/units.h"

namespace l4d::cli {
namespace {

constexpr size_t kReceived = size_t{16} << 10;

// What the callbacks of a running server share.
struct Running {
  const Listener::Handler& handler;
  Connections connections;
};

// Of an answer that is on its way.
struct Sending {
  Connections& connections;
  Connections::One* one;
  std::unique_ptr<FileBody> body;
};

Connections::One* one_of(MHD_Connection* connection) {
  const auto* info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
  return static_cast<Connections::One*>(info->socket_context);
}

void on_connection(void* user, MHD_Connection* connection, void** context,
                   MHD_ConnectionNotificationCode code) {
  auto& connections = static_cast<Running*>(user)->connections;
  if (code == MHD_CONNECTION_NOTIFY_STARTED) {
    const auto* info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
    *context = connections.begin(info->connect_fd);
  } else {
    connections.end(static_cast<Connections::One*>(*context));
  }
}

void on_completed(void* user, MHD_Connection* connection, void**, MHD_RequestTerminationCode) {
  static_cast<Running*>(user)->connections.wait_for_request(one_of(connection));
}

// Paths stay as they came: the library's own decoding ends them at %00.
size_t keep_escapes(void*, MHD_Connection*, char* text) { return std::strlen(text); }

MHD_Result add_header(void* user, MHD_ValueKind, const char* key, const char* value) {
  auto& headers = *static_cast<HttpHeaders*>(user);
  headers.emplace_back(key, value == nullptr ? "" : value);
  return MHD_YES;
}

// RFC 9112, 3.2.2: clients may ask for "http://host/path", and that host is the one that counts.
void take_authority(HttpRequest* request) {
  constexpr char kScheme[] = "http://";
  constexpr size_t kLength = sizeof(kScheme) - 1;
  if (::strncasecmp(request->path.c_str(), kScheme, kLength) != 0) return;
  const size_t end = std::min(request->path.find('/', kLength), request->path.size());
  const std::string host = request->path.substr(kLength, end - kLength);
  for (auto& [key, value] : request->headers) {
    if (::strcasecmp(key.c_str(), "Host") == 0) value = host;
  }
  request->path.erase(0, end);
  if (request->path.empty()) request->path = "/";
}

HttpRequest request_of(MHD_Connection* connection, const char* path, const char* method) {
  HttpRequest request;
  request.method = method;
  request.path = path;
  MHD_get_connection_values(connection, MHD_HEADER_KIND, add_header, &request.headers);
  take_authority(&request);
  const auto* info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
  request.peer_port = ntohs(reinterpret_cast<const sockaddr_in*>(info->client_addr)->sin_port);
  return request;
}

HttpAnswer refusal(int status, const char* why) {
  HttpAnswer answer;
  answer.status = status;
  answer.headers = {{"Content-Type", "text/plain"}};
  answer.text = std::string(why) + "\n";
  answer.closes = true;
  return answer;
}

// RFC 9110, 5.6.2.
bool is_token(const std::string& name) {
  constexpr char kMarks[] = "!#$%&'*+-.^_`|~";
  return !name.empty() && std::all_of(name.begin(), name.end(), [&](unsigned char c) {
    return std::isalnum(c) != 0 || (c != 0 && std::strchr(kMarks, c) != nullptr);
  });
}

// Whether readers may disagree on where the request ends: what one takes for its body is another
// request to the other (RFC 9112, 11.2).
bool is_ambiguous(const HttpRequest& request) {
  for (const auto& [name, value] : request.headers) {
    if (!is_token(name)) return true;
    // The library makes one name of a folded line's name and value.
    for (const char* framing : {"Content-Length", "Transfer-Encoding"}) {
      const size_t length = std::strlen(framing);
      if (name.size() > length && strncasecmp(name.c_str(), framing, length) == 0) return true;
    }
  }
  if (request.count("Content-Length") == 0) return false;
  const std::string length = request.header("Content-Length");
  return request.count("Content-Length") > 1 || length.empty() ||
         length.find_first_not_of("0123456789") != std::string::npos;
}

bool has_body(const HttpRequest& request) {
  return is_ambiguous(request) || request.count("Transfer-Encoding") > 0 ||
         request.header("Content-Length").find_first_not_of('0') != std::string::npos;
}

HttpAnswer answer_of(const Listener::Handler& handler, const HttpRequest& request) {
  if (request.headers.size() > Listener::kHeaderLines) return refusal(431, "too many headers");
  if (is_ambiguous(request)) return refusal(400, "a header can be read in two ways");
  if (request.count("Host") > 1) return refusal(400, "several hosts");
  try {
    HttpAnswer answer = handler(request);
    if (!has_body(request)) return answer;
    if (answer.status < 400) return refusal(413, "requests have no body");
    answer.closes = true;
    return answer;
  } catch (const std::exception&) {
    return refusal(500, "this cannot be answered");
  }
}

ssize_t read_body(void* user, uint64_t, char* to, size_t n) {
  auto& sending = *static_cast<Sending*>(user);
  sending.connections.work(sending.one);
  try {
    const size_t count = sending.body->read(to, n);
    sending.connections.wait_for_taking(sending.one);
    return count > 0 ? static_cast<ssize_t>(count) : MHD_CONTENT_READER_END_WITH_ERROR;
  } catch (const std::exception&) {
    return MHD_CONTENT_READER_END_WITH_ERROR;
  }
}

void free_body(void* user) { delete static_cast<Sending*>(user); }

MHD_Response* response_of(HttpAnswer& answer, Connections& connections, Connections::One* one) {
  if (answer.body == nullptr) {
    return MHD_create_response_from_buffer(answer.text.size(), answer.text.data(),
                                           MHD_RESPMEM_MUST_COPY);
  }
  const uint64_t size = answer.body->size();
  auto sending = std::make_unique<Sending>(Sending{connections, one, std::move(answer.body)});
  MHD_Response* response =
      MHD_create_response_from_callback(size, kReceived, read_body, sending.get(), free_body);
  if (response != nullptr) (void)sending.release();
  return response;
}

// The first call of a request has its headers, and is answered only if they announce a body, which
// ends the connection.
MHD_Result on_request(void* user, MHD_Connection* connection, const char* path, const char* method,
                      const char*, const char*, size_t*, void** seen) {
  try {
    auto& running = *static_cast<Running*>(user);
    const HttpRequest request = request_of(connection, path, method);
    if (*seen == nullptr && !has_body(request)) {
      *seen = user;
      return MHD_YES;
    }
    Connections::One* one = one_of(connection);
    running.connections.work(one);
    HttpAnswer answer = answer_of(running.handler, request);
    if (answer.is_known) running.connections.set_known(one);
    running.connections.wait_for_taking(one);
    MHD_Response* response = response_of(answer, running.connections, one);
    if (response == nullptr) return MHD_NO;
    if (answer.closes) answer.headers.emplace_back("Connection", "close");
    for (const auto& [key, value] : answer.headers) {
      MHD_add_response_header(response, key.c_str(), value.c_str());
    }
    const MHD_Result result =
        MHD_queue_response(connection, static_cast<unsigned>(answer.status), response);
    MHD_destroy_response(response);
    return result;
  } catch (const std::exception&) {
    return MHD_NO;
  }
}

// Prints nothing: what a client does wrong is the client's matter.
void keep_silent(void*, const char*, va_list) {}

MHD_Daemon* start(int socket, Running& running) {
  return MHD_start_daemon(
      MHD_USE_POLL_INTERNAL_THREAD | MHD_USE_THREAD_PER_CONNECTION | MHD_USE_ITC, 0, nullptr,
      nullptr, on_request, &running, MHD_OPTION_EXTERNAL_LOGGER, keep_silent, nullptr,
      MHD_OPTION_LISTEN_SOCKET, socket, MHD_OPTION_CONNECTION_MEMORY_LIMIT, Listener::kRequestBytes,
      MHD_OPTION_CONNECTION_LIMIT, static_cast<unsigned>(2 * Connections::kMost),
      MHD_OPTION_NOTIFY_CONNECTION, on_connection, &running, MHD_OPTION_NOTIFY_COMPLETED,
      on_completed, &running, MHD_OPTION_UNESCAPE_CALLBACK, keep_escapes, nullptr, MHD_OPTION_END);
}

}  // namespace

Listener::Listener(int port) {
  socket_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int yes = 1;
  (void)::setsockopt(socket_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  auto* any = reinterpret_cast<sockaddr*>(&address);
  socklen_t length = sizeof address;
  if (socket_ < 0 || ::bind(socket_, any, length) != 0 || ::listen(socket_, SOMAXCONN) != 0 ||
      ::getsockname(socket_, any, &length) != 0) {
    if (socket_ >= 0) ::close(socket_);
    throw Failure(L4D_ERR_IO, format("port %d of %s cannot be had", port, kAddress));
  }
  port_ = ntohs(address.sin_port);
}

Listener::~Listener() {
  if (socket_ >= 0) ::close(socket_);
}

void Listener::run(const Handler& handler, const std::function<bool()>& stopped,
                   const std::function<void()>& before_end) {
  Running running{handler, {}};
  // The library closes the socket, also where it fails.
  MHD_Daemon* server = start(std::exchange(socket_, -1), running);
  if (server == nullptr) throw Failure(L4D_ERR_IO, "the HTTP server cannot start");
  while (!stopped()) {
    running.connections.end_late();
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  before_end();
  MHD_stop_daemon(server);
}

}  // namespace l4d::cli
