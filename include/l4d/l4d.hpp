// SPDX-License-Identifier: Apache-2.0
// l4d.hpp: owning handles over the C API, header-only C++17. Functions that can fail throw
// l4d::Error.
#ifndef L4D_L4D_HPP
#define L4D_L4D_HPP

#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "l4d/attributes.hpp"
#include "l4d/decode.h"
#include "l4d/encode.h"
#include "l4d/playback.h"

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
    l4d_info i = L4D_INIT(l4d_info);
    check(l4d_decoder_get_info(get(), &i));
    return i;
  }
  l4d_rendering rendering() const {
    l4d_rendering r = L4D_INIT(l4d_rendering);
    check(l4d_decoder_get_rendering(get(), &r));
    return r;
  }
  l4d_presentation presentation() const {
    l4d_presentation p = L4D_INIT(l4d_presentation);
    check(l4d_decoder_get_presentation(get(), &p));
    return p;
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
    l4d_layer_info i = L4D_INIT(l4d_layer_info);
    check(l4d_decoder_get_layer_info(get(), layer, &i));
    return i;
  }
  l4d_selection select(const l4d_query& query) const {
    l4d_selection s = L4D_INIT(l4d_selection);
    check(l4d_decoder_select(get(), &query, &s));
    return s;
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
  void check(l4d_status status) const {
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
  }

 private:
  struct Destroy {
    void operator()(l4d_decoder* d) const noexcept { l4d_decoder_destroy(d); }
  };
  std::unique_ptr<l4d_decoder, Destroy> handle_;
};

class PlaybackHandle {
 public:
  explicit PlaybackHandle(const l4d_playback_options* options = nullptr) {
    l4d_playback* p = nullptr;
    const l4d_status status = l4d_playback_create(options, &p);
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
    handle_.reset(p);
  }
  l4d_playback* get() const noexcept { return handle_.get(); }

  void open(double now, const std::string& uri, uint64_t size = 0) {
    check(l4d_playback_open(get(), now, uri.c_str(), L4D_OPEN_STREAM, size));
  }
  void open_playlist(double now, const std::string& uri) {
    check(l4d_playback_open(get(), now, uri.c_str(), L4D_OPEN_PLAYLIST, 0));
  }
  void open(double now, const l4d_reader& reader) {
    check(l4d_playback_open_reader(get(), now, &reader));
  }
  void play(double now) { check(l4d_playback_play(get(), now)); }
  void pause(double now) { check(l4d_playback_pause(get(), now)); }
  void seek(double now, double time, double tolerance = 0, uint32_t id = 0) {
    check(l4d_playback_seek(get(), now, time, tolerance, id));
  }
  // Reaches `now`, and returns what there is to do.
  std::vector<l4d_playback_item> update(double now) {
    check(l4d_playback_update(get(), now));
    std::vector<l4d_playback_item> items;
    for (uint32_t count = kItems; count == kItems;) {
      const size_t before = items.size();
      items.resize(before + kItems);
      check(l4d_playback_take(get(), items.data() + before, kItems, &count));
      items.resize(before + count);
    }
    return items;
  }
  l4d_playback_state state() const {
    l4d_playback_state s = L4D_INIT(l4d_playback_state);
    check(l4d_playback_get_state(get(), &s));
    return s;
  }
  // options.point does not count: the engine chooses what is shown.
  SplatArrays slice(double time, const SliceOptions& options = {}) const {
    return splats_of(state().sh_degree, options,
                     [&](l4d_splat_buffers* b) { check(l4d_playback_slice(get(), time, b)); });
  }
  void check(l4d_status status) const {
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
  }

 private:
  static constexpr uint32_t kItems = 64;
  struct Destroy {
    void operator()(l4d_playback* p) const noexcept { l4d_playback_destroy(p); }
  };
  std::unique_ptr<l4d_playback, Destroy> handle_;
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
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
  }
  void set(const std::string& name, double value) const {
    check(l4d_encoder_set(get(), name.c_str(), value));
  }
  void set_list(const std::string& name, const std::vector<double>& values) const {
    check(l4d_encoder_set_list(get(), name.c_str(), values.data(),
                               static_cast<uint32_t>(values.size())));
  }
  // The whole stream in memory.
  std::vector<unsigned char> encode() const {
    std::vector<unsigned char> out;
    l4d_writer w = L4D_INIT(l4d_writer);
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
