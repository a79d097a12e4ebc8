// SPDX-License-Identifier: Apache-2.0
// What an l4d_encoder handle is.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "encoder/file/file_builder.h"
#include "encoder/prepare/scene.h"
#include "encoder/prepare/settings.h"
#include "encoder/search/nearest.h"

namespace l4d {

struct EncodeReport {
  l4d_encode_report totals{};
  std::vector<l4d_encode_step> steps;
  std::vector<uint32_t> order;
};

class Encoder {
 public:
  explicit Encoder(const l4d_encoder_options& options) : options_(options) {}

  EncoderSettings& settings() { return settings_; }
  const EncoderSettings& settings() const { return settings_; }
  Status set_scene(const l4d_gaussians& gaussians, const l4d_timeline& timeline,
                   const l4d_placement& placement);
  // null: the scene's.
  Status set_fitted_opacity(const float* opacity);
  // All fields 0: none.
  Status set_importance(const l4d_importance& importance);
  Status set_rendering(const l4d_rendering& rendering);
  Status set_presentation(const l4d_presentation& presentation);
  void add_metadata(std::string key, std::string value) {
    metadata_.emplace_back(std::move(key), std::move(value));
  }
  void set_progress(l4d_progress_fn fn, void* user) {
    progress_ = fn;
    progress_user_ = user;
  }

  // Searches of codebooks may go there; `device` lives as long as the encoder. null = none.
  void set_device(std::unique_ptr<NearestDevice> device) { device_ = std::move(device); }

  using WriteFn = std::function<bool(const unsigned char* data, size_t n)>;
  Status encode(const WriteFn& write);
  // Another scene than that of set_scene, with other settings; no report is kept.
  Status encode_input(const EncoderInput& input, const EncoderSettings& settings,
                      const WriteFn& write, EncodeReport* report) const;
  const EncoderInput& input() const { return input_; }
  const std::vector<std::pair<std::string, std::string>>& metadata() const { return metadata_; }
  const l4d_encoder_options& options() const { return options_; }
  // The report of the last successful encode; null before the first.
  const EncodeReport* report() const { return has_report_ ? &report_ : nullptr; }

 private:
  class Run;

  l4d_encoder_options options_;
  std::unique_ptr<NearestDevice> device_;
  EncoderSettings settings_;
  EncoderInput input_;
  std::vector<std::pair<std::string, std::string>> metadata_;
  l4d_progress_fn progress_ = nullptr;
  void* progress_user_ = nullptr;
  EncodeReport report_;
  bool has_report_ = false;
};

}  // namespace l4d
