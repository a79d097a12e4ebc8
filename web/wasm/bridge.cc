// SPDX-License-Identifier: Apache-2.0
// The engine of playback and its decoders as a WebAssembly module: functions of plain numbers and
// of places in its memory. Lists that a call makes lie where l4dw_numbers says, until the next call
// that makes one. The host makes requests, and hands over what comes of them: it has no other part
// in what is read.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <new>
#include <vector>

#include "l4d/members.h"
#include "l4d/playback.h"
#include "web/wasm/rows.h"
#include "web/wasm/unset.h"

#define L4DW_EXPORT(name) __attribute__((export_name(#name))) name

namespace {

constexpr uint32_t kMostItems = 64;  // of an update

struct Session {
  l4d_playback* playback = nullptr;
  l4d_decoder* decoder = nullptr;  // of the stream that the last l4dw_select named
  l4d::web::Unset<char> input;
  std::vector<double> numbers;
  l4d::web::Unset<float> floats[8];
  l4d::web::Unset<uint16_t> halves;  // SH, where rows are made of them
  std::vector<uint32_t> windows;     // [count, 2] of a stream with flat windows, else empty
  l4d::web::Rows rows;
};

// Calls call(context). Not inline, nor is `put`: a copy for each function makes the module larger.
__attribute__((noinline)) l4d_status guarded(l4d_status (*call)(const void*), const void* context) {
  try {
    return call(context);
  } catch (const std::bad_alloc&) {
    return L4D_ERR_OUT_OF_MEMORY;
  } catch (...) {
    return L4D_ERR_INTERNAL;
  }
}

// Calls fn, which returns a status.
template <typename Function>
l4d_status guarded(const Function& fn) {
  return guarded([](const void* f) { return (*static_cast<const Function*>(f))(); }, &fn);
}

// Adds to the list that a call makes.
__attribute__((noinline)) void put(Session& s, std::initializer_list<double> numbers) {
  s.numbers.insert(s.numbers.end(), numbers.begin(), numbers.end());
}

template <typename T>
double place_of(const T* data) {
  return static_cast<double>(reinterpret_cast<uintptr_t>(data));
}

double number(uint64_t value) { return static_cast<double>(value); }

l4d_query query_of(uint32_t kind, double begin, double end, uint32_t detail) {
  l4d_query query = L4D_INIT(l4d_query);
  query.kind = kind;
  query.time_begin = begin;
  query.time_end = end;
  query.point.detail = detail;
  return query;
}

l4d_status info_of(Session& s, l4d_info* info) {
  *info = L4D_INIT(l4d_info);
  return l4d_decoder_get_info(s.decoder, info);
}

// Calls get(array, capacity, &count) until the array holds all.
template <typename T, typename Get>
l4d_status list_all(std::vector<T>* out, const Get& get) {
  uint64_t count = 16;
  l4d_status status = L4D_OK;
  do {
    out->resize(static_cast<size_t>(count));
    status = get(out->data(), out->size(), &count);
  } while (status == L4D_OK && count > out->size());
  out->resize(static_cast<size_t>(count));
  return status;
}

// Which of the arrays of a decoded bucket lies where in Session::floats.
enum { kPosition, kMeanTime, kMeanTimeLocal, kLogScale, kRotor, kOpacity, kSh, kCovariance };

// SH comes as binary32, or as binary16.
l4d_status decode(Session& s, const l4d_query& query, bool halves,
                  std::vector<l4d_bucket_span>* ranges) {
  l4d_info info;
  l4d_selection selection = L4D_INIT(l4d_selection);
  l4d_status status = info_of(s, &info);
  if (status == L4D_OK) status = l4d_decoder_select(s.decoder, &query, &selection);
  if (status != L4D_OK) return status;
  const size_t n = static_cast<size_t>(selection.num_gaussians);
  const size_t terms = size_t{info.sh_degree + 1} * (info.sh_degree + 1);
  const size_t widths[] = {3, 1, 1, 4, 8, 1, halves ? 0 : 3 * terms, 0};
  for (size_t k = 0; k < 8; ++k) s.floats[k].resize(n * widths[k]);
  s.halves.resize(halves ? n * 3 * terms : 0);
  s.windows.resize((info.tools & L4D_TOOL_FLAT_WINDOWS) != 0 ? 2 * n : 0);
  ranges->resize(static_cast<size_t>(selection.num_spans));
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  b.capacity = n;
  b.position = s.floats[kPosition].data();
  b.mean_t = s.floats[kMeanTime].data();
  b.mean_t_local = s.floats[kMeanTimeLocal].data();
  b.log_scale = s.floats[kLogScale].data();
  b.rotor = s.floats[kRotor].data();
  b.opacity = s.floats[kOpacity].data();
  b.sh = halves ? nullptr : s.floats[kSh].data();
  b.sh_half = halves ? s.halves.data() : nullptr;
  b.window = s.windows.empty() ? nullptr : s.windows.data();
  b.spans = ranges->data();
  b.span_capacity = ranges->size();
  status = l4d_decoder_decode(s.decoder, &query, &b);
  if (status != L4D_OK) return status;
  ranges->resize(static_cast<size_t>(b.num_spans));
  for (size_t k = 0; k < 8; ++k) s.floats[k].resize(static_cast<size_t>(b.count) * widths[k]);
  return status;
}

}  // namespace

extern "C" {

// pool_bytes: of received bytes. failures: of requests in a row, before a source is down. timeout:
// seconds without a byte. ahead: seconds. slices: 1: of l4dw_slice alone. live_*, stale_after: as
// in l4d_playback_options. Null: no memory, or an option is out of range.
Session* L4DW_EXPORT(l4dw_create)(double max_memory_bytes, double pool_bytes, double max_units,
                                  double ahead, double timeout, uint32_t failures, uint32_t strict,
                                  uint32_t slices, double live_distance, double live_slow,
                                  double live_fast, double stale_after) {
  Session* s = new (std::nothrow) Session;
  if (s == nullptr) return nullptr;
  l4d_playback_options o = L4D_INIT(l4d_playback_options);
  o.max_memory_bytes = static_cast<uint64_t>(max_memory_bytes);
  o.byte_pool_bytes = static_cast<uint64_t>(pool_bytes);
  o.max_units = static_cast<uint64_t>(max_units);
  o.unit_grain = 256;  // as textures of a player hold them
  o.loader = slices != 0 ? L4D_LOADER_SLICES : L4D_LOADER_CALLER;
  o.failures = failures;
  o.ahead = ahead;
  o.first_byte_timeout = o.idle_timeout = timeout;
  o.urgent_timeout = timeout;
  o.strict = strict;
  o.live_distance = live_distance;
  o.live_slow = live_slow;
  o.live_fast = live_fast;
  o.stale_after = stale_after;
  if (l4d_playback_create(&o, &s->playback) != L4D_OK) {
    delete s;
    return nullptr;
  }
  return s;
}

void L4DW_EXPORT(l4dw_destroy)(Session* s) {
  if (s != nullptr) l4d_playback_destroy(s->playback);
  delete s;
}

// Why the last call failed, ended by a zero byte.
const char* L4DW_EXPORT(l4dw_error)(void) { return l4d_last_error_message(); }
const char* L4DW_EXPORT(l4dw_status_name)(l4d_status status) { return l4d_status_name(status); }

const double* L4DW_EXPORT(l4dw_numbers)(const Session* s) { return s->numbers.data(); }
uint32_t L4DW_EXPORT(l4dw_num_numbers)(const Session* s) {
  return static_cast<uint32_t>(s->numbers.size());
}
// Where the host writes what the next call takes: n bytes. Null: no memory.
char* L4DW_EXPORT(l4dw_input)(Session* s, uint32_t n) {
  const l4d_status status = guarded([&]() -> l4d_status {
    s->input.resize(n);
    return L4D_OK;
  });
  return status == L4D_OK ? s->input.data() : nullptr;
}

// ---- the engine. Times of the host are seconds.

// Opens the URI in the input, which ends with a zero byte. kind: L4D_OPEN_*.
l4d_status L4DW_EXPORT(l4dw_open)(Session* s, double now, uint32_t kind) {
  return l4d_playback_open(s->playback, now, s->input.data(), kind, 0);
}

enum { kPlay, kPause, kRetry, kRefresh };
l4d_status L4DW_EXPORT(l4dw_command)(Session* s, double now, uint32_t command) {
  switch (command) {
    case kPlay:
      return l4d_playback_play(s->playback, now);
    case kPause:
      return l4d_playback_pause(s->playback, now);
    case kRetry:
      return l4d_playback_retry(s->playback, now);
    default:
      return l4d_playback_refresh(s->playback, now);
  }
}

l4d_status L4DW_EXPORT(l4dw_seek)(Session* s, double now, double time, double tolerance,
                                  uint32_t id) {
  return l4d_playback_seek(s->playback, now, time, tolerance, id);
}

// mode: what follows the end, L4D_PLAY_*.
l4d_status L4DW_EXPORT(l4dw_set_motion)(Session* s, double now, double rate, uint32_t mode) {
  const l4d_status status = l4d_playback_set_rate(s->playback, now, rate);
  return status != L4D_OK ? status : l4d_playback_set_range(s->playback, now, mode, 1, 0);
}

l4d_status L4DW_EXPORT(l4dw_set_quality)(Session* s, double now, uint32_t max_level,
                                         uint32_t max_tier, uint32_t detail, uint32_t fixed,
                                         uint32_t network) {
  l4d_quality q = L4D_INIT(l4d_quality);
  q.point = {max_level + 1, max_tier + 1, detail, 0};  // UINT32_MAX: 0, which is all
  q.fixed = fixed;
  q.network = network;
  return l4d_playback_set_quality(s->playback, now, &q);
}

// Numbers: the state, and then the items, as `stateFields` and `itemFields` of
// web/core/src/decoder.js list them. There may be more items.
l4d_status L4DW_EXPORT(l4dw_update)(Session* s, double now) {
  return guarded([&] {
    l4d_status status = l4d_playback_update(s->playback, now);
    l4d_playback_item items[kMostItems];
    uint32_t count = 0;
    l4d_playback_state state = L4D_INIT(l4d_playback_state);
    if (status == L4D_OK) status = l4d_playback_get_state(s->playback, &state);
    s->numbers.clear();
    s->numbers.reserve(32 + 17 * kMostItems);  // so that no item that is taken can be lost
    if (status == L4D_OK) status = l4d_playback_take(s->playback, items, kMostItems, &count);
    if (status != L4D_OK) return status;
    put(*s, {number(state.stream),
             number(state.motion),
             number(state.cause),
             number(state.rung),
             number(state.num_rungs),
             number(state.ready),
             state.begin,
             state.end,
             state.anchor_time,
             state.anchor_now,
             state.velocity,
             state.ready_from,
             state.ready_until,
             state.wake_at,
             state.throughput,
             number(state.received_bytes),
             number(state.requests),
             number(state.live),
             state.live_distance,
             number(state.sh_degree)});
    for (uint32_t i = 0; i < count; ++i) {
      const l4d_playback_item& item = items[i];
      put(*s, {number(item.kind), number(item.id), number(item.source), number(item.flags),
               number(item.offset), number(item.size), number(item.stream), number(item.layer),
               number(item.bucket), number(item.detail), number(item.units), number(item.event),
               number(item.cause), item.time, item.value});
    }
    return status;
  });
}

l4d_status L4DW_EXPORT(l4dw_answered)(Session* s, double now, uint32_t id, uint32_t status,
                                      double offset, double total_bytes, double version,
                                      double retry_after) {
  l4d_answer a = L4D_INIT(l4d_answer);
  a.status = status;
  a.offset = static_cast<uint64_t>(offset);
  a.total_bytes = static_cast<uint64_t>(total_bytes);
  a.version = static_cast<uint64_t>(version);
  a.retry_after = retry_after;
  return l4d_playback_answered(s->playback, now, id, &a);
}

// The next n bytes of an answer, which lie in the input.
l4d_status L4DW_EXPORT(l4dw_received)(Session* s, double now, uint32_t id, uint32_t n) {
  return l4d_playback_received(s->playback, now, id, s->input.data(), n);
}

l4d_status L4DW_EXPORT(l4dw_finished)(Session* s, double now, uint32_t id, uint32_t outcome) {
  return l4d_playback_finished(s->playback, now, id, outcome);
}

l4d_status L4DW_EXPORT(l4dw_loaded)(Session* s, double now, uint32_t id, uint32_t units,
                                    l4d_status status) {
  return l4d_playback_loaded(s->playback, now, id, units, status);
}

// The URI of a source, ended by a zero byte; null: there is no such source.
const char* L4DW_EXPORT(l4dw_uri)(Session* s, uint32_t source) {
  const char* uri = nullptr;
  return l4d_playback_get_uri(s->playback, source, &uri) == L4D_OK ? uri : nullptr;
}

// Numbers: where each span begins and ends.
l4d_status L4DW_EXPORT(l4dw_buffered)(Session* s) {
  return guarded([&] {
    std::vector<l4d_time_span> spans;
    const l4d_status status = list_all(
        &spans, [&](auto... out) { return l4d_playback_get_buffered(s->playback, out...); });
    s->numbers.clear();
    for (const l4d_time_span& span : spans) put(*s, {span.begin, span.end});
    return status;
  });
}

// All members, as get_shown lists them. Numbers, of each: stream, whether it is a standing member,
// begin, end, shift.
l4d_status L4DW_EXPORT(l4dw_shown)(Session* s) {
  return guarded([&] {
    std::vector<l4d_shown_member> members;
    const l4d_status status = list_all(&members, [&](auto... out) {
      return l4d_playback_get_shown(s->playback, -INFINITY, INFINITY, out...);
    });
    s->numbers.clear();
    for (const l4d_shown_member& m : members) {
      put(*s, {number(m.stream), number(m.standing), m.begin, m.end, m.shift});
    }
    return status;
  });
}

// The 3D Gaussians of an instant that is ready. Numbers: their number, the degree of SH, and the
// places of position, covariance, opacity and, with sh, of SH.
l4d_status L4DW_EXPORT(l4dw_slice)(Session* s, double time, uint32_t sh) {
  return guarded([&] {
    l4d_playback_state state = L4D_INIT(l4d_playback_state);
    l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
    l4d_status status = l4d_playback_get_state(s->playback, &state);
    if (status == L4D_OK) status = l4d_playback_slice(s->playback, time, &b);
    if (status != L4D_OK) return status;
    const size_t n = static_cast<size_t>(b.count);
    const size_t terms = size_t{state.sh_degree + 1} * (state.sh_degree + 1);
    l4d::web::Unset<float>* const to[] = {&s->floats[kPosition], &s->floats[kCovariance],
                                          &s->floats[kOpacity], &s->floats[kSh]};
    const size_t widths[] = {3, 6, 1, sh != 0 ? 3 * terms : 0};
    for (size_t k = 0; k < 4; ++k) to[k]->resize(n * widths[k]);
    b.capacity = n;
    b.position = to[0]->data();
    b.covariance = to[1]->data();
    b.opacity = to[2]->data();
    b.sh = sh != 0 ? to[3]->data() : nullptr;
    status = l4d_playback_slice(s->playback, time, &b);
    if (status != L4D_OK) return status;
    s->numbers.clear();
    put(*s, {number(n), number(state.sh_degree)});
    for (const l4d::web::Unset<float>* v : to) put(*s, {place_of(v->data())});
    return status;
  });
}

// ---- streams

// The stream that the calls below are of. Fails where it is not open.
l4d_status L4DW_EXPORT(l4dw_select)(Session* s, uint32_t stream) {
  return l4d_playback_get_decoder(s->playback, stream, &s->decoder);
}

// Numbers: as `infoFields` of web/core/src/decoder.js lists them, and then the tiers of layers that
// have Gaussians.
l4d_status L4DW_EXPORT(l4dw_info)(Session* s) {
  return guarded([&] {
    l4d_info i;
    const l4d_status status = info_of(*s, &i);
    if (status != L4D_OK) return status;
    s->numbers.clear();
    put(*s, {number(i.format_major), number(i.format_minor), number(i.sh_degree), number(i.tools),
             number(i.num_layers), number(i.num_gaussians), number(i.file_bytes),
             i.timeline.time_begin, number(i.timeline.num_frames), number(i.timeline.fps_num),
             number(i.timeline.fps_den), i.duration, number(i.placement.coordinate_system),
             number(i.placement.color_space), number(i.profile), number(i.level)});
    l4d_layer_info layer = L4D_INIT(l4d_layer_info);
    for (uint32_t l = 0; l < i.num_layers; ++l) {
      if (l4d_decoder_get_layer_info(s->decoder, l, &layer) != L4D_OK) continue;
      if (layer.num_gaussians > 0) put(*s, {number(layer.tier)});
    }
    return status;
  });
}

// How the scene asks to be drawn and shown. Numbers: dilation, cut-off, least and greatest alpha,
// compensation; playback, metres per unit; whether there are bounds, and both corners; whether
// there is a camera, its position, target and up direction, and its vertical field of view.
l4d_status L4DW_EXPORT(l4dw_statements)(Session* s) {
  return guarded([&] {
    l4d_rendering r = L4D_INIT(l4d_rendering);
    l4d_presentation p = L4D_INIT(l4d_presentation);
    l4d_status status = l4d_decoder_get_rendering(s->decoder, &r);
    if (status == L4D_OK) status = l4d_decoder_get_presentation(s->decoder, &p);
    if (status != L4D_OK) return status;
    const auto put_vector = [&](const double* v) { put(*s, {v[0], v[1], v[2]}); };
    s->numbers.clear();
    put(*s, {r.dilation, r.cutoff, r.min_alpha, r.max_alpha, number(r.compensation),
             number(p.playback), p.metres_per_unit, number(p.has_bounds)});
    put_vector(p.bounds_min);
    put_vector(p.bounds_max);
    put(*s, {number(p.has_camera)});
    put_vector(p.camera_position);
    put_vector(p.camera_target);
    put_vector(p.camera_up);
    put(*s, {p.camera_fov});
    return status;
  });
}

// Decodes a bucket to rows (rows.h), with SH of a degree, which may be higher than that of the
// stream. Numbers: rows, their SH stride in binary16 numbers, centre, place of the geometry, place
// of SH.
l4d_status L4DW_EXPORT(l4dw_rows)(Session* s, uint32_t layer, uint32_t bucket, uint32_t detail,
                                  uint32_t sh_degree) {
  return guarded([&] {
    const l4d_bucket wanted{layer, bucket};
    l4d_query query = query_of(L4D_QUERY_BUCKETS, 0, 0, detail);
    query.buckets = &wanted;
    query.num_buckets = 1;
    std::vector<l4d_bucket_span> ranges;
    l4d_status status = decode(*s, query, true, &ranges);
    l4d_info info;
    l4d_layer_info layer_info = L4D_INIT(l4d_layer_info);
    if (status == L4D_OK) status = info_of(*s, &info);
    if (status == L4D_OK) status = l4d_decoder_get_layer_info(s->decoder, layer, &layer_info);
    if (status != L4D_OK) return status;
    l4d_gaussians g = L4D_INIT(l4d_gaussians);
    g.count = s->floats[kOpacity].size();
    g.sh_degree = info.sh_degree;
    g.flags = info.flags;
    g.position = s->floats[kPosition].data();
    g.mean_t = s->floats[kMeanTime].data();
    g.log_scale = s->floats[kLogScale].data();
    g.rotor = s->floats[kRotor].data();
    g.opacity = s->floats[kOpacity].data();
    g.window = s->windows.empty() ? nullptr : s->windows.data();
    const double center = ranges.empty() ? info.timeline.time_begin : ranges[0].center;
    s->rows.fill(g, s->floats[kMeanTimeLocal].data(), s->halves.data(), info.timeline, center,
                 layer_info.permanent != 0, std::max(sh_degree, info.sh_degree));
    s->numbers.clear();
    put(*s, {number(s->rows.count), number(s->rows.sh_stride), center,
             place_of(s->rows.geometry.data()), place_of(s->rows.sh.data())});
    return status;
  });
}

// Decodes [begin, end], or everything where it is empty. Numbers: Gaussians, the places of
// position, mean_t, mean_t_local, log_scale, rotor, opacity and sh, and whether there are windows
// and their place.
l4d_status L4DW_EXPORT(l4dw_decode)(Session* s, double begin, double end, uint32_t detail) {
  return guarded([&] {
    const l4d_query query =
        query_of(begin <= end ? (begin == end ? L4D_QUERY_TIME : L4D_QUERY_RANGE) : L4D_QUERY_ALL,
                 begin, end, detail);
    std::vector<l4d_bucket_span> ranges;
    const l4d_status status = decode(*s, query, false, &ranges);
    if (status != L4D_OK) return status;
    s->numbers.clear();
    put(*s, {number(s->floats[kOpacity].size())});
    for (size_t k = kPosition; k <= kSh; ++k) {
      put(*s, {place_of(s->floats[k].data())});
    }
    put(*s, {s->windows.empty() ? 0.0 : 1.0, place_of(s->windows.data())});
    return status;
  });
}

// What the last call of a stream has lost. Numbers, of each: status, layer, bucket, Gaussians, byte
// offset or -1, place of the clause, whether SH detail alone.
l4d_status L4DW_EXPORT(l4dw_losses)(Session* s) {
  return guarded([&] {
    std::vector<l4d_loss> losses;
    const l4d_status status =
        list_all(&losses, [&](auto... out) { return l4d_decoder_get_losses(s->decoder, out...); });
    s->numbers.clear();
    for (const l4d_loss& l : losses) {
      put(*s, {static_cast<double>(l.status), number(l.layer), number(l.bucket),
               number(l.num_gaussians), l.offset == UINT64_MAX ? -1 : number(l.offset),
               place_of(l.clause), number(l.detail_only)});
    }
    return status;
  });
}

// Looks for [begin, end] in the directory, of which some may be lost.
l4d_status L4DW_EXPORT(l4dw_look)(Session* s, double begin, double end) {
  const l4d_query query = query_of(L4D_QUERY_RANGE, begin, end, L4D_DETAIL_FULL);
  l4d_selection selection = L4D_INIT(l4d_selection);
  return l4d_decoder_select(s->decoder, &query, &selection);
}

// Gives back what the last calls have decoded.
void L4DW_EXPORT(l4dw_release)(Session* s) {
  for (l4d::web::Unset<float>& v : s->floats) v.clear();
  s->halves.clear();
  std::vector<uint32_t>().swap(s->windows);
  s->rows = {};
}

}  // extern "C"
