// SPDX-License-Identifier: Apache-2.0
// The decoder as a WebAssembly module: functions of plain numbers and of places in its memory.
// Lists that a call makes lie where l4dw_data says, until the next call that makes one. Bytes of
// the stream come from the host, which answers at once; what it does not have fails the call with
// L4D_ERR_IO, and the host, which knows what it was asked, fetches that and calls again.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <new>
#include <vector>

#include "l4d/rate.h"
#include "web/wasm/rows.h"
#include "web/wasm/unset.h"

#define L4DW_EXPORT(name) __attribute__((export_name(#name))) name

extern "C" {
// Copies n bytes at `offset` to `to`. Returns n, less at the end of the stream, or -1.
__attribute__((import_module("l4d"), import_name("read_at"))) double l4dw_host_read(int32_t stream,
                                                                                    uint8_t* to,
                                                                                    uint32_t n,
                                                                                    double offset);
}

namespace {

struct Session {
  l4d_decoder* decoder = nullptr;
  l4d_rate* rate = nullptr;
  int32_t stream = 0;  // what the host calls it
  double size = 0;
  std::vector<double> numbers;
  l4d::web::Unset<float> floats[8];
  std::vector<uint32_t> windows;  // [count, 2] of a stream with flat windows, else empty
  l4d::web::Rows rows;
};

int64_t read_at(void* user, void* dst, size_t n, uint64_t offset) {
  const Session& s = *static_cast<Session*>(user);
  return static_cast<int64_t>(l4dw_host_read(
      s.stream, static_cast<uint8_t*>(dst), static_cast<uint32_t>(n), static_cast<double>(offset)));
}

int64_t size_of(void* user) { return static_cast<int64_t>(static_cast<Session*>(user)->size); }

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

l4d_query query_of(uint32_t kind, double begin, double end, uint32_t detail) {
  l4d_query query;
  l4d_query_init(&query);
  query.kind = kind;
  query.time_begin = begin;
  query.time_end = end;
  query.detail = detail;
  query.whole_buckets = 1;
  return query;
}

// Whole buckets of [begin, end].
l4d_query window_of(double begin, double end, uint32_t max_level, uint32_t max_tier,
                    uint32_t detail) {
  l4d_query query = query_of(begin == end ? L4D_QUERY_TIME : L4D_QUERY_RANGE, begin, end, detail);
  query.max_level = max_level;
  query.max_tier = max_tier;
  return query;
}

l4d_query query_of(const l4d_bucket* buckets, uint32_t count, uint32_t detail) {
  l4d_query query = query_of(L4D_QUERY_BUCKETS, 0, 0, detail);
  query.buckets = buckets;
  query.num_buckets = count;
  return query;
}

l4d_status list_reads(Session& s, const l4d_query& query, uint32_t step) {
  uint64_t count = 16;  // hardly ever more, and the call costs more than room for them
  std::vector<l4d_byte_range> ranges;
  do {
    ranges.resize(static_cast<size_t>(count));
    const l4d_status status =
        l4d_decoder_get_reads(s.decoder, &query, step, ranges.data(), ranges.size(), &count);
    if (status != L4D_OK) return status;
  } while (count > ranges.size());
  ranges.resize(static_cast<size_t>(count));
  s.numbers.clear();
  for (const l4d_byte_range& r : ranges) {
    put(s, {static_cast<double>(r.offset), static_cast<double>(r.size)});
  }
  return L4D_OK;
}

l4d_status info_of(Session& s, l4d_info* info) {
  l4d_info_init(info);
  return l4d_decoder_get_info(s.decoder, info);
}

// Which of the arrays of a decoded bucket lies where in Session::floats.
enum { kPosition, kMeanTime, kMeanTimeLocal, kLogScale, kRotor, kOpacity, kSh, kCovariance };

l4d_status decode(Session& s, const l4d_query& query, std::vector<l4d_bucket_span>* ranges) {
  l4d_info info;
  l4d_selection selection;
  l4d_selection_init(&selection);
  l4d_status status = info_of(s, &info);
  if (status == L4D_OK) status = l4d_decoder_select(s.decoder, &query, &selection);
  if (status != L4D_OK) return status;
  const size_t n = static_cast<size_t>(selection.num_gaussians);
  const size_t terms = size_t{info.sh_degree + 1} * (info.sh_degree + 1);
  const size_t widths[] = {3, 1, 1, 4, 8, 1, 3 * terms, 0};
  for (size_t k = 0; k < 8; ++k) s.floats[k].resize(n * widths[k]);
  s.windows.resize((info.tools & L4D_TOOL_FLAT_WINDOWS) != 0 ? 2 * n : 0);
  ranges->resize(static_cast<size_t>(selection.num_spans));
  l4d_gaussian_buffers b;
  l4d_gaussian_buffers_init(&b);
  b.capacity = n;
  b.position = s.floats[kPosition].data();
  b.mean_t = s.floats[kMeanTime].data();
  b.mean_t_local = s.floats[kMeanTimeLocal].data();
  b.log_scale = s.floats[kLogScale].data();
  b.rotor = s.floats[kRotor].data();
  b.opacity = s.floats[kOpacity].data();
  b.sh = s.floats[kSh].data();
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

// accept_needs: opens streams that need others to show the scene.
Session* L4DW_EXPORT(l4dw_create)(int32_t stream, double max_memory_bytes, double cache_bytes,
                                  uint32_t tolerant, uint32_t accept_needs) {
  Session* s = new (std::nothrow) Session;
  if (s == nullptr) return nullptr;
  s->stream = stream;
  l4d_decoder_options options;
  l4d_decoder_options_init(&options);
  options.threads = 1;
  options.tolerant = tolerant;
  options.accept_needs = accept_needs;
  options.max_memory_bytes = static_cast<uint64_t>(max_memory_bytes);
  options.cache_bytes = static_cast<uint64_t>(cache_bytes);
  if (l4d_decoder_create(&options, &s->decoder) != L4D_OK) {
    delete s;
    return nullptr;
  }
  return s;
}

void L4DW_EXPORT(l4dw_destroy)(Session* s) {
  if (s != nullptr) {
    l4d_rate_destroy(s->rate);
    l4d_decoder_destroy(s->decoder);
  }
  delete s;
}

// Why the last call failed, ended by a zero byte.
const char* L4DW_EXPORT(l4dw_error)(const Session* s) {
  return l4d_decoder_error_message(s->decoder);
}
const char* L4DW_EXPORT(l4dw_status_name)(l4d_status status) { return l4d_status_name(status); }

const double* L4DW_EXPORT(l4dw_numbers)(const Session* s) { return s->numbers.data(); }
uint32_t L4DW_EXPORT(l4dw_num_numbers)(const Session* s) {
  return static_cast<uint32_t>(s->numbers.size());
}

l4d_status L4DW_EXPORT(l4dw_open)(Session* s, double size) {
  s->size = size;
  l4d_reader reader;
  l4d_reader_init(&reader);
  reader.user = s;
  reader.read_at = read_at;
  reader.size = size_of;
  return l4d_decoder_open(s->decoder, &reader);
}

// Numbers: as `infoFields` of web/core/src/decoder.js lists them.
l4d_status L4DW_EXPORT(l4dw_info)(Session* s) {
  return guarded([&] {
    l4d_info i;
    const l4d_status status = info_of(*s, &i);
    if (status != L4D_OK) return status;
    l4d_layer_info layer;
    l4d_layer_info_init(&layer);
    uint32_t last_tier = 0;
    for (uint32_t l = 0; l < i.num_layers; ++l) {
      if (l4d_decoder_get_layer_info(s->decoder, l, &layer) != L4D_OK) continue;
      last_tier = std::max(last_tier, layer.tier);
    }
    const auto number = [](auto v) { return static_cast<double>(v); };
    s->numbers.clear();
    put(*s,
        {number(i.format_major), number(i.format_minor), number(i.sh_degree), number(i.tools),
         number(i.num_layers), number(i.num_gaussians), number(i.file_bytes), i.timeline.time_begin,
         number(i.timeline.num_frames), number(i.timeline.fps_num), number(i.timeline.fps_den),
         i.duration, number(i.placement.coordinate_system), number(i.placement.color_space),
         number(i.profile), number(i.level), number(last_tier)});
    return status;
  });
}

// How the scene asks to be drawn and shown. Numbers: dilation, cut-off, least and greatest alpha,
// compensation; playback, metres per unit; whether there are bounds, and both corners; whether
// there is a camera, its position, target and up direction, and its vertical field of view.
l4d_status L4DW_EXPORT(l4dw_statements)(Session* s) {
  return guarded([&] {
    l4d_rendering r;
    l4d_rendering_init(&r);
    l4d_presentation p;
    l4d_presentation_init(&p);
    l4d_status status = l4d_decoder_get_rendering(s->decoder, &r);
    if (status == L4D_OK) status = l4d_decoder_get_presentation(s->decoder, &p);
    if (status != L4D_OK) return status;
    const auto put_vector = [&](const double* v) { put(*s, {v[0], v[1], v[2]}); };
    s->numbers.clear();
    put(*s,
        {r.dilation, r.cutoff, r.min_alpha, r.max_alpha, static_cast<double>(r.compensation),
         static_cast<double>(p.playback), p.metres_per_unit, static_cast<double>(p.has_bounds)});
    put_vector(p.bounds_min);
    put_vector(p.bounds_max);
    put(*s, {static_cast<double>(p.has_camera)});
    put_vector(p.camera_position);
    put_vector(p.camera_target);
    put_vector(p.camera_up);
    put(*s, {p.camera_fov});
    return status;
  });
}

// The buckets that a player must hold to show any instant of [begin, end]. Numbers, of each: layer,
// bucket, Gaussians, centre, width, temporal level.
l4d_status L4DW_EXPORT(l4dw_buckets)(Session* s, double begin, double end, uint32_t max_level,
                                     uint32_t max_tier) {
  return guarded([&]() -> l4d_status {
    const l4d_query query = window_of(begin, end, max_level, max_tier, L4D_DETAIL_FULL);
    uint64_t count = 64;
    std::vector<l4d_bucket_span> ranges;
    do {
      ranges.resize(static_cast<size_t>(count));
      const l4d_status status =
          l4d_decoder_get_spans(s->decoder, &query, ranges.data(), ranges.size(), &count);
      if (status != L4D_OK) return status;
    } while (count > ranges.size());
    ranges.resize(static_cast<size_t>(count));
    s->numbers.clear();
    for (const l4d_bucket_span& r : ranges) {
      put(*s, {static_cast<double>(r.layer), static_cast<double>(r.bucket),
               static_cast<double>(r.count), r.center, r.width, static_cast<double>(r.level)});
    }
    return L4D_OK;
  });
}

// What must be read for l4dw_buckets (step: L4D_READS_*). Numbers, of each range: offset, size.
l4d_status L4DW_EXPORT(l4dw_window_reads)(Session* s, double begin, double end, uint32_t max_level,
                                          uint32_t max_tier, uint32_t detail, uint32_t step) {
  return guarded(
      [&] { return list_reads(*s, window_of(begin, end, max_level, max_tier, detail), step); });
}

// What must be read for l4dw_rows of each of these buckets, in order of layer and bucket.
l4d_status L4DW_EXPORT(l4dw_bucket_reads)(Session* s, const l4d_bucket* buckets, uint32_t count,
                                          uint32_t detail, uint32_t step) {
  return guarded([&] { return list_reads(*s, query_of(buckets, count, detail), step); });
}

// Decodes a bucket to rows (rows.h). Numbers: rows, their SH stride in binary16 numbers, centre,
// place of the geometry, place of SH, Gaussians that were left out.
l4d_status L4DW_EXPORT(l4dw_rows)(Session* s, uint32_t layer, uint32_t bucket, uint32_t detail) {
  return guarded([&] {
    const l4d_bucket wanted{layer, bucket};
    std::vector<l4d_bucket_span> ranges;
    l4d_status status = decode(*s, query_of(&wanted, 1, detail), &ranges);
    l4d_info info;
    l4d_layer_info layer_info;
    l4d_layer_info_init(&layer_info);
    if (status == L4D_OK) status = info_of(*s, &info);
    if (status == L4D_OK) status = l4d_decoder_get_layer_info(s->decoder, layer, &layer_info);
    if (status != L4D_OK) return status;
    const size_t count = s->floats[kOpacity].size();
    l4d_gaussians g;
    l4d_gaussians_init(&g);
    g.count = count;
    g.sh_degree = info.sh_degree;
    g.flags = info.flags;
    g.position = s->floats[kPosition].data();
    g.mean_t = s->floats[kMeanTime].data();
    g.log_scale = s->floats[kLogScale].data();
    g.rotor = s->floats[kRotor].data();
    g.opacity = s->floats[kOpacity].data();
    g.sh = s->floats[kSh].data();
    g.window = s->windows.empty() ? nullptr : s->windows.data();
    const double center = ranges.empty() ? info.timeline.time_begin : ranges[0].center;
    s->rows.fill(g, s->floats[kMeanTimeLocal].data(), info.timeline, center,
                 layer_info.permanent != 0);
    s->numbers.clear();
    put(*s, {static_cast<double>(s->rows.count), static_cast<double>(s->rows.sh_stride), center,
             place_of(s->rows.geometry.data()), place_of(s->rows.sh.data()),
             static_cast<double>(count - s->rows.count)});
    return status;
  });
}

// Decodes [begin, end], or everything where it is empty. Numbers: Gaussians, the places of
// position, mean_t, mean_t_local, log_scale, rotor, opacity and sh, and whether there are windows
// and their place.
l4d_status L4DW_EXPORT(l4dw_decode)(Session* s, double begin, double end, uint32_t detail) {
  return guarded([&] {
    l4d_query query =
        query_of(begin <= end ? (begin == end ? L4D_QUERY_TIME : L4D_QUERY_RANGE) : L4D_QUERY_ALL,
                 begin, end, detail);
    query.whole_buckets = 0;
    std::vector<l4d_bucket_span> ranges;
    const l4d_status status = decode(*s, query, &ranges);
    if (status != L4D_OK) return status;
    s->numbers.clear();
    put(*s, {static_cast<double>(s->floats[kOpacity].size())});
    for (size_t k = kPosition; k <= kSh; ++k) {
      put(*s, {place_of(s->floats[k].data())});
    }
    put(*s, {s->windows.empty() ? 0.0 : 1.0, place_of(s->windows.data())});
    return status;
  });
}

// The 3D Gaussians of an instant. Numbers: their number, and the places of position, covariance,
// opacity and, with sh, of SH.
l4d_status L4DW_EXPORT(l4dw_slice)(Session* s, double time, uint32_t max_tier, uint32_t detail,
                                   uint32_t sh) {
  return guarded([&] {
    l4d_info info;
    l4d_status status = info_of(*s, &info);
    if (status == L4D_OK) status = l4d_decoder_set_detail(s->decoder, detail);
    if (status == L4D_OK) status = l4d_decoder_set_layers(s->decoder, UINT32_MAX, max_tier);
    if (status != L4D_OK) return status;
    l4d_splat_buffers b;
    l4d_splat_buffers_init(&b);
    status = l4d_decoder_slice(s->decoder, time, &b);
    if (status != L4D_OK) return status;
    const size_t n = static_cast<size_t>(b.count);
    const size_t terms = size_t{info.sh_degree + 1} * (info.sh_degree + 1);
    l4d::web::Unset<float>* const to[] = {&s->floats[kPosition], &s->floats[kCovariance],
                                          &s->floats[kOpacity], &s->floats[kSh]};
    const size_t widths[] = {3, 6, 1, sh != 0 ? 3 * terms : 0};
    for (size_t k = 0; k < 4; ++k) to[k]->resize(n * widths[k]);
    b.capacity = n;
    b.position = to[0]->data();
    b.covariance = to[1]->data();
    b.opacity = to[2]->data();
    b.sh = sh != 0 ? to[3]->data() : nullptr;
    status = l4d_decoder_slice(s->decoder, time, &b);
    if (status != L4D_OK) return status;
    s->numbers.clear();
    put(*s, {static_cast<double>(n)});
    for (const l4d::web::Unset<float>* v : to) {
      put(*s, {place_of(v->data())});
    }
    return status;
  });
}

// What the last call of a tolerant session has lost. Numbers, of each: status, layer, bucket,
// Gaussians, byte offset or -1, place of the clause, whether SH detail alone.
l4d_status L4DW_EXPORT(l4dw_losses)(Session* s) {
  return guarded([&] {
    uint64_t count = 0;
    l4d_status status = l4d_decoder_get_losses(s->decoder, nullptr, 0, &count);
    if (status != L4D_OK) return status;
    std::vector<l4d_loss> losses(static_cast<size_t>(count));
    status = l4d_decoder_get_losses(s->decoder, losses.data(), count, &count);
    s->numbers.clear();
    for (const l4d_loss& l : losses) {
      const double offset = l.offset == UINT64_MAX ? -1 : static_cast<double>(l.offset);
      put(*s, {static_cast<double>(l.status), static_cast<double>(l.layer),
               static_cast<double>(l.bucket), static_cast<double>(l.num_gaussians), offset,
               place_of(l.clause), static_cast<double>(l.detail_only)});
    }
    return status;
  });
}

// Begins to measure a link, for a ladder of so many rungs.
l4d_status L4DW_EXPORT(l4dw_rate_begin)(Session* s, uint32_t num_rungs) {
  l4d_rate_destroy(s->rate);
  s->rate = nullptr;
  return l4d_rate_create(nullptr, num_rungs, &s->rate);
}

l4d_status L4DW_EXPORT(l4dw_rate_add)(Session* s, double sent, double first_byte, double last_byte,
                                      double bytes) {
  return l4d_rate_add_transfer(s->rate, sent, first_byte, last_byte, static_cast<uint64_t>(bytes));
}

// states: [num_rungs, 2]: buffered seconds and missing bytes. Numbers: rung, fill_rung, cancel,
// merge_gap, max_range_bytes, throughput, round_trip.
l4d_status L4DW_EXPORT(l4dw_rate_choose)(Session* s, const double* states, uint32_t num_rungs) {
  return guarded([&] {
    std::vector<l4d_rung_state> rungs(num_rungs);
    for (uint32_t r = 0; r < num_rungs; ++r) {
      rungs[r] = {states[2 * r], static_cast<uint64_t>(states[2 * r + 1])};
    }
    l4d_rate_choice c;
    l4d_rate_choice_init(&c);
    const l4d_status status = l4d_rate_choose(s->rate, rungs.data(), num_rungs, &c);
    s->numbers.clear();
    put(*s, {static_cast<double>(c.rung), static_cast<double>(c.fill_rung),
             static_cast<double>(c.cancel), static_cast<double>(c.merge_gap),
             static_cast<double>(c.max_range_bytes), c.throughput, c.round_trip});
    return status;
  });
}

// Gives back what the last calls have decoded.
void L4DW_EXPORT(l4dw_release)(Session* s) {
  for (l4d::web::Unset<float>& v : s->floats) v.clear();
  std::vector<uint32_t>().swap(s->windows);
  s->rows = {};
}

}  // extern "C"
