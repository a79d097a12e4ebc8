// SPDX-License-Identifier: Apache-2.0
#include "api/decoder_handle.h"
#include "decoder/check/inspection.h"
#include "decoder/read/find_codebook.h"
#include "decoder/session/query.h"
#include "decoder/session/shown_streams.h"
#include "l4d/decode.h"
#include "l4d/experimental/columns.h"
#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"
#include "l4d/members.h"
#include "libl4dcodec/container/levels.h"
#include "libl4dcodec/scene/attributes.h"

using l4d::Status;
using l4d::api::call_on;
using l4d::api::guard;
using l4d::api::keep_last;
using l4d::api::optional;
using l4d::api::read_optional;
using l4d::api::read_struct;
using l4d::api::required;
using l4d::api::write_struct;

namespace {

const char* first_of(const char* a, const char* b) { return a != nullptr ? a : b; }

// The work of a call on an open decoder.
template <typename Body>
l4d_status with_stream(l4d_decoder* decoder, const char* bad, const Body& body) {
  return call_on(decoder, bad, [&]() -> Status {
    if (!decoder->impl.is_open()) return Status(L4D_ERR_INVALID_STATE, "no stream is open");
    return body(decoder->impl);
  });
}
template <typename Body>
l4d_status look_at_stream(const l4d_decoder* decoder, const char* bad, const Body& body) {
  // Without allocating: such a call must not fail for another reason after memory has run out.
  const bool idle = decoder != nullptr && bad == nullptr && !decoder->busy.is_set();
  if (idle && !decoder->impl.is_open()) {
    return l4d::api::fail(L4D_ERR_INVALID_STATE, "no stream is open");
  }
  return call_on(decoder, bad, [&] { return body(decoder->impl); });
}

// Counts violations and hands them on.
l4d::ViolationFn reporter(l4d_violation_fn fn, void* user, uint64_t* count) {
  return [=](const Status& s) {
    ++*count;
    if (fn == nullptr) return;
    l4d_violation v{};
    v.struct_size = sizeof v;
    v.status = s.code();
    v.clause = s.clause();
    v.offset = s.offset();
    v.message = s.message().c_str();
    fn(user, &v);
  };
}

// Copies the result to the caller's struct if the call succeeded, or if it states what it needed.
template <typename T>
Status write_output(const Status& status, const T& from, T* out) {
  if (status.ok() || status.code() == L4D_ERR_BUFFER_TOO_SMALL) write_struct(from, out);
  return status;
}

uint32_t layer_tools(const l4d::SceneHeader& header, const l4d::LayerHeader& layer) {
  uint32_t tools = 0;
  const auto& spatial = layer.component[L4D_COMPONENT_ROTOR_SPATIAL];
  const auto& temporal = layer.component[L4D_COMPONENT_ROTOR_TEMPORAL];
  if (temporal.coding != l4d::ComponentCodingId::kZero) tools |= L4D_TOOL_MOTION;
  if (!layer.permanent) tools |= L4D_TOOL_TEMPORAL_OPACITY;
  if (layer.flat()) tools |= L4D_TOOL_FLAT_WINDOWS;
  if (header.sh_degree > 0) tools |= L4D_TOOL_VIEW_DEPENDENCE;
  if (layer.raw_position) {
    tools |= L4D_TOOL_ESCAPES;
  } else if (spatial.coding == l4d::ComponentCodingId::kRaw32) {
    tools |= L4D_TOOL_LOSSLESS;
  }
  if (layer.has_entropy) tools |= L4D_TOOL_RANS;
  if (layer.has_entropy && header.sh_base > 0) tools |= L4D_TOOL_SH_BASE;
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const l4d::ComponentCoding& coding = header.component(layer, c);
    if (coding.stages.size() > 1) tools |= L4D_TOOL_RESIDUAL_STAGES;
    if (coding.escapes) tools |= L4D_TOOL_ESCAPES;
    if (coding.has_rcq) tools |= L4D_TOOL_RCQ;
    if (coding.transform()) tools |= L4D_TOOL_TRANSFORM;
  }
  return tools;
}

l4d_info describe(const l4d::SceneFile& stream) {
  const l4d::FileHeader& file = stream.file_header();
  const l4d::SceneHeader& header = stream.header();
  l4d_info i{};
  i.format_major = file.version_major;
  i.format_minor = file.version_minor;
  i.development = (file.flags & l4d::FileHeader::kDevelopmentFlag) != 0;
  i.streamable = (file.flags & l4d::FileHeader::kStreamableFlag) != 0;
  i.sh_degree = header.sh_degree;
  i.flags = (header.position_at_mean_time ? uint32_t{L4D_POSITION_AT_MEAN_TIME} : 0u) |
            (header.opacity_logit ? uint32_t{L4D_OPACITY_LOGIT} : 0u);
  i.num_layers = static_cast<uint32_t>(header.layers.size());
  if (header.sh_degree > 0) i.tools |= L4D_TOOL_VIEW_DEPENDENCE;
  for (const l4d::LayerHeader& layer : header.layers) {
    if (layer.num_gaussians > 0) i.tools |= layer_tools(header, layer);
  }
  i.num_gaussians = header.num_gaussians;
  i.file_bytes = stream.source().size();
  i.timeline = header.timeline;
  i.duration = l4d::sequence_duration(header.timeline);
  i.placement = header.placement;
  i.profile = header.profile;
  i.level = header.conformance_level;
  return i;
}

l4d_coding_errors describe_errors(const l4d::ErrorStatement& e) {
  l4d_coding_errors out{};
  if (!e.stated) return out;
  const auto d = [](float v) { return static_cast<double>(v); };
  out.stated = 1;
  out.own_min_sizes = e.own_min_sizes;
  out.position = d(e.position);
  out.covariance = d(e.covariance);
  out.opacity = d(e.opacity);
  out.visible = d(e.visible);
  out.mean_t = d(e.mean_t);
  out.position_bound = d(e.position_bound);
  out.covariance_bound = d(e.covariance_bound);
  out.opacity_bound = d(e.opacity_bound);
  out.visible_bound = d(e.visible_bound);
  out.min_size = d(e.min_size);
  if (!e.colors) return out;
  out.colors_stated = 1;
  out.base_color = d(e.base_color);
  out.directional_color = d(e.directional_color);
  out.base_color_bound = d(e.base_color_bound);
  out.directional_color_bound = d(e.directional_color_bound);
  return out;
}

l4d_layer_info describe_layer(const l4d::SceneFile& stream, uint32_t index) {
  const l4d::SceneHeader& header = stream.header();
  const l4d::LayerHeader& layer = header.layers[index];
  l4d_layer_info i{};
  i.index = index;
  i.level = layer.level;
  i.permanent = layer.permanent;
  i.tier = layer.tier;
  i.symbols_per_gaussian = static_cast<uint32_t>(l4d::most_symbols(header, layer));
  i.tools = layer_tools(header, layer);
  i.num_buckets = l4d::num_buckets(layer.level);
  i.num_gaussians = layer.num_gaussians;
  i.bucket_width = l4d::bucket_width(header.timeline, layer.level);
  i.codebook_bytes = stream.codebook_stored_bytes(index);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const l4d::ComponentCoding& coding = header.component(layer, c);
    i.num_stages[c] = static_cast<uint32_t>(coding.stages.size());
    i.codebook_size[c] = coding.stages.empty() ? 0 : coding.stages[0].num_entries;
    i.coding[c] = static_cast<uint32_t>(coding.coding);
    i.num_coefficients[c] = coding.transform() ? coding.coefficients() : 0;
  }
  return i;
}

Status use_first_device() {
#ifdef L4D_HAVE_CUDA
  return l4d::cuda::use_device(0);
#else
  return Status(L4D_ERR_FEATURE_UNSUPPORTED, "this build has no device code");
#endif
}

// Joins what several streams show. What failed is kept on the handle of which it did.
template <typename Output>
l4d_status slice_streams(const l4d_shown_stream* streams, uint64_t count, Output* out) {
  const char* bad = first_of(required(streams), required(out));
  if (bad == nullptr && count == 0) bad = "count is 0";
  for (uint64_t k = 0; bad == nullptr && k < count; ++k) {
    for (uint64_t before = 0; before < k; ++before) {
      if (streams[before].decoder == streams[k].decoder) bad = "a decoder is listed twice";
    }
  }
  if (bad != nullptr) return l4d::api::fail(L4D_ERR_INVALID_ARGUMENT, bad);
  Output slice = read_struct(*out, Output{});
  if (count == 1) {
    return with_stream(streams->decoder, nullptr, [&](l4d::Decoder& d) -> Status {
      return write_output(d.slicer().slice(streams->time, &slice), slice, out);
    });
  }
  uint32_t degree = 0;
  l4d_status status = L4D_OK;
  for (uint64_t k = 0; k < count && status == L4D_OK; ++k) {
    status = with_stream(streams[k].decoder, nullptr, [&](l4d::Decoder& d) -> Status {
      degree = std::max(degree, uint32_t{d.file().header().sh_degree});
      return {};
    });
  }
  if (status != L4D_OK) return status;
  l4d::ShownStreams<Output> shown(degree, &slice);
  for (uint64_t k = 0; k < count && status == L4D_OK; ++k) {
    status = with_stream(streams[k].decoder, nullptr,
                         [&](l4d::Decoder& d) { return shown.add(d, streams[k].time); });
  }
  if (status != L4D_OK) return status;
  return keep_last(guard([&] { return write_output(shown.finish(), slice, out); }));
}

}  // namespace

extern "C" {

l4d_status l4d_decoder_create(const l4d_decoder_options* options, l4d_decoder** out) {
  return keep_last(guard([&]() -> Status {
    if (const char* bad = first_of(required(out), optional(options))) {
      return l4d::invalid_argument(bad);
    }
    const l4d_decoder_options resolved = read_optional(options);
    if (resolved.backend > L4D_BACKEND_CUDA) {
      return Status(L4D_ERR_FEATURE_UNSUPPORTED, "unknown backend");
    }
    if (resolved.threads > L4D_MAX_THREADS) {
      return l4d::invalid_argument("threads is above L4D_MAX_THREADS");
    }
    if (resolved.backend == L4D_BACKEND_CUDA) L4D_RETURN_IF_ERROR(use_first_device());
    *out = new l4d_decoder(resolved);
    return {};
  }));
}

void l4d_decoder_destroy(l4d_decoder* decoder) {
  if (l4d::api::may_destroy(decoder)) delete decoder;
}

l4d_status l4d_decoder_open(l4d_decoder* decoder, const l4d_reader* reader) {
  return call_on(decoder, required(reader), [&]() -> Status {
    decoder->close_device();
    decoder->impl.close();
    l4d::ByteSource source;
    L4D_RETURN_IF_ERROR(l4d::ByteSource::from_reader(read_struct(*reader), &source));
    return decoder->impl.open(std::move(source));
  });
}

l4d_status l4d_decoder_open_memory(l4d_decoder* decoder, const void* data, size_t size) {
  return call_on(decoder, size > 0 ? required(data) : nullptr, [&]() -> Status {
    decoder->close_device();
    return decoder->impl.open(
        l4d::ByteSource::from_memory(l4d::ByteSpan(static_cast<const unsigned char*>(data), size)));
  });
}

l4d_status l4d_decoder_open_file(l4d_decoder* decoder, const char* path) {
  return call_on(decoder, required(path), [&]() -> Status {
    decoder->close_device();
    return decoder->impl.open_file(path);
  });
}

l4d_status l4d_decoder_get_info(const l4d_decoder* decoder, l4d_info* info) {
  return look_at_stream(decoder, required(info), [&](const l4d::Decoder& d) -> Status {
    write_struct(describe(d.file()), info);
    return {};
  });
}

l4d_status l4d_decoder_get_rendering(const l4d_decoder* decoder, l4d_rendering* rendering) {
  return look_at_stream(decoder, required(rendering), [&](const l4d::Decoder& d) -> Status {
    write_struct(d.file().header().rendering, rendering);
    return {};
  });
}

l4d_status l4d_decoder_get_presentation(const l4d_decoder* decoder,
                                        l4d_presentation* presentation) {
  return look_at_stream(decoder, required(presentation), [&](const l4d::Decoder& d) -> Status {
    write_struct(d.file().header().presentation, presentation);
    return {};
  });
}

l4d_status l4d_decoder_get_metadata(const l4d_decoder* decoder, uint32_t index, const char** key,
                                    const char** value) {
  return look_at_stream(decoder, required(key, value), [&](const l4d::Decoder& d) -> Status {
    const auto& pairs = d.file().header().metadata;
    *key = index < pairs.size() ? pairs[index].first.c_str() : nullptr;
    *value = index < pairs.size() ? pairs[index].second.c_str() : nullptr;
    return {};
  });
}

l4d_status l4d_decoder_get_coding_errors(const l4d_decoder* decoder, l4d_coding_errors* errors) {
  return look_at_stream(decoder, required(errors), [&](const l4d::Decoder& d) -> Status {
    write_struct(describe_errors(d.file().header().errors), errors);
    return {};
  });
}

l4d_status l4d_decoder_get_layer_info(const l4d_decoder* decoder, uint32_t index,
                                      l4d_layer_info* info) {
  return look_at_stream(decoder, required(info), [&](const l4d::Decoder& d) -> Status {
    if (index >= d.file().header().layers.size()) return l4d::invalid_argument("no such layer");
    write_struct(describe_layer(d.file(), index), info);
    return {};
  });
}

l4d_status l4d_decoder_get_sections(l4d_decoder* decoder, uint64_t* sections, uint32_t capacity,
                                    uint32_t* count, uint64_t* layer_bytes,
                                    uint32_t layer_capacity) {
  const char* bad = first_of(capacity > 0 ? required(sections) : nullptr,
                             layer_capacity > 0 ? required(layer_bytes) : nullptr);
  return with_stream(decoder, bad, [&](l4d::Decoder& d) -> Status {
    uint64_t all[L4D_SECTION_COUNT];
    std::vector<uint64_t> layers(d.file().header().layers.size());
    L4D_RETURN_IF_ERROR(l4d::measure_sections(d.file(), d.pages(), all, layers.data()));
    std::copy_n(all, std::min<uint32_t>(capacity, L4D_SECTION_COUNT), sections);
    std::copy_n(layers.begin(), std::min<size_t>(layer_capacity, layers.size()), layer_bytes);
    if (count != nullptr) *count = L4D_SECTION_COUNT;
    return {};
  });
}

l4d_status l4d_decoder_select(l4d_decoder* decoder, const l4d_query* query,
                              l4d_selection* selection) {
  return with_stream(decoder, required(query, selection), [&](l4d::Decoder& d) -> Status {
    l4d_selection s{};
    L4D_RETURN_IF_ERROR(l4d::select_query(d.stream(), read_struct(*query), &s));
    write_struct(s, selection);
    return {};
  });
}

l4d_status l4d_decoder_get_spans(l4d_decoder* decoder, const l4d_query* query, l4d_bucket_span* out,
                                 uint64_t capacity, uint64_t* count) {
  const char* bad = first_of(required(query, count), capacity > 0 ? required(out) : nullptr);
  return with_stream(decoder, bad, [&](l4d::Decoder& d) {
    return l4d::find_ranges(d.stream(), read_struct(*query), out, capacity, count);
  });
}

l4d_status l4d_decoder_decode(l4d_decoder* decoder, const l4d_query* query,
                              l4d_gaussian_buffers* out) {
  return with_stream(decoder, required(query, out), [&](l4d::Decoder& d) -> Status {
    l4d_gaussian_buffers buffers = read_struct(*out);
    const l4d_query q = read_struct(*query);
    const bool on_device = decoder->decodes_on_device && buffers.mean_t_double == nullptr &&
                           buffers.sh_half == nullptr;
    return write_output(on_device ? decoder->decode_on_device(q, &buffers) : d.decode(q, &buffers),
                        buffers, out);
  });
}

l4d_status l4d_decoder_decode_packed(l4d_decoder* decoder, const l4d_query* query,
                                     l4d_packed_buffers* out) {
  return with_stream(decoder, required(query, out), [&](l4d::Decoder& d) -> Status {
    l4d_packed_buffers buffers = read_struct(*out);
    return write_output(d.decode_packed(read_struct(*query), &buffers), buffers, out);
  });
}

l4d_status l4d_decoder_get_codebook(l4d_decoder* decoder, uint32_t layer, uint32_t component,
                                    uint32_t stage, uint32_t block, l4d_codebook* out) {
  return with_stream(decoder, required(out), [&](l4d::Decoder& d) -> Status {
    l4d_codebook codebook{};
    L4D_RETURN_IF_ERROR(l4d::find_codebook(d.file(), layer, component, stage, block, &codebook));
    write_struct(codebook, out);
    return {};
  });
}

l4d_status l4d_decoder_get_dequantization(l4d_decoder* decoder, uint32_t layer,
                                          l4d_dequantization* out) {
  return with_stream(decoder, required(out), [&](l4d::Decoder& d) -> Status {
    const l4d::SceneHeader& header = d.file().header();
    if (layer >= header.layers.size()) return l4d::invalid_argument("no such layer");
    const l4d::ScalarCoding& factor = header.layers[layer].scale_factor;
    l4d_dequantization q{};
    std::copy_n(header.position_center, 3, q.position_center);
    q.position_scale = header.position_scale;
    q.opacity_offset = header.opacity.offset;
    q.opacity_step = header.opacity.step;
    q.scale_factor_offset = factor.offset;
    q.scale_factor_step = factor.step;
    if (header.layers[layer].permanent) {
      q.log_scale_t = l4d::clamp_log_scale(header.layers[layer].log_scale_t);
    }
    write_struct(q, out);
    return {};
  });
}

const char* l4d_profile_name(uint32_t profile) { return l4d::profile_name(profile); }

l4d_status l4d_get_level_limits(uint32_t level, uint32_t profile, l4d_level_limits* limits) {
  if (const char* bad = required(limits)) return l4d::api::fail(L4D_ERR_INVALID_ARGUMENT, bad);
  if (level < 1 || level > L4D_NUM_LEVELS || l4d::profile_name(profile) == nullptr) {
    return l4d::api::fail(L4D_ERR_INVALID_ARGUMENT, "unknown profile or level");
  }
  static_assert(L4D_NUM_LEVELS == l4d::kNumConformanceLevels);
  const l4d::LevelLimits from = l4d::level_limits(level, profile == L4D_PROFILE_LOSSLESS);
  l4d_level_limits l{};
  l.name = from.name;
  l.instant_gaussians = from.gaussians;
  l.table_bytes = from.table_bytes;
  l.instant_bytes = from.instant_bytes;
  l.start_bytes = from.start_bytes;
  l.bytes_per_second = from.bytes_per_second;
  l.burst_bytes = from.burst_bytes;
  l.memory_bytes = from.memory_bytes;
  l.instant_symbols = from.instant_symbols;
  l.symbols_per_second = from.symbols_per_second;
  write_struct(l, limits);
  return L4D_OK;
}

l4d_status l4d_decoder_get_stream_demand(l4d_decoder* decoder, l4d_stream_demand* demand) {
  return with_stream(decoder, required(demand), [&](l4d::Decoder& d) -> Status {
    l4d_stream_demand c = read_struct(*demand);
    L4D_RETURN_IF_ERROR(l4d::inspect_stream_demand(d.file(), &c));
    write_struct(c, demand);
    return {};
  });
}

l4d_status l4d_decoder_check_conformance(l4d_decoder* decoder, uint32_t profile, uint32_t level,
                                         l4d_violation_fn fn, void* user,
                                         uint64_t* num_violations) {
  return with_stream(decoder, required(num_violations), [&](l4d::Decoder& d) {
    *num_violations = 0;
    return l4d::check_requested_conformance(d.file(), profile, level,
                                            reporter(fn, user, num_violations));
  });
}

l4d_status l4d_decoder_slice(l4d_decoder* decoder, double time, l4d_splat_buffers* out) {
  return with_stream(decoder, required(out), [&](l4d::Decoder& d) -> Status {
    l4d_splat_buffers buffers = read_struct(*out);
    return write_output(d.slicer().slice(time, &buffers), buffers, out);
  });
}

l4d_status l4d_slice_streams(const l4d_shown_stream* streams, uint64_t count,
                             l4d_splat_buffers* out) {
  return slice_streams(streams, count, out);
}
l4d_status l4d_slice_streams_columns(const l4d_shown_stream* streams, uint64_t count,
                                     l4d_splat_columns* out) {
  return slice_streams(streams, count, out);
}

l4d_status l4d_decoder_get_losses(const l4d_decoder* decoder, l4d_loss* out, uint64_t capacity,
                                  uint64_t* count) {
  const char* bad = first_of(required(count), capacity > 0 ? required(out) : nullptr);
  return look_at_stream(decoder, bad, [&](const l4d::Decoder& d) -> Status {
    const std::vector<l4d_loss>& losses = d.losses();
    std::copy_n(losses.begin(), std::min<uint64_t>(capacity, losses.size()), out);
    *count = losses.size();
    return {};
  });
}

l4d_status l4d_decoder_get_counters(const l4d_decoder* decoder, l4d_counters* counters) {
  return look_at_stream(decoder, required(counters), [&](const l4d::Decoder& d) -> Status {
    l4d_counters c{};
    d.counters(&c);
    write_struct(c, counters);
    return {};
  });
}

l4d_status l4d_decoder_set_progress(l4d_decoder* decoder, l4d_progress_fn fn, void* user) {
  return call_on(decoder, nullptr, [&]() -> Status {
    decoder->impl.stream().set_progress(fn, user);
    return {};
  });
}

l4d_status l4d_validate(const l4d_reader* reader, const l4d_decoder_options* options,
                        l4d_violation_fn fn, void* user, uint64_t* num_violations) {
  return keep_last(guard([&]() -> Status {
    if (const char* bad = first_of(required(reader, num_violations), optional(options))) {
      return l4d::invalid_argument(bad);
    }
    const l4d_decoder_options resolved = read_optional(options);
    if (resolved.threads > L4D_MAX_THREADS) {
      return l4d::invalid_argument("threads is above L4D_MAX_THREADS");
    }
    *num_violations = 0;
    return l4d::validate_file(read_struct(*reader), resolved, reporter(fn, user, num_violations));
  }));
}

}  // extern "C"
