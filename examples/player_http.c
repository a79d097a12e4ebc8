/* SPDX-License-Identifier: Apache-2.0
 * A player over l4d/playback.h and sockets: it plays a stream, or the streams of a playlist
 * (.m3u8), from an HTTP server, on one thread. It prints once a second what it shows; a real player
 * draws. POSIX; HTTP/1.1 without TLS, redirects and kept connections, which libraries of HTTP have.
 *
 *   player_http http://HOST[:PORT]/PATH/scene.l4d [SECONDS]
 *   cc player_http.c $(pkg-config --cflags --libs l4dcodec)
 */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "l4d/playback.h"

enum { MAX_REQUESTS = 8, NUM_ITEMS = 64, MAX_URL = 2048, MAX_HEAD = 8192 };
static const double kFrameSeconds = 1.0 / 30;

/* A request that is under way, on a connection of its own. */
typedef struct request {
  uint32_t id;
  int fd;
  char text[2 * MAX_URL + 256]; /* what is sent */
  size_t text_bytes, sent;
  char head[MAX_HEAD]; /* of the answer, until it is whole */
  size_t head_bytes;
  int has_head;
} request;

typedef struct player {
  l4d_playback* playback;
  char url[MAX_URL]; /* of the stream or the playlist */
  request requests[MAX_REQUESTS];
  size_t num_requests;
  l4d_playback_state state;
  l4d_status failure;
} player;

static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void check(player* p, l4d_status status) {
  if (p->failure == L4D_OK) p->failure = status;
}

/* ---- URLs ------------------------------------------------------------------------------------ */

/* Host and port of an http:// URL. Returns where its path begins, NULL if it is none. */
static const char* split_url(const char* url, char* host, size_t host_size, char* port,
                             size_t port_size) {
  const char *name = url, *colon = NULL;
  size_t name_bytes, host_bytes;
  if (strncmp(url, "http://", strlen("http://")) != 0) return NULL;
  name += strlen("http://");
  name_bytes = strcspn(name, "/");
  colon = memchr(name, ':', name_bytes);
  host_bytes = colon != NULL ? (size_t)(colon - name) : name_bytes;
  if (host_bytes == 0 || host_bytes >= host_size || name[name_bytes] != '/') return NULL;
  snprintf(host, host_size, "%.*s", (int)host_bytes, name);
  snprintf(port, port_size, "%.*s", colon != NULL ? (int)(name + name_bytes - colon - 1) : 2,
           colon != NULL ? colon + 1 : "80");
  return name + name_bytes;
}

/* What a URI of the playlist means: a URL, or a path from the server or from the playlist. */
static int resolve_uri(const char* base, const char* uri, char* out) {
  size_t kept = 0; /* of `base` */
  if (strstr(uri, "://") == NULL) {
    kept = uri[0] == '/' ? 7 + strcspn(base + 7, "/") : (size_t)(strrchr(base, '/') + 1 - base);
  }
  return snprintf(out, MAX_URL, "%.*s%s", (int)kept, base, uri) < MAX_URL;
}

/* ---- HTTP ------------------------------------------------------------------------------------ */

/* A connection that is being made; -1: there is none to that host. Looking up a name takes as long
 * as it takes: other players do it on another thread. */
static int connect_to(const char* host, const char* port) {
  struct addrinfo hints, *found = NULL;
  int fd = -1;
  memset(&hints, 0, sizeof hints);
  hints.ai_socktype = SOCK_STREAM;
  if (getaddrinfo(host, port, &hints, &found) != 0) return -1;
  fd = socket(found->ai_family, found->ai_socktype, found->ai_protocol);
  if (fd >= 0) {
    fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK);
    if (connect(fd, found->ai_addr, found->ai_addrlen) != 0 && errno != EINPROGRESS) {
      close(fd);
      fd = -1;
    }
  }
  freeaddrinfo(found);
  return fd;
}

static void drop(player* p, uint32_t id) {
  size_t i, kept = 0;
  for (i = 0; i < p->num_requests; ++i) {
    if (p->requests[i].id == id) {
      close(p->requests[i].fd);
    } else {
      if (kept != i) p->requests[kept] = p->requests[i];
      ++kept;
    }
  }
  p->num_requests = kept;
}

static void start(player* p, const l4d_playback_item* item) {
  request* r = &p->requests[p->num_requests];
  char url[MAX_URL], host[256], port[8], range[64] = "";
  const char *uri = "", *path = NULL;
  if (item->source == 0) {
    strcpy(url, p->url);
  } else {
    check(p, l4d_playback_get_uri(p->playback, item->source, &uri));
    if (!resolve_uri(p->url, uri, url)) url[0] = '\0';
  }
  path = split_url(url, host, sizeof host, port, sizeof port);
  if (path == NULL || p->num_requests == MAX_REQUESTS) {
    check(p, l4d_playback_finished(p->playback, now(), item->id, L4D_TRANSFER_FORBIDDEN));
    return;
  }
  if ((item->flags & (L4D_REQUEST_WHOLE | L4D_REQUEST_PLAYLIST)) == 0) {
    int n = snprintf(range, sizeof range, "Range: bytes=%llu-", (unsigned long long)item->offset);
    if (item->size > 0) {
      n += snprintf(range + n, sizeof range - (size_t)n, "%llu",
                    (unsigned long long)(item->offset + item->size - 1));
    }
    snprintf(range + n, sizeof range - (size_t)n, "\r\n");
  }
  memset(r, 0, sizeof *r);
  r->id = item->id;
  r->text_bytes = (size_t)snprintf(
      r->text, sizeof r->text, "GET %s HTTP/1.1\r\nHost: %s:%s\r\n%s%sConnection: close\r\n\r\n",
      path, host, port, range,
      (item->flags & (L4D_REQUEST_FRESH | L4D_REQUEST_PLAYLIST)) != 0
          ? "Cache-Control: no-cache\r\n"
          : "");
  r->fd = connect_to(host, port);
  if (r->fd < 0) {
    check(p, l4d_playback_finished(p->playback, now(), item->id, L4D_TRANSFER_FAILED));
  } else {
    ++p->num_requests;
  }
}

/* The value of a header of an answer; NULL: it has none. */
static const char* header(const char* head, const char* name) {
  const size_t n = strlen(name);
  const char* line;
  for (line = strstr(head, "\r\n"); line != NULL; line = strstr(line + 2, "\r\n")) {
    if (strncasecmp(line + 2, name, n) == 0 && line[2 + n] == ':') {
      return line + 3 + n + strspn(line + 3 + n, " \t");
    }
  }
  return NULL;
}

/* FNV-1a: what tells one version of a file from another. */
static uint64_t hash_of(const char* text, size_t n) {
  uint64_t hash = 14695981039346656037u;
  size_t i;
  for (i = 0; i < n; ++i) hash = (hash ^ (unsigned char)text[i]) * 1099511628211u;
  return hash != 0 ? hash : 1;
}

/* Tells the engine the head of an answer. */
static void answer(player* p, const request* r) {
  l4d_answer a = L4D_INIT(l4d_answer);
  const char *range = header(r->head, "Content-Range"), *length = header(r->head, "Content-Length");
  const char *tag = header(r->head, "ETag"), *later = header(r->head, "Retry-After");
  const char* total = range != NULL ? strchr(range, '/') : NULL;
  const char* space = strchr(r->head, ' ');
  a.status = space != NULL ? (uint32_t)atoi(space) : 0;
  if (range != NULL) a.offset = strtoull(range + strcspn(range, "0123456789*"), NULL, 10);
  if (total != NULL) a.total_bytes = strtoull(total + 1, NULL, 10);
  if (a.status == 200 && length != NULL) a.total_bytes = strtoull(length, NULL, 10);
  if (tag != NULL && tag[0] == '"') a.version = hash_of(tag, strcspn(tag, "\r"));
  if (later != NULL) a.retry_after = atof(later);
  check(p, l4d_playback_answered(p->playback, now(), r->id, &a));
}

/* Bytes of an answer. Returns the bytes of the head among them, which `r` keeps. */
static size_t take_head(player* p, request* r, const char* bytes, size_t n) {
  size_t i;
  for (i = 0; i < n && !r->has_head && r->head_bytes + 1 < MAX_HEAD; ++i) {
    r->head[r->head_bytes++] = bytes[i];
    r->has_head = r->head_bytes >= 4 && memcmp(r->head + r->head_bytes - 4, "\r\n\r\n", 4) == 0;
  }
  if (r->has_head) answer(p, r);
  return i;
}

/* Sends and receives what the socket takes and has. Returns 0 once the request has ended. */
static int pump(player* p, request* r) {
  static char bytes[65536];
  while (r->sent < r->text_bytes) {
    const ssize_t n = send(r->fd, r->text + r->sent, r->text_bytes - r->sent, 0);
    if (n < 0) return errno == EAGAIN || errno == ENOTCONN ? 1 : 0;
    r->sent += (size_t)n;
  }
  for (;;) {
    const ssize_t n = recv(r->fd, bytes, sizeof bytes, 0);
    size_t head = 0;
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) return 1;
    if (n <= 0) return 0;
    if (!r->has_head) head = take_head(p, r, bytes, (size_t)n);
    if (!r->has_head) return r->head_bytes + 1 < MAX_HEAD;
    check(p, l4d_playback_received(p->playback, now(), r->id, bytes + head, (size_t)n - head));
  }
}

/* Waits until a socket has something, but not beyond `until`. */
static void wait(player* p, double until) {
  struct pollfd fds[MAX_REQUESTS];
  uint32_t ended[MAX_REQUESTS];
  size_t i, num_ended = 0;
  double left = until - now();
  if (left < 0) left = 0;
  if (left > 1) left = 1;
  for (i = 0; i < p->num_requests; ++i) {
    fds[i].fd = p->requests[i].fd;
    fds[i].events = p->requests[i].sent < p->requests[i].text_bytes ? POLLOUT : POLLIN;
    fds[i].revents = 0;
  }
  if (poll(fds, (nfds_t)p->num_requests, (int)(1000 * left) + 1) <= 0) return;
  for (i = 0; i < p->num_requests; ++i) {
    request* r = &p->requests[i];
    if (fds[i].revents == 0 || pump(p, r)) continue;
    check(p, l4d_playback_finished(p->playback, now(), r->id,
                                   r->has_head ? L4D_TRANSFER_ENDED : L4D_TRANSFER_FAILED));
    ended[num_ended++] = r->id;
  }
  for (i = 0; i < num_ended; ++i) drop(p, ended[i]);
}

/* ---- the player ------------------------------------------------------------------------------ */

static void tell(const l4d_playback_item* item) {
  if (item->event == L4D_EVENT_LOST)
    fprintf(stderr, "lost: %s\n", l4d_playback_cause_name(item->cause));
  if (item->event == L4D_EVENT_RETRY) {
    fprintf(stderr, "again in %.2f s: %s\n", item->value, l4d_playback_cause_name(item->cause));
  }
}

/* Lets the engine decide, and does what it says. */
static void update(player* p) {
  l4d_playback_item items[NUM_ITEMS];
  uint32_t count = NUM_ITEMS, i;
  check(p, l4d_playback_update(p->playback, now()));
  while (count == NUM_ITEMS && p->failure == L4D_OK) {
    check(p, l4d_playback_take(p->playback, items, NUM_ITEMS, &count));
    for (i = 0; i < count && p->failure == L4D_OK; ++i) {
      if (items[i].kind == L4D_ITEM_REQUEST) start(p, &items[i]);
      if (items[i].kind == L4D_ITEM_CANCEL) drop(p, items[i].id);
      if (items[i].kind == L4D_ITEM_EVENT) tell(&items[i]);
    }
  }
  check(p, l4d_playback_get_state(p->playback, &p->state));
}

/* The picture of this moment. A real player passes arrays, and draws. Returns its Gaussians. */
static uint64_t show(player* p, double* time) {
  const l4d_playback_state* s = &p->state;
  l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
  *time = s->anchor_time + (now() - s->anchor_now) * s->velocity;
  if (*time < s->ready_from) *time = s->ready_from;
  if (*time > s->ready_until) *time = s->ready_until;
  if (s->ready) check(p, l4d_playback_slice(p->playback, *time, &splats));
  return splats.count;
}

static void play(player* p, double seconds) {
  const double begun = now();
  double due = begun, said = begun, time = 0;
  const size_t length = strlen(p->url);
  const int is_list = length > 5 && strcmp(p->url + length - 5, ".m3u8") == 0;
  check(p, l4d_playback_open(p->playback, now(), p->url,
                             is_list ? L4D_OPEN_PLAYLIST : L4D_OPEN_STREAM, 0));
  check(p, l4d_playback_play(p->playback, now()));
  for (; p->failure == L4D_OK && now() < begun + seconds;) {
    update(p);
    if (p->state.stream == L4D_STREAM_FAILED || p->state.motion == L4D_MOTION_ENDED) break;
    if (now() >= due) {
      const uint64_t count = show(p, &time);
      due = now() + kFrameSeconds;
      if (p->state.ready && now() >= said) {
        printf("%.2f s: %llu Gaussians, rung %u of %u, %llu bytes\n", time,
               (unsigned long long)count, (unsigned)p->state.rung + 1, (unsigned)p->state.num_rungs,
               (unsigned long long)p->state.received_bytes);
        fflush(stdout);
        said = now() + 1;
      }
    }
    wait(p, p->state.wake_at < due ? p->state.wake_at : due);
  }
}

int main(int argc, char** argv) {
  static player p;
  char host[256], port[8];
  int failed;
  if (argc < 2 || strlen(argv[1]) >= MAX_URL ||
      split_url(argv[1], host, sizeof host, port, sizeof port) == NULL) {
    fprintf(stderr, "usage: player_http http://HOST[:PORT]/PATH [SECONDS]\n");
    return 2;
  }
  signal(SIGPIPE, SIG_IGN); /* a server that hangs up is no reason to end */
  strcpy(p.url, argv[1]);
  p.state.struct_size = sizeof p.state;
  check(&p, l4d_playback_create(NULL, &p.playback));
  if (p.failure == L4D_OK) play(&p, argc > 2 ? atof(argv[2]) : 1e9);
  failed = p.failure != L4D_OK || p.state.stream == L4D_STREAM_FAILED;
  if (p.failure != L4D_OK) {
    fprintf(stderr, "player_http: %s %s\n", l4d_status_name(p.failure), l4d_last_error_message());
  } else if (failed) {
    fprintf(stderr, "player_http: the stream cannot be played: %s\n",
            l4d_playback_cause_name(p.state.cause));
  } else {
    printf("shown for %.1f s, of which %.1f s waiting, %llu requests\n",
           p.state.end - p.state.begin, p.state.waited_seconds,
           (unsigned long long)p.state.requests);
  }
  while (p.num_requests > 0) drop(&p, p.requests[0].id);
  l4d_playback_destroy(p.playback);
  return failed;
}
