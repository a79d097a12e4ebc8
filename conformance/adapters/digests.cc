// SPDX-License-Identifier: Apache-2.0
#include "conformance/adapters/digests.h"

#include <xxhash.h>

#include <algorithm>
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <type_traits>
#include <vector>

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
  void add(const std::string& name, const T* values, size_t count) {
    const Bytes bytes = little_endian(values, count);
    const uint64_t digest = XXH3_64bits(bytes.data(), bytes.size());
    append(&list_, digest, 8);
    text_ += "\"" + name + "\": " + hex(digest) + ", ";
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

void add_buckets(Digests* digests, const std::vector<l4d_bucket_span>& spans, size_t count) {
  std::vector<uint64_t> rows;
  for (size_t k = 0; k < count; ++k) {
    rows.insert(rows.end(), {spans[k].layer, spans[k].bucket, spans[k].count});
  }
  digests->add("buckets", rows.data(), rows.size());
}

}  // namespace

std::string attribute_digests(const DecoderHandle& decoder, const l4d_query& query) {
  const l4d_selection selection = decoder.select(query);
  const size_t n = static_cast<size_t>(selection.num_gaussians);
  const uint32_t degree = decoder.info().sh_degree;
  const size_t coefficients = size_t{degree + 1} * (degree + 1);
  const bool windows = (decoder.info().tools & L4D_TOOL_FLAT_WINDOWS) != 0;
  std::vector<float> position(3 * n), mean_t(n), local(n), log_scale(4 * n), rotor(8 * n),
      opacity(n), sh(3 * coefficients * n);
  std::vector<double> exact(n);
  std::vector<uint32_t> window(windows ? 2 * n : 0);
  std::vector<l4d_bucket_span> spans(static_cast<size_t>(selection.num_spans));
  l4d_gaussian_buffers b;
  l4d_gaussian_buffers_init(&b);
  b.capacity = n;
  b.position = position.data();
  b.mean_t = mean_t.data();
  b.mean_t_local = local.data();
  b.mean_t_double = exact.data();
  b.log_scale = log_scale.data();
  b.rotor = rotor.data();
  b.opacity = opacity.data();
  b.sh = sh.data();
  b.window = windows ? window.data() : nullptr;
  b.spans = spans.data();
  b.span_capacity = spans.size();
  decoder.check(l4d_decoder_decode(decoder.get(), &query, &b));
  const size_t m = static_cast<size_t>(b.count);
  Digests digests(m);
  digests.add("position", position.data(), 3 * m);
  digests.add("mean_t", mean_t.data(), m);
  digests.add("mean_t_local", local.data(), m);
  digests.add("mean_t_exact", exact.data(), m);
  digests.add("log_scale", log_scale.data(), 4 * m);
  digests.add("rotor", rotor.data(), 8 * m);
  digests.add("opacity", opacity.data(), m);
  digests.add("sh", sh.data(), 3 * coefficients * m);
  if (windows) digests.add("window", window.data(), 2 * m);
  add_buckets(&digests, spans, static_cast<size_t>(b.num_spans));
  return digests.json();
}

namespace {

struct Component {
  const char* name;
  size_t dim, stages;
  std::vector<uint8_t> depth;
  std::vector<uint16_t> index, escape;
};

// Of permanent layers, an escape of scale has no temporal number.
size_t short_escapes(const DecoderHandle& decoder, const std::vector<uint8_t>& depth,
                     const std::vector<l4d_bucket_span>& spans, size_t num_spans) {
  size_t count = 0;
  for (size_t k = 0; k < num_spans; ++k) {
    if (decoder.layer_info(spans[k].layer).permanent == 0) continue;
    const auto begin = depth.begin() + static_cast<std::ptrdiff_t>(spans[k].first);
    count += static_cast<size_t>(
        std::count(begin, begin + static_cast<std::ptrdiff_t>(spans[k].count), uint8_t{255}));
  }
  return count;
}

}  // namespace

std::string packed_digests(const DecoderHandle& decoder, const l4d_query& query) {
  const l4d_selection selection = decoder.select(query);
  const size_t n = static_cast<size_t>(selection.num_gaussians);
  const l4d_info info = decoder.info();
  const bool windows = (info.tools & L4D_TOOL_FLAT_WINDOWS) != 0;
  Component components[L4D_COMPONENT_COUNT] = {
      {"sh", size_t{3} * (info.sh_degree + 1) * (info.sh_degree + 1), 0, {}, {}, {}},
      {"scale", 4, 0, {}, {}, {}},
      {"rotor_spatial", 4, 0, {}, {}, {}},
      {"rotor_temporal", 4, 0, {}, {}, {}}};
  for (uint32_t l = 0; l < info.num_layers; ++l) {
    const l4d_layer_info layer = decoder.layer_info(l);
    for (size_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      components[c].stages = std::max<size_t>(components[c].stages, layer.num_stages[c]);
    }
  }
  std::vector<uint16_t> position(3 * n), mean_t(n), opacity(n), scale_factor(n);
  std::vector<uint32_t> window(windows ? 2 * n : 0);
  std::vector<l4d_bucket_span> spans(static_cast<size_t>(selection.num_spans));
  l4d_packed_buffers b;
  l4d_packed_buffers_init(&b);
  b.capacity = n;
  b.position = position.data();
  b.mean_t = mean_t.data();
  b.opacity = opacity.data();
  b.scale_factor = scale_factor.data();
  b.window = windows ? window.data() : nullptr;
  b.spans = spans.data();
  b.span_capacity = spans.size();
  for (size_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    components[c].depth.resize(n);
    components[c].index.resize(components[c].stages * n);
    b.component[c].depth = components[c].depth.data();
    b.component[c].index = components[c].index.data();
  }
  decoder.check(l4d_decoder_decode_packed(decoder.get(), &query, &b));
  const size_t m = static_cast<size_t>(b.count), num_spans = static_cast<size_t>(b.num_spans);
  l4d_packed_buffers again;  // only now is it known how many escapes there are
  l4d_packed_buffers_init(&again);
  again.capacity = n;
  for (size_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    again.component[c].escape_capacity = b.component[c].num_escapes;
    components[c].escape.resize(static_cast<size_t>(b.component[c].num_escapes) *
                                components[c].dim);
    again.component[c].escape = components[c].escape.data();
  }
  decoder.check(l4d_decoder_decode_packed(decoder.get(), &query, &again));
  Component& scale = components[L4D_COMPONENT_SCALE];
  scale.escape.resize(scale.escape.size() - short_escapes(decoder, scale.depth, spans, num_spans));

  Digests digests(m);
  digests.add("position", position.data(), 3 * m);
  digests.add("mean_t", mean_t.data(), m);
  digests.add("opacity", opacity.data(), m);
  digests.add("scale_factor", scale_factor.data(), m);
  if (windows) digests.add("window", window.data(), 2 * m);
  for (const Component& c : components) {
    digests.add(std::string(c.name) + ".depth", c.depth.data(), m);
    std::vector<uint16_t> rows;  // without the room that was not needed
    for (size_t s = 0; s < c.stages; ++s) {
      const auto begin = c.index.begin() + static_cast<std::ptrdiff_t>(s * n);
      rows.insert(rows.end(), begin, begin + static_cast<std::ptrdiff_t>(m));
    }
    digests.add(std::string(c.name) + ".index", rows.data(), rows.size());
  }
  for (const Component& c : components) {
    digests.add(std::string(c.name) + ".escape", c.escape.data(), c.escape.size());
  }
  add_buckets(&digests, spans, num_spans);
  return digests.json();
}

}  // namespace l4d
