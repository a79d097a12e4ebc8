// SPDX-License-Identifier: Apache-2.0
// decode.hpp: decode.h for C++17: an owning handle, and arrays for what it decodes. Functions that
// can fail throw l4d::Error.
#ifndef L4D_DECODE_HPP
#define L4D_DECODE_HPP

#include <string>
#include <utility>
#include <vector>

#include "l4d/attributes.hpp"
#include "l4d/decode.h"
#include "l4d/handle.hpp"

namespace l4d {

// Decoded Gaussians with their arrays. mean_t_double is filled unless it was taken away.
struct GaussianArrays : AttributeArrays {
  std::vector<float> mean_t_local;  // as l4d_gaussian_buffers
  std::vector<l4d_bucket_span> spans;
  // What decode calls write to. Times in other forms than mean_t are not wanted here.
  l4d_gaussian_buffers buffers() {
    l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
    b.capacity = count();
    for_each_attribute(
        [](const AttributeInfo&, std::vector<float>& from, float*& to) { to = from.data(); }, *this,
        b);
    b.window = window.empty() ? nullptr : window.data();
    b.spans = spans.empty() ? nullptr : spans.data();
    b.span_capacity = spans.size();
    return b;
  }
};

// 3D Gaussians of an instant. Shapes as in l4d_splat_buffers.
struct SplatArrays {
  uint32_t sh_degree = 0;
  std::vector<float> position, covariance, opacity, sh;
  // Empty unless SliceOptions ask for them.
  std::vector<float> scale, rotation, color;
  std::vector<l4d_gaussian_id> id;
  size_t count() const { return opacity.size(); }
};

// How much a slice shows, and what it returns besides position, covariance, opacity and SH.
struct SliceOptions {
  l4d_operating_point point = {};
  bool shape = false;  // scale and rotation
  bool id = false;
  bool color = false;  // as seen from camera_position
  double camera_position[3] = {0, 0, 0};
};

// Calls slice(buffers) for the count and then for the arrays. sh_degree: of the rows of SH.
template <typename Slice>
SplatArrays splats_of(uint32_t sh_degree, const SliceOptions& options, const Slice& slice) {
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  b.point = options.point;
  slice(&b);
  const size_t n = static_cast<size_t>(b.count);
  SplatArrays a;
  a.sh_degree = sh_degree;
  a.position.resize(3 * n);
  a.covariance.resize(6 * n);
  a.opacity.resize(n);
  a.sh.resize(3 * (sh_degree + 1) * (sh_degree + 1) * n);
  b.capacity = n;
  b.position = a.position.data();
  b.covariance = a.covariance.data();
  b.opacity = a.opacity.data();
  b.sh = a.sh.data();
  if (options.shape) {
    a.scale.resize(3 * n);
    a.rotation.resize(4 * n);
    b.scale = a.scale.data();
    b.rotation = a.rotation.data();
  }
  if (options.color) {
    a.color.resize(3 * n);
    b.color = a.color.data();
    for (int k = 0; k < 3; ++k) b.camera_position[k] = options.camera_position[k];
  }
  if (options.id) {
    a.id.resize(n);
    b.id = a.id.data();
  }
  slice(&b);
  return a;
}

class DecoderHandle : public Handle<l4d_decoder, l4d_decoder_destroy> {
 public:
  explicit DecoderHandle(const l4d_decoder_options* options = nullptr)
      : Handle([&](l4d_decoder** out) { return l4d_decoder_create(options, out); }) {}

  void open_file(const std::string& path) { check(l4d_decoder_open_file(get(), path.c_str())); }
  // Borrows the bytes for as long as the stream is open.
  void open_memory(const void* data, size_t size) {
    check(l4d_decoder_open_memory(get(), data, size));
  }
  void open(const l4d_reader& reader) { check(l4d_decoder_open(get(), &reader)); }
  // Of decode calls; an empty function removes it.
  void set_progress(ProgressFunction progress) {
    progress_.set(std::move(progress), [this](l4d_progress_fn fn, void* user) {
      return l4d_decoder_set_progress(get(), fn, user);
    });
  }

  l4d_info info() const {
    return detail::filled<l4d_info>([&](l4d_info* i) { return l4d_decoder_get_info(get(), i); });
  }
  l4d_rendering rendering() const {
    return detail::filled<l4d_rendering>(
        [&](l4d_rendering* r) { return l4d_decoder_get_rendering(get(), r); });
  }
  l4d_presentation presentation() const {
    return detail::filled<l4d_presentation>(
        [&](l4d_presentation* p) { return l4d_decoder_get_presentation(get(), p); });
  }
  std::vector<std::pair<std::string, std::string>> metadata() const {
    std::vector<std::pair<std::string, std::string>> pairs;
    for (uint32_t i = 0;; ++i) {
      const char *key, *value;
      check(l4d_decoder_get_metadata(get(), i, &key, &value));
      if (key == nullptr) return pairs;
      pairs.emplace_back(key, value);
    }
  }
  l4d_layer_info layer_info(uint32_t layer) const {
    return detail::filled<l4d_layer_info>(
        [&](l4d_layer_info* i) { return l4d_decoder_get_layer_info(get(), layer, i); });
  }
  l4d_selection select(const l4d_query& query) const {
    return detail::filled<l4d_selection>(
        [&](l4d_selection* s) { return l4d_decoder_select(get(), &query, s); });
  }
  std::vector<l4d_bucket_span> spans(const l4d_query& query) const {
    return detail::listed<l4d_bucket_span>([&](l4d_bucket_span* out, uint64_t n, uint64_t* count) {
      return l4d_decoder_get_spans(get(), &query, out, n, count);
    });
  }
  GaussianArrays decode(const l4d_query& query) const {
    const l4d_info i = info();
    const l4d_selection s = select(query);
    const size_t n = static_cast<size_t>(s.num_gaussians);
    GaussianArrays a;
    a.sh_degree = i.sh_degree;
    a.flags = i.flags;
    a.resize(n);
    a.mean_t_local.resize(n);
    a.mean_t_double.resize(n);
    const bool windows = (i.tools & L4D_TOOL_FLAT_WINDOWS) != 0;
    if (windows) a.window.resize(2 * n);
    a.spans.resize(static_cast<size_t>(s.num_spans));
    l4d_gaussian_buffers b = a.buffers();
    b.mean_t_local = a.mean_t_local.data();
    // Of other streams they follow from the ranges, and a device can decode.
    const bool exact = windows || (i.tools & L4D_TOOL_LOSSLESS) != 0;
    if (exact) b.mean_t_double = a.mean_t_double.data();
    check(l4d_decoder_decode(get(), &query, &b));
    // A tolerant decoder may hand out less than it selected.
    const size_t count = static_cast<size_t>(b.count);
    if (count != n) {
      a.resize(count);
      a.mean_t_local.resize(count);
    }
    a.spans.resize(static_cast<size_t>(b.num_spans));
    for (const l4d_bucket_span& r : a.spans) {
      for (uint64_t k = r.first; !exact && k < r.first + r.count; ++k) {
        const size_t at = static_cast<size_t>(k);
        a.mean_t_double[at] = r.center + static_cast<double>(a.mean_t_local[at]);
      }
    }
    return a;
  }
  SplatArrays slice(double time, const SliceOptions& options = {}) const {
    return splats_of(info().sh_degree, options,
                     [&](l4d_splat_buffers* b) { check(l4d_decoder_slice(get(), time, b)); });
  }
  // Of the last call that selected, decoded or sliced.
  std::vector<l4d_loss> losses() const {
    return detail::listed<l4d_loss>([&](l4d_loss* out, uint64_t n, uint64_t* count) {
      return l4d_decoder_get_losses(get(), out, n, count);
    });
  }
  l4d_counters counters() const {
    return detail::filled<l4d_counters>(
        [&](l4d_counters* c) { return l4d_decoder_get_counters(get(), c); });
  }

 private:
  OwnProgress progress_;
};

// Calls found(const l4d_violation&) for each rule that a file breaks, as l4d_validate does, and
// returns how many there are. options may be null. An exception of found() comes out at the end.
template <typename Found>
uint64_t validate(const l4d_reader& reader, const l4d_decoder_options* options,
                  const Found& found) {
  struct Call {
    const Found& found;
    std::exception_ptr thrown;
  } call{found, nullptr};
  const auto tell = [](void* user, const l4d_violation* violation) {
    Call& c = *static_cast<Call*>(user);
    try {
      if (c.thrown == nullptr) c.found(*violation);
    } catch (...) {
      c.thrown = std::current_exception();
    }
  };
  uint64_t count = 0;
  const l4d_status status = l4d_validate(&reader, options, tell, &call, &count);
  if (call.thrown != nullptr) std::rethrow_exception(call.thrown);
  require_ok(status);
  return count;
}

}  // namespace l4d
#endif  // L4D_DECODE_HPP
