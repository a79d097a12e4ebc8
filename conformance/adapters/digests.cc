// SPDX-License-Identifier: Apache-2.0
#include "conformance/adapters/digests.h"

#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <type_traits>
#include <vector>

#include "l4d/experimental/packed.h"

namespace l4d {
namespace {

using Bytes = std::vector<unsigned char>;

void append(Bytes* to, uint64_t value, size_t bytes) {
  for (size_t k = 0; k < bytes; ++k) to->push_back(static_cast<unsigned char>(value >> (8 * k)));
}

template <typename T>
Bytes little_endian(const T* values, size_t count) {
  Bytes out;
  out.reserve(count * sizeof(T));
  for (size_t i = 0; i < count; ++i) {
    uint64_t bits = 0;
    if constexpr (std::is_floating_point_v<T>) {
      std::conditional_t<sizeof(T) == 4, uint32_t, uint64_t> word;
      std::memcpy(&word, &values[i], sizeof(T));
      bits = word;
    } else {
      bits = values[i];
    }
    append(&out, bits, sizeof(T));
  }
  return out;
}

class Digests {
 public:
  explicit Digests(uint64_t num_gaussians) : count_(num_gaussians) { append(&list_, count_, 8); }
  template <typename T>
  void add(const std::string& name, const std::vector<T>& values) {
    const Bytes bytes = little_endian(values.data(), values.size());
    const uint64_t digest = XXH3_64bits(bytes.data(), bytes.size());
    append(&list_, digest, 8);
    text_ += "\"" + name + "\": " + hex(digest) + ", ";
  }
  void add_spans(const std::vector<l4d_bucket_span>& spans) {
    std::vector<uint64_t> rows;
    for (const l4d_bucket_span& s : spans) rows.insert(rows.end(), {s.layer, s.bucket, s.count});
    add("buckets", rows);
  }
  std::string json() const {
    return "{\"num_gaussians\": " + std::to_string(count_) + ", \"digests\": {" + text_ +
           "\"all\": " + hex(XXH3_64bits(list_.data(), list_.size())) + "}}";
  }

 private:
  static std::string hex(uint64_t value) {
    char text[24];
    std::snprintf(text, sizeof text, "\"%016" PRIx64 "\"", value);
    return text;
  }
  uint64_t count_;
  Bytes list_;
  std::string text_;
};

// What both forms have: arrays of binary32 numbers, or of codes.
template <typename Number>
struct Columns {
  Columns(const DecoderHandle& decoder, const l4d_query& query)
      : has_windows((decoder.info().tools & L4D_TOOL_FLAT_WINDOWS) != 0) {
    const l4d_selection selection = decoder.select(query);
    spans.resize(static_cast<size_t>(selection.num_spans));
    resize(static_cast<size_t>(selection.num_gaussians));
  }
  template <typename Buffers>
  void bind(Buffers* b) {
    b->capacity = count;
    b->position = position.data();
    b->mean_t = mean_t.data();
    b->opacity = opacity.data();
    b->window = has_windows ? window.data() : nullptr;
    b->spans = spans.data();
    b->span_capacity = spans.size();
  }
  // Leaves what a decode has written.
  template <typename Buffers>
  void trim(const Buffers& b) {
    spans.resize(static_cast<size_t>(b.num_spans));
    resize(static_cast<size_t>(b.count));
  }
  void add_window(Digests* digests) const {
    if (has_windows) digests->add("window", window);
  }

  const bool has_windows;
  size_t count = 0;
  std::vector<Number> position, mean_t, opacity;
  std::vector<uint32_t> window;
  std::vector<l4d_bucket_span> spans;

 private:
  void resize(size_t n) {
    count = n;
    position.resize(3 * n);
    mean_t.resize(n);
    opacity.resize(n);
    window.resize(has_windows ? 2 * n : 0);
  }
};

size_t sh_numbers(const l4d_info& info) {
  return size_t{3} * (info.sh_degree + 1) * (info.sh_degree + 1);
}

}  // namespace

std::string attribute_digests(const DecoderHandle& decoder, const l4d_query& query) {
  Columns<float> columns(decoder, query);
  const size_t dim = sh_numbers(decoder.info());
  std::vector<float> local(columns.count), log_scale(4 * columns.count), rotor(8 * columns.count),
      sh(dim * columns.count);
  std::vector<double> exact(columns.count);
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  columns.bind(&b);
  b.mean_t_local = local.data();
  b.log_scale = log_scale.data();
  b.rotor = rotor.data();
  b.sh = sh.data();
  decoder.check(l4d_decoder_decode(decoder.get(), &query, &b));
  l4d_gaussian_buffers times;  // apart: with exact mean times the host would decode all
  times = L4D_INIT(l4d_gaussian_buffers);
  times.capacity = columns.count;
  times.mean_t_double = exact.data();
  decoder.check(l4d_decoder_decode(decoder.get(), &query, &times));
  columns.trim(b);
  const size_t n = columns.count;
  local.resize(n);
  exact.resize(n);
  log_scale.resize(4 * n);
  rotor.resize(8 * n);
  sh.resize(dim * n);

  Digests digests(n);
  digests.add("position", columns.position);
  digests.add("mean_t", columns.mean_t);
  digests.add("mean_t_local", local);
  digests.add("mean_t_exact", exact);
  digests.add("log_scale", log_scale);
  digests.add("rotor", rotor);
  digests.add("opacity", columns.opacity);
  digests.add("sh", sh);
  columns.add_window(&digests);
  digests.add_spans(columns.spans);
  return digests.json();
}

namespace {

struct Component {
  const char* name;
  size_t dim, stages;
  std::vector<uint8_t> depth;
  std::vector<uint16_t> index, escape;
};

std::array<Component, L4D_COMPONENT_COUNT> components_of(const DecoderHandle& decoder) {
  const l4d_info info = decoder.info();
  std::array<Component, L4D_COMPONENT_COUNT> out = {{{"sh", sh_numbers(info), 0, {}, {}, {}},
                                                     {"scale", 4, 0, {}, {}, {}},
                                                     {"rotor_spatial", 4, 0, {}, {}, {}},
                                                     {"rotor_temporal", 4, 0, {}, {}, {}}}};
  for (uint32_t l = 0; l < info.num_layers; ++l) {
    const l4d_layer_info layer = decoder.layer_info(l);
    for (size_t c = 0; c < out.size(); ++c) {
      out[c].stages = std::max<size_t>(out[c].stages, layer.num_stages[c]);
    }
  }
  return out;
}

// Of permanent layers, an escape of scale has no temporal number.
size_t short_escapes(const DecoderHandle& decoder, const std::vector<uint8_t>& depth,
                     const std::vector<l4d_bucket_span>& spans) {
  size_t count = 0;
  for (const l4d_bucket_span& span : spans) {
    if (decoder.layer_info(span.layer).permanent == 0) continue;
    const auto begin = depth.begin() + static_cast<std::ptrdiff_t>(span.first);
    count += static_cast<size_t>(
        std::count(begin, begin + static_cast<std::ptrdiff_t>(span.count), uint8_t{255}));
  }
  return count;
}

// The first `count` of each stage, which has `capacity`.
std::vector<uint16_t> written_indices(const Component& c, size_t capacity, size_t count) {
  std::vector<uint16_t> rows;
  for (size_t s = 0; s < c.stages; ++s) {
    const auto begin = c.index.begin() + static_cast<std::ptrdiff_t>(s * capacity);
    rows.insert(rows.end(), begin, begin + static_cast<std::ptrdiff_t>(count));
  }
  return rows;
}

}  // namespace

std::string packed_digests(const DecoderHandle& decoder, const l4d_query& query) {
  Columns<uint16_t> columns(decoder, query);
  const size_t capacity = columns.count;
  std::vector<uint16_t> scale_factor(capacity);
  auto components = components_of(decoder);
  l4d_packed_buffers b = L4D_INIT(l4d_packed_buffers);
  columns.bind(&b);
  b.scale_factor = scale_factor.data();
  for (size_t c = 0; c < components.size(); ++c) {
    components[c].depth.resize(capacity);
    components[c].index.resize(components[c].stages * capacity);
    b.component[c].depth = components[c].depth.data();
    b.component[c].index = components[c].index.data();
  }
  decoder.check(l4d_decoder_decode_packed(decoder.get(), &query, &b));
  l4d_packed_buffers again;  // only now is it known how many escapes there are
  again = L4D_INIT(l4d_packed_buffers);
  again.capacity = capacity;
  for (size_t c = 0; c < components.size(); ++c) {
    again.component[c].escape_capacity = b.component[c].num_escapes;
    components[c].escape.resize(static_cast<size_t>(b.component[c].num_escapes) *
                                components[c].dim);
    again.component[c].escape = components[c].escape.data();
  }
  decoder.check(l4d_decoder_decode_packed(decoder.get(), &query, &again));
  columns.trim(b);
  scale_factor.resize(columns.count);
  Component& scale = components[L4D_COMPONENT_SCALE];
  scale.escape.resize(scale.escape.size() - short_escapes(decoder, scale.depth, columns.spans));

  Digests digests(columns.count);
  digests.add("position", columns.position);
  digests.add("mean_t", columns.mean_t);
  digests.add("opacity", columns.opacity);
  digests.add("scale_factor", scale_factor);
  columns.add_window(&digests);
  for (Component& c : components) {
    c.depth.resize(columns.count);
    digests.add(std::string(c.name) + ".depth", c.depth);
    digests.add(std::string(c.name) + ".index", written_indices(c, capacity, columns.count));
  }
  for (const Component& c : components) digests.add(std::string(c.name) + ".escape", c.escape);
  digests.add_spans(columns.spans);
  return digests.json();
}

}  // namespace l4d
