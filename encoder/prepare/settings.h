// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "encoder/prepare/parameters.h"
#include "l4d/encode.h"
#include "libl4dcodec/base/status.h"

namespace l4d {

struct Pruning {
  double weight;  // Gaussians of at most this alpha_t weight go; negative: none
  double cost;    // as L4D_ENC_PRUNE_COST
};

// Values of all parameters, per component where they have one.
class EncoderSettings {
 public:
  EncoderSettings();

  double get(Parameter id, int component = 0) const {
    return values_[index_of(id)][static_cast<size_t>(component)];
  }
  int get_int(Parameter id, int component = 0) const {
    return static_cast<int>(get(id, component));
  }
  bool get_bool(Parameter id) const { return get(id) != 0; }
  // component: kAllComponents or, of a parameter that has them, one.
  Status set(Parameter id, int component, double value);
  // As l4d_encoder_set, l4d_encoder_get and l4d_encoder_set_list.
  Status set(const std::string& name, double value);
  Status get(const std::string& name, double* value) const;
  Status set_list(const std::string& name, const double* values, size_t count);
  // component: kAllComponents or one.
  Status set_stages(int component, const std::vector<float>& fractions);
  const std::vector<float>& stages(int component) const {
    return stages_[static_cast<size_t>(component)];
  }

  // Shares of the long-lived Gaussians that the tiers but the last hold together, ascending.
  Status set_tiers(const std::vector<double>& shares);
  const std::vector<double>& tiers() const { return tiers_; }

  Status set_preset(const char* name);

  // What is left out, by what is set and what the weights were measured from: L4D_WEIGHT_VIEWS_*.
  Pruning pruning(uint32_t views, bool has_alpha_t) const;

  // A bound on colours: at a quality that was set below that of the preset, the bound of the preset
  // grows as errors do.
  double color_bound(Parameter id) const;

  // Whether positions are fixed point. The profile of indices has binary16, if it is asked for.
  bool codes_fixed_positions() const;

  // Whether mean times are binary16: in streams with a packed form, and where a shift is set.
  bool codes_half_mean_times() const;

  // Whether streams of these settings keep to the profile that is set.
  Status check_profile() const;

 private:
  void use_codebooks();
  void set_bounds(double position, double covariance, double opacity, double base_color,
                  double directional_color);

  using Values = std::array<double, L4D_COMPONENT_COUNT>;
  static size_t index_of(Parameter id) { return static_cast<size_t>(id); }
  Values& of(Parameter id) { return values_[index_of(id)]; }
  bool was_set(Parameter id) const { return was_set_[index_of(id)]; }

  std::array<Values, kNumNumbers> values_;
  std::array<std::vector<float>, L4D_COMPONENT_COUNT> stages_;
  std::vector<double> tiers_;
  std::array<bool, kNumNumbers> was_set_{};  // since the preset
  double preset_quality_ = 0;                // dB; 0 = of no preset
};

struct PresetDescription {
  const char* name;
  const char* description;
};
// Null after the last.
const PresetDescription* describe_preset(uint32_t index);

}  // namespace l4d
