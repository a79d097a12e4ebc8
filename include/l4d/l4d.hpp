// SPDX-License-Identifier: Apache-2.0
// l4d.hpp: owning handles over the C API, header-only C++17. Functions that can fail throw
// l4d::Error.
#ifndef L4D_L4D_HPP
#define L4D_L4D_HPP

#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "l4d/attributes.hpp"
#include "l4d/decode.h"
#include "l4d/encode.h"

namespace l4d {

class Error : public std::runtime_error {
 public:
  Error(l4d_status status, const std::string& detail)
      : std::runtime_error(std::string(l4d_status_name(status)) +
                           (detail.empty() ? "" : ": " + detail)),
        status_(status) {}
  l4d_status status() const noexcept { return status_; }

 private:
  l4d_status status_;
};

// Decoded Gaussians with their arrays. mean_t_double is filled unless it was taken away.
struct GaussianArrays : AttributeArrays {
  std::vector<float> mean_t_local;  // as l4d_gaussian_buffers
  std::vector<l4d_bucket_span> spans;
  // What decode calls write to. Times in other forms than mean_t are not wanted here.
  l4d_gaussian_buffers buffers() {
    l4d_gaussian_buffers b;
    l4d_gaussian_buffers_init(&b);
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

// What a slice returns besides position, covariance, opacity and SH.
struct SliceOptions {
  bool shape = false;  // scale and rotation
  bool id = false;
  bool color = false;  // as seen from camera_position
  double camera_position[3] = {0, 0, 0};
};

class DecoderHandle {
 public:
  explicit DecoderHandle(const l4d_decoder_options* options = nullptr) {
    l4d_decoder* d = nullptr;
    const l4d_status status = l4d_decoder_create(options, &d);
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
    handle_.reset(d);
  }
  l4d_decoder* get() const noexcept { return handle_.get(); }

  void open_file(const std::string& path) { check(l4d_decoder_open_file(get(), path.c_str())); }
  // Borrows the bytes for as long as the stream is open.
  void open_memory(const void* data, size_t size) {
    check(l4d_decoder_open_memory(get(), data, size));
  }
  void open(const l4d_reader& reader) { check(l4d_decoder_open(get(), &reader)); }

  l4d_info info() const {
    l4d_info i;
    l4d_info_init(&i);
    check(l4d_decoder_get_info(get(), &i));
    return i;
  }
  l4d_coding_errors coding_errors() const {
    l4d_coding_errors e;
    l4d_coding_errors_init(&e);
    check(l4d_decoder_get_coding_errors(get(), &e));
    return e;
  }
  l4d_rendering rendering() const {
    l4d_rendering r;
    l4d_rendering_init(&r);
    check(l4d_decoder_get_rendering(get(), &r));
    return r;
  }
  l4d_presentation presentation() const {
    l4d_presentation p;
    l4d_presentation_init(&p);
    check(l4d_decoder_get_presentation(get(), &p));
    return p;
  }
  l4d_layer_info layer_info(uint32_t layer) const {
    l4d_layer_info i;
    l4d_layer_info_init(&i);
    check(l4d_decoder_get_layer_info(get(), layer, &i));
    return i;
  }
  // What playing the stream asks for; fields that the caller sets describe the link that it reads
  // from.
  l4d_stream_demand demand(uint64_t bytes_per_second = 0, uint64_t burst_bytes = 0) const {
    l4d_stream_demand c;
    l4d_stream_demand_init(&c);
    c.bytes_per_second = bytes_per_second;
    c.burst_bytes = burst_bytes;
    check(l4d_decoder_get_stream_demand(get(), &c));
    return c;
  }
  l4d_selection select(const l4d_query& query) const {
    l4d_selection s;
    l4d_selection_init(&s);
    check(l4d_decoder_select(get(), &query, &s));
    return s;
  }
  // The bytes of the file that the query needs; step: L4D_READS_*.
  std::vector<l4d_byte_range> reads(const l4d_query& query, uint32_t step = L4D_READS_ALL) const {
    uint64_t count = 0;
    check(l4d_decoder_get_reads(get(), &query, step, nullptr, 0, &count));
    std::vector<l4d_byte_range> ranges(static_cast<size_t>(count));
    check(l4d_decoder_get_reads(get(), &query, step, ranges.data(), count, &count));
    return ranges;
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
  void set_detail(uint32_t detail) const { check(l4d_decoder_set_detail(get(), detail)); }
  void set_layers(uint32_t max_level, uint32_t max_tier) const {
    check(l4d_decoder_set_layers(get(), max_level, max_tier));
  }
  SplatArrays slice(double time, const SliceOptions& options = {}) const {
    const l4d_info i = info();
    l4d_splat_buffers b;
    l4d_splat_buffers_init(&b);
    check(l4d_decoder_slice(get(), time, &b));
    const size_t n = static_cast<size_t>(b.count);
    SplatArrays a;
    a.sh_degree = i.sh_degree;
    a.position.resize(3 * n);
    a.covariance.resize(6 * n);
    a.opacity.resize(n);
    a.sh.resize(3 * (i.sh_degree + 1) * (i.sh_degree + 1) * n);
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
    check(l4d_decoder_slice(get(), time, &b));
    return a;
  }
  void check(l4d_status status) const {
    if (status != L4D_OK) throw Error(status, l4d_decoder_error_message(get()));
  }

 private:
  struct Destroy {
    void operator()(l4d_decoder* d) const noexcept { l4d_decoder_destroy(d); }
  };
  std::unique_ptr<l4d_decoder, Destroy> handle_;
};

class EncoderHandle {
 public:
  explicit EncoderHandle(const l4d_encoder_options* options = nullptr) {
    l4d_encoder* e = nullptr;
    const l4d_status status = l4d_encoder_create(options, &e);
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
    handle_.reset(e);
  }
  l4d_encoder* get() const noexcept { return handle_.get(); }
  void check(l4d_status status) const {
    if (status != L4D_OK) throw Error(status, l4d_encoder_error_message(get()));
  }
  // The whole stream in memory.
  std::vector<unsigned char> encode() const {
    std::vector<unsigned char> out;
    l4d_writer w;
    l4d_writer_init(&w);
    w.user = &out;
    w.write = [](void* user, const void* src, size_t n) -> int {
      auto& bytes = *static_cast<std::vector<unsigned char>*>(user);
      const auto* p = static_cast<const unsigned char*>(src);
      try {
        bytes.insert(bytes.end(), p, p + n);
      } catch (...) {
        return 1;
      }
      return 0;
    };
    check(l4d_encoder_encode(get(), &w));
    return out;
  }

 private:
  struct Destroy {
    void operator()(l4d_encoder* e) const noexcept { l4d_encoder_destroy(e); }
  };
  std::unique_ptr<l4d_encoder, Destroy> handle_;
};

}  // namespace l4d
#endif  // L4D_L4D_HPP
