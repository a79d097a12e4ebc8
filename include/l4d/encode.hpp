// SPDX-License-Identifier: Apache-2.0
// encode.hpp: encode.h for C++17. Functions that can fail throw l4d::Error.
#ifndef L4D_ENCODE_HPP
#define L4D_ENCODE_HPP

#include <string>
#include <utility>
#include <vector>

#include "l4d/encode.h"
#include "l4d/handle.hpp"

namespace l4d {

class EncoderHandle : public Handle<l4d_encoder, l4d_encoder_destroy> {
 public:
  explicit EncoderHandle(const l4d_encoder_options* options = nullptr)
      : Handle([&](l4d_encoder** out) { return l4d_encoder_create(options, out); }) {}

  // Of encode calls; an empty function removes it.
  void set_progress(ProgressFunction progress) {
    progress_.set(std::move(progress), [this](l4d_progress_fn fn, void* user) {
      return l4d_encoder_set_progress(get(), fn, user);
    });
  }

  // ---- parameters
  static std::vector<std::string> preset_names() {
    std::vector<std::string> names;
    while (const char* name = l4d_encoder_preset_name(static_cast<uint32_t>(names.size()))) {
      names.push_back(name);
    }
    return names;
  }
  static std::vector<l4d_parameter_info> parameters() {
    std::vector<l4d_parameter_info> all;
    l4d_parameter_info info = L4D_INIT(l4d_parameter_info);
    while (l4d_encoder_parameter_info(static_cast<uint32_t>(all.size()), &info) == L4D_OK) {
      all.push_back(info);
    }
    return all;
  }
  void set_preset(const std::string& name) { check(l4d_encoder_set_preset(get(), name.c_str())); }
  void set(const std::string& name, double value) const {
    check(l4d_encoder_set(get(), name.c_str(), value));
  }
  void set_list(const std::string& name, ArrayView<const double> values) const {
    check(l4d_encoder_set_list(get(), name.c_str(), values.data(),
                               static_cast<uint32_t>(values.size())));
  }
  double value(const std::string& name) const {
    double out = 0;
    check(l4d_encoder_get(get(), name.c_str(), &out));
    return out;
  }

  // ---- input, which is borrowed as encode.h says
  void set_scene(const l4d_gaussians& gaussians, const l4d_timeline& timeline,
                 const l4d_placement* placement = nullptr) {
    check(l4d_encoder_set_scene(get(), &gaussians, &timeline, placement));
  }
  // As many as the scene has Gaussians; null: the scene's.
  void set_fitted_opacity(const float* opacity) {
    check(l4d_encoder_set_fitted_opacity(get(), opacity));
  }
  void set_importance(const l4d_importance* importance) {
    check(l4d_encoder_set_importance(get(), importance));
  }
  void set_rendering(const l4d_rendering* rendering) {
    check(l4d_encoder_set_rendering(get(), rendering));
  }
  void set_presentation(const l4d_presentation* presentation) {
    check(l4d_encoder_set_presentation(get(), presentation));
  }
  void add_metadata(const std::string& key, const std::string& value) {
    check(l4d_encoder_add_metadata(get(), key.c_str(), value.c_str()));
  }

  // ---- encoding
  void encode(const l4d_writer& writer) const { check(l4d_encoder_encode(get(), &writer)); }
  void encode_file(const std::string& path) const {
    check(l4d_encoder_encode_file(get(), path.c_str()));
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
  l4d_encode_report report() const {
    return detail::filled<l4d_encode_report>(
        [&](l4d_encode_report* r) { return l4d_encoder_get_report(get(), r); });
  }
  // Where each decoded Gaussian comes from.
  std::vector<uint32_t> order() const {
    std::vector<uint32_t> out(static_cast<size_t>(report().coded_gaussians));
    check(l4d_encoder_get_order(get(), out.data(), out.size()));
    return out;
  }

 private:
  OwnProgress progress_;
};

}  // namespace l4d
#endif  // L4D_ENCODE_HPP
