// SPDX-License-Identifier: Apache-2.0
#include "encoder/prepare/settings.h"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>

#include "libl4dcodec/container/levels.h"

namespace l4d {
namespace {

// What each effort sets; docs/accuracy.md has the front of time against quality they were taken
// from. More training than that of 7 fits its sample, not the scene: 8 and 9 look longer for
// matches instead, which changes no value.
struct Effort {
  double kmeans_iterations, kmeans_sample, zstd_level;
};
constexpr Effort kEfforts[9] = {{0, 2, 1},   {0, 4, 1},    {0, 4, 15},   {2, 4, 15},  {4, 4, 15},
                                {4, 16, 15}, {10, 24, 15}, {10, 24, 19}, {10, 24, 22}};

// The paper's own settings ("Compression" in its supplement). Its thresholds are of weights
// measured as l4d_sensitivity does.
struct PaperPreset {
  double sh_codebook, sh_threshold;
};
constexpr PaperPreset kPaperSmall = {4096, 6e-7};
constexpr PaperPreset kPaperLarge = {8192, 1e-7};
constexpr double kPaperScaleThreshold = 2e-7;
constexpr double kPaperSpatialThreshold = 1e-6;
constexpr double kPaperTemporalThreshold = 8e-6;
constexpr double kPaperRcqSize = 512;
// Pages of zstd streams: those gain from length, and no device decodes them.
constexpr double kStreamPageSize = 32768;

// A preset of transforms is a quality, which errors keep to on average, and bounds that each
// Gaussian keeps to.
struct QualityPreset {
  const char* name;
  double quality;
  double position, covariance, opacity, base_color, directional_color;
};
constexpr QualityPreset kQualityPresets[] = {{"default", 44, 0.5, 1.5, 0.1, 0.05, 0.5},
                                             {"tiny", 38.5, 1, 1.5, 0.1, 0.1, 0.5},
                                             {"small", 42.3, 1, 1.5, 0.1, 0.06, 0.5},
                                             {"large", 46.5, 0.25, 1.3, 0.05, 0.04, 0.4},
                                             {"archive", 54, 0.1, 1.1, 0.02, 1.0 / 255, 0.2}};

// Codebooks leave those Gaussians further off that are not worth a bit more: hence the higher
// numbers.
constexpr QualityPreset kIndexedPresets[] = {{"indexed", 45.3, 0.5, 1.5, 0.1, 0.05, 0.5},
                                             {"indexed-small", 40, 1, 1.5, 0.1, 0.1, 0.5},
                                             {"indexed-high", 51, 0.1, 1.2, 0.05, 0.04, 0.4}};

constexpr PresetDescription kPresets[] = {
    {"default", "a middle between small and large"},
    {"tiny", "the smallest file that is still good to look at"},
    {"small", "differences show to those who look for them"},
    {"large", "differences are hard to see"},
    {"archive", "for further processing"},
    {"indexed", "codebooks only, for players that render from indices: as good as default"},
    {"indexed-small", "codebooks only: between tiny and small"},
    {"indexed-high", "codebooks only: between large and archive"},
    {"paper-small",
     "the paper's small model: escapes above thresholds, RCQ, unseen Gaussians dropped"},
    {"paper-large", "the paper's large model: twice the SH codebook, a lower SH threshold"},
    {"lossless", "the float32 bits of the input, in any order"},
};

}  // namespace

const PresetDescription* describe_preset(uint32_t index) {
  return index < std::size(kPresets) ? &kPresets[index] : nullptr;
}

EncoderSettings::EncoderSettings() {
  for (size_t id = 0; id < kNumNumbers; ++id) {
    values_[id].fill(describe_parameter(static_cast<Parameter>(id)).initial);
  }
  stages_.fill({1.0f, 0.5f});
  stages_[L4D_COMPONENT_SH] = {1.0f, 0.6f, 0.4f, 0.2f, 0.1f};
}

Status EncoderSettings::set(Parameter id, int component, double value) {
  const ParameterDescription& p = describe_parameter(id);
  if (p.is_list()) return invalid_argument(std::string("`") + p.name + "` is a list");
  if (!(value >= p.min && value <= p.max) || (p.integer && value != std::floor(value))) {
    char text[160];
    std::snprintf(text, sizeof text, "%s must be %s from %g to %g", p.name,
                  p.integer ? "an integer" : "a number", p.min, p.max);
    return invalid_argument(text);
  }
  auto& values = of(id);
  if (component == kAllComponents) {
    values.fill(value);
  } else {
    values[static_cast<size_t>(component)] = value;
  }
  was_set_[index_of(id)] = true;
  if (id == Parameter::kEscapeThreshold) of(Parameter::kCodebooksByCost).fill(0);
  if (id == Parameter::kEffort) {
    const Effort& effort = kEfforts[static_cast<size_t>(value) - 1];
    of(Parameter::kKmeansIterations).fill(effort.kmeans_iterations);
    of(Parameter::kKmeansSample).fill(effort.kmeans_sample);
    of(Parameter::kZstdLevel).fill(effort.zstd_level);
  }
  return {};
}

Status EncoderSettings::set(const std::string& name, double value) {
  NamedParameter at;
  L4D_RETURN_IF_ERROR(find_parameter(name, &at));
  return set(at.parameter, at.component, value);
}

Status EncoderSettings::get(const std::string& name, double* value) const {
  NamedParameter at;
  L4D_RETURN_IF_ERROR(find_parameter(name, &at));
  const ParameterDescription& p = describe_parameter(at.parameter);
  if (p.is_list()) return invalid_argument(std::string("`") + p.name + "` is a list");
  *value = get(at.parameter, std::max(at.component, 0));
  return {};
}

Status EncoderSettings::set_list(const std::string& name, const double* values, size_t count) {
  NamedParameter at;
  L4D_RETURN_IF_ERROR(find_parameter(name, &at));
  const ParameterDescription& p = describe_parameter(at.parameter);
  if (!p.is_list()) return invalid_argument(std::string("`") + p.name + "` is no list");
  if (count > p.max_values) {
    return invalid_argument(name + ": at most " + std::to_string(p.max_values) + " values");
  }
  std::vector<float> rounded;
  for (size_t i = 0; i < count; ++i) rounded.push_back(static_cast<float>(values[i]));
  if (at.parameter == Parameter::kStages) return set_stages(at.component, rounded);
  return set_tiers({rounded.begin(), rounded.end()});
}

Status EncoderSettings::set_stages(int component, const std::vector<float>& fractions) {
  if (fractions.empty() || fractions[0] != 1.0f) {
    return invalid_argument("stages: 1 to 8 fractions, the first of them 1");
  }
  for (size_t s = 1; s < fractions.size(); ++s) {
    if (!(fractions[s] >= 0 && fractions[s] <= fractions[s - 1])) {
      return invalid_argument("stages: fractions must lie in [0, 1] and not grow");
    }
  }
  if (component == kAllComponents) {
    stages_.fill(fractions);
  } else {
    stages_[static_cast<size_t>(component)] = fractions;
  }
  of(Parameter::kCodebooksByCost).fill(0);
  return {};
}

Status EncoderSettings::set_tiers(const std::vector<double>& shares) {
  for (size_t k = 0; k < shares.size(); ++k) {
    if (!(shares[k] > (k > 0 ? shares[k - 1] : 0.0) && shares[k] < 1)) {
      return invalid_argument("tiers: shares must ascend and lie between 0 and 1");
    }
  }
  tiers_ = shares;
  return {};
}

void EncoderSettings::set_bounds(double position, double covariance, double opacity,
                                 double base_color, double directional_color) {
  of(Parameter::kMaxPositionError).fill(position);
  of(Parameter::kMaxCovarianceFactor).fill(covariance);
  of(Parameter::kMaxOpacityError).fill(opacity);
  of(Parameter::kMaxBaseColorError).fill(base_color);
  of(Parameter::kMaxDirectionalColorError).fill(directional_color);
}

// Codebooks that follow no quality, and what a page of indices holds beside them.
void EncoderSettings::use_codebooks() {
  of(Parameter::kCoding).fill(0);
  of(Parameter::kFixedPositions).fill(0);
  of(Parameter::kMeanTShift).fill(0);
  of(Parameter::kOpacityBits).fill(8);
  of(Parameter::kPruneCost).fill(0);
  set_bounds(0, 0, 0, 0, 0);
}

Status EncoderSettings::set_preset(const char* name) {
  EncoderSettings fresh;
  for (const QualityPreset& p : kQualityPresets) {
    if (std::strcmp(name, p.name) != 0) continue;
    fresh.of(Parameter::kQuality).fill(p.quality);
    fresh.preset_quality_ = p.quality;
    fresh.set_bounds(p.position, p.covariance, p.opacity, p.base_color, p.directional_color);
    *this = fresh;
    return {};
  }
  for (const QualityPreset& p : kIndexedPresets) {
    if (std::strcmp(name, p.name) != 0) continue;
    fresh.of(Parameter::kCoding).fill(0);
    fresh.of(Parameter::kCodebooksByCost).fill(1);
    // More would take long where SH coefficients are noise.
    fresh.of(Parameter::kCodebookSize).fill(4096);
    fresh.of(Parameter::kCodebookSize)[L4D_COMPONENT_SH] = 2048;
    fresh.of(Parameter::kRefine).fill(2);
    fresh.of(Parameter::kQuality).fill(p.quality);
    fresh.preset_quality_ = p.quality;
    fresh.set_bounds(p.position, p.covariance, p.opacity, p.base_color, p.directional_color);
    *this = fresh;
    return {};
  }
  if (std::strcmp(name, "lossless") == 0) {
    fresh.of(Parameter::kLossless).fill(1);
    fresh.set_bounds(0, 0, 0, 0, 0);
    fresh.of(Parameter::kPageSize).fill(kStreamPageSize);
  } else if (std::strcmp(name, "paper-small") == 0 || std::strcmp(name, "paper-large") == 0) {
    fresh.use_codebooks();
    const PaperPreset& paper = name[6] == 's' ? kPaperSmall : kPaperLarge;
    const auto set = [&](Parameter id, int component, double value) {
      fresh.of(id)[static_cast<size_t>(component)] = value;
    };
    fresh.of(Parameter::kRans).fill(0);
    fresh.of(Parameter::kPageSize).fill(kStreamPageSize);
    set(Parameter::kEscapeThreshold, L4D_COMPONENT_SH, paper.sh_threshold);
    set(Parameter::kEscapeThreshold, L4D_COMPONENT_SCALE, kPaperScaleThreshold);
    set(Parameter::kEscapeThreshold, L4D_COMPONENT_ROTOR_SPATIAL, kPaperSpatialThreshold);
    set(Parameter::kEscapeThreshold, L4D_COMPONENT_ROTOR_TEMPORAL, kPaperTemporalThreshold);
    fresh.stages_.fill({1.0f});
    fresh.of(Parameter::kCodebookSize).fill(4096);
    fresh.of(Parameter::kCodebookSize)[L4D_COMPONENT_SH] = paper.sh_codebook;
    fresh.of(Parameter::kRcq).fill(2);
    fresh.of(Parameter::kRcqSize).fill(kPaperRcqSize);
    fresh.of(Parameter::kPruneWeight).fill(0);
  } else {
    return invalid_argument("unknown preset '" + std::string(name) + "'");
  }
  *this = fresh;
  return {};
}

Pruning EncoderSettings::pruning(uint32_t views, bool has_alpha_t) const {
  Pruning p = {get(Parameter::kPruneWeight), get(Parameter::kPruneCost)};
  if (views == L4D_WEIGHT_VIEWS_UNKNOWN || p.weight >= 0) return p;
  if (views == L4D_WEIGHT_VIEWS_SOME || get_bool(Parameter::kLossless)) {
    if (!was_set(Parameter::kPruneCost)) p.cost = 0;
  } else if (has_alpha_t && !was_set(Parameter::kPruneWeight)) {
    p.weight = 0;
  }
  return p;
}

bool EncoderSettings::codes_half_mean_times() const {
  if (get_int(Parameter::kMeanTShift) >= 0) return true;
  for (int c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (get_int(Parameter::kCoding, c) != 0) return false;
  }
  return !codes_fixed_positions();
}

double EncoderSettings::color_bound(Parameter id) const {
  const double below = preset_quality_ - get(Parameter::kQuality);
  const bool follows = preset_quality_ > 0 && below > 0 && !was_set(id);
  return follows ? get(id) * std::pow(10.0, below / 20) : get(id);
}

bool EncoderSettings::codes_fixed_positions() const {
  const bool for_indices = get_int(Parameter::kProfile) == static_cast<int>(ProfileId::kIndexed);
  return get_bool(Parameter::kFixedPositions) &&
         (!for_indices || was_set(Parameter::kFixedPositions));
}

Status EncoderSettings::check_profile() const {
  const int profile = get_int(Parameter::kProfile);
  if (profile <= 0) return {};
  const auto refuse = [&](const std::string& why) {
    return invalid_argument(std::string("profile ") + profile_name(static_cast<unsigned>(profile)) +
                            why);
  };
  if (profile == static_cast<int>(ProfileId::kLossless)) {
    return get_bool(Parameter::kLossless) ? Status() : refuse(" needs lossless = 1");
  }
  if (get_bool(Parameter::kLossless)) return refuse(" does not allow lossless = 1");
  if (profile == static_cast<int>(ProfileId::kMain)) return {};
  for (int c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (get_int(Parameter::kCoding, c) != 0) {
      return refuse(
          std::string(get_int(Parameter::kCoding, c) == 1
                          ? " does not allow coding = 1, transforms, of "
                          : " does not allow coding = 2, transforms where they cost less, of ") +
          component_name(c));
    }
  }
  if (codes_fixed_positions()) return refuse(" does not allow fixed-positions = 1");
  return {};
}

}  // namespace l4d
