// SPDX-License-Identifier: Apache-2.0
// The decoder as a WebAssembly module: functions of plain numbers and of places in its memory.
// Lists that a call makes lie where l4dw_data says, until the next call that makes one. Bytes of
// the stream come from the host, which answers at once; what it does not have fails the call with
// L4D_ERR_IO, and the host, which knows what it was asked, fetches that and calls again.
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <new>
#include <vector>

#include "l4d/decode.h"
#include "web/wasm/floats.h"
#include "web/wasm/rows.h"

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
  int32_t stream = 0;  // what the host calls it
  double size = 0;
  std::vector<double> numbers;
  l4d::web::Floats floats[8];
  l4d::web::Rows rows;
};

int64_t read_at(void* user, void* dst, size_t n, uint64_t offset) {
  const Session& s = *static_cast<Session*>(user);
  return static_cast<int64_t>(l4dw_host_read(
      s.stream, static_cast<uint8_t*>(dst), static_cast<uint32_t>(n), static_cast<double>(offset)));
}

int64_t size_of(void* user) { return static_cast<int64_t>(static_cast<Session*>(user)->size); }

// Calls fn, which returns a status.
template <typename Function>
l4d_status guarded(const Function& fn) {
  try {
    return fn();
  } catch (const std::bad_alloc&) {
    return L4D_ERR_OUT_OF_MEMORY;
  } catch (...) {
    return L4D_ERR_INTERNAL;
  }
}

l4d_query query_of(uint32_t kind, double begin, double end, uint32_t max_level, uint32_t detail) {
  l4d_query query;
  l4d_query_init(&query);
  query.kind = kind;
  query.time_begin = begin;
  query.time_end = end;
  query.max_level = max_level;
  query.detail = detail;
  query.whole_buckets = 1;
  return query;
}

l4d_query query_of(const l4d_bucket* buckets, uint32_t count, uint32_t detail) {
  l4d_query query = query_of(L4D_QUERY_BUCKETS, 0, 0, std::numeric_limits<uint32_t>::max(), detail);
  query.buckets = buckets;
  query.num_buckets = count;
  return query;
}

l4d_status list_reads(Session& s, const l4d_query& query, uint32_t step) {
  uint64_t count = 0;
  const l4d_status status = l4d_decoder_get_reads(s.decoder, &query, step, nullptr, 0, &count);
  if (status != L4D_OK) return status;
  std::vector<l4d_byte_range> ranges(static_cast<size_t>(count));
  const l4d_status again =
      l4d_decoder_get_reads(s.decoder, &query, step, ranges.data(), count, &count);
  if (again != L4D_OK) return again;
  s.numbers.clear();
  for (const l4d_byte_range& r : ranges) {
    s.numbers.push_back(static_cast<double>(r.offset));
    s.numbers.push_back(static_cast<double>(r.size));
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
  // The arrays hold no windows; without them all frames would be seen at once.
  if (status == L4D_OK && (info.tools & L4D_TOOL_FLAT_WINDOWS) != 0) {
    return L4D_ERR_FEATURE_UNSUPPORTED;
  }
  if (status == L4D_OK) status = l4d_decoder_select(s.decoder, &query, &selection);
  if (status != L4D_OK) return status;
  const size_t n = static_cast<size_t>(selection.num_gaussians);
  const size_t terms = size_t{info.sh_degree + 1} * (info.sh_degree + 1);
  const size_t widths[] = {3, 1, 1, 4, 8, 1, 3 * terms, 0};
  for (size_t k = 0; k < 8; ++k) s.floats[k].resize(n * widths[k]);
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

Session* L4DW_EXPORT(l4dw_create)(int32_t stream, double max_memory_bytes, double cache_bytes,
                                  uint32_t tolerant) {
  Session* s = new (std::nothrow) Session;
  if (s == nullptr) return nullptr;
  s->stream = stream;
  l4d_decoder_options options;
  l4d_decoder_options_init(&options);
  options.threads = 1;
  options.tolerant = tolerant;
  options.max_memory_bytes = static_cast<uint64_t>(max_memory_bytes);
  options.cache_bytes = static_cast<uint64_t>(cache_bytes);
  if (l4d_decoder_create(&options, &s->decoder) != L4D_OK) {
    delete s;
    return nullptr;
  }
  return s;
}

void L4DW_EXPORT(l4dw_destroy)(Session* s) {
  if (s != nullptr) l4d_decoder_destroy(s->decoder);
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

// Numbers: offset and size of the scene header, from the first L4D_FILE_HEADER_BYTES bytes.
l4d_status L4DW_EXPORT(l4dw_header_range)(Session* s, const uint8_t* head, uint32_t size) {
  return guarded([&] {
    l4d_byte_range range;
    const l4d_status status = l4d_get_header_range(head, size, &range);
    if (status == L4D_OK) {
      s->numbers = {static_cast<double>(range.offset), static_cast<double>(range.size)};
    }
    return status;
  });
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
    const auto number = [](auto v) { return static_cast<double>(v); };
    s->numbers = {number(i.format_major),
                  number(i.format_minor),
                  number(i.sh_degree),
                  number(i.tools),
                  number(i.num_layers),
                  number(i.num_gaussians),
                  number(i.file_bytes),
                  i.timeline.time_begin,
                  number(i.timeline.num_frames),
                  number(i.timeline.fps_num) / number(i.timeline.fps_den),
                  i.duration,
                  number(i.placement.coordinate_system),
                  number(i.placement.color_space),
                  number(i.profile),
                  number(i.level)};
    return status;
  });
}

// The buckets that a player must hold to show any instant of [begin, end]. Numbers, of each: layer,
// bucket, Gaussians, centre, width, temporal level.
l4d_status L4DW_EXPORT(l4dw_buckets)(Session* s, double begin, double end, uint32_t max_level) {
  return guarded([&] {
    const l4d_query query = query_of(begin == end ? L4D_QUERY_TIME : L4D_QUERY_RANGE, begin, end,
                                     max_level, L4D_DETAIL_FULL);
    uint64_t count = 0;
    l4d_status status = l4d_decoder_get_spans(s->decoder, &query, nullptr, 0, &count);
    if (status != L4D_OK) return status;
    std::vector<l4d_bucket_span> ranges(static_cast<size_t>(count));
    status = l4d_decoder_get_spans(s->decoder, &query, ranges.data(), count, &count);
    if (status != L4D_OK) return status;
    s->numbers.clear();
    for (const l4d_bucket_span& r : ranges) {
      for (const double v :
           {static_cast<double>(r.layer), static_cast<double>(r.bucket),
            static_cast<double>(r.count), r.center, r.width, static_cast<double>(r.level)}) {
        s->numbers.push_back(v);
      }
    }
    return status;
  });
}

// What must be read for l4dw_buckets (step: L4D_READS_*). Numbers, of each range: offset, size.
l4d_status L4DW_EXPORT(l4dw_window_reads)(Session* s, double begin, double end, uint32_t max_level,
                                          uint32_t detail, uint32_t step) {
  return guarded([&] {
    return list_reads(
        *s,
        query_of(begin == end ? L4D_QUERY_TIME : L4D_QUERY_RANGE, begin, end, max_level, detail),
        step);
  });
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
    const double center = ranges.empty() ? info.timeline.time_begin : ranges[0].center;
    s->rows.fill(g, s->floats[kMeanTimeLocal].data(), info.timeline, center,
                 layer_info.permanent != 0);
    s->numbers = {static_cast<double>(s->rows.count),
                  static_cast<double>(s->rows.sh_stride),
                  center,
                  static_cast<double>(reinterpret_cast<uintptr_t>(s->rows.geometry.data())),
                  static_cast<double>(reinterpret_cast<uintptr_t>(s->rows.sh.data())),
                  static_cast<double>(count - s->rows.count)};
    return status;
  });
}

// Decodes [begin, end], or everything where it is empty. Numbers: Gaussians, and the places of
// position, mean_t, mean_t_local, log_scale, rotor, opacity and sh.
l4d_status L4DW_EXPORT(l4dw_decode)(Session* s, double begin, double end, uint32_t detail) {
  return guarded([&] {
    l4d_query query =
        query_of(begin <= end ? (begin == end ? L4D_QUERY_TIME : L4D_QUERY_RANGE) : L4D_QUERY_ALL,
                 begin, end, std::numeric_limits<uint32_t>::max(), detail);
    query.whole_buckets = 0;
    std::vector<l4d_bucket_span> ranges;
    const l4d_status status = decode(*s, query, &ranges);
    if (status != L4D_OK) return status;
    s->numbers = {static_cast<double>(s->floats[kOpacity].size())};
    for (size_t k = kPosition; k <= kSh; ++k) {
      s->numbers.push_back(static_cast<double>(reinterpret_cast<uintptr_t>(s->floats[k].data())));
    }
    return status;
  });
}

// The 3D Gaussians of an instant. Numbers: their number, and the places of position, covariance,
// opacity and, with sh, of SH.
l4d_status L4DW_EXPORT(l4dw_slice)(Session* s, double time, uint32_t detail, uint32_t sh) {
  return guarded([&] {
    l4d_info info;
    l4d_status status = info_of(*s, &info);
    if (status == L4D_OK) status = l4d_decoder_set_detail(s->decoder, detail);
    if (status != L4D_OK) return status;
    l4d_splat_buffers b;
    l4d_splat_buffers_init(&b);
    status = l4d_decoder_slice(s->decoder, time, &b);
    if (status != L4D_OK) return status;
    const size_t n = static_cast<size_t>(b.count);
    const size_t terms = size_t{info.sh_degree + 1} * (info.sh_degree + 1);
    l4d::web::Floats* const to[] = {&s->floats[kPosition], &s->floats[kCovariance],
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
    s->numbers = {static_cast<double>(n)};
    for (const l4d::web::Floats* v : to) {
      s->numbers.push_back(static_cast<double>(reinterpret_cast<uintptr_t>(v->data())));
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
      for (const double v : {static_cast<double>(l.status), static_cast<double>(l.layer),
                             static_cast<double>(l.bucket), static_cast<double>(l.num_gaussians),
                             offset, static_cast<double>(reinterpret_cast<uintptr_t>(l.clause)),
                             static_cast<double>(l.detail_only)}) {
        s->numbers.push_back(v);
      }
    }
    return status;
  });
}

// Gives back what the last calls have decoded.
void L4DW_EXPORT(l4dw_release)(Session* s) {
  for (l4d::web::Floats& v : s->floats) v.clear();
  s->rows = {};
}

}  // extern "C"
