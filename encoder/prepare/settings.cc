// SPDX-License-Identifier: Apache-2.0
#include "encoder/prepare/settings.h"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <string>

#include "libl4dcodec/container/levels.h"

namespace l4d {
namespace {

constexpr ParameterDescription kParameters[L4D_ENC_PARAMETER_COUNT] = {
    {"lossless", "code float32 attributes exactly", 0, 1, 0, false, true},
    {"codebook-size", "entries of each stage's codebook", 1, 65536, 1024, true, true},
    {"escape-threshold", "keep vectors of a larger weight unquantised; 0 = never", 0, 1e30, 0, true,
     false},
    {"rcq", "block codebooks: 0 never, 1 where they pay, 2 wherever allowed", 0, 2, 1, false, true},
    {"rcq-size", "entries of a residual codebook", 1, 4096, 512, false, true},
    {"merge-fraction", "merge a finest layer with a smaller share of all Gaussians", 0, 1, 0.005,
     false, false},
    {"merge-count", "merge a finest layer with fewer Gaussians", 0, 1e9, 4096, false, true},
    {"prune-weight", "drop Gaussians whose alpha_t weight is at most this; negative = never", -1,
     1e30, -1, false, false},
    {"page-size", "Gaussians per page", 64, 65536, 4096, false, true},
    {"closed-loop", "choose means and opacities so that decoded Gaussians are in place", 0, 1, 1,
     false, true},
    {"gauge", "rotors: 0 as given, 1 sign, 2 nearest identity, 3 sorted scales", 0, 3, 1, false,
     true},
    {"opacity-bits", "bits of an opacity code; 0 = as the quality allows", 0, 16, 0, false, true},
    {"scale-factor-bits", "bits of a scale factor code", 1, 16, 8, false, true},
    {"kmeans-iterations", "Lloyd iterations at most", 0, 1000, 10, false, true},
    {"kmeans-sample", "training points per codeword", 1, 1e6, 24, false, true},
    {"zstd-level", "effort of zstd", 1, 22, 15, false, true},
    {"drop-invalid", "drop Gaussians that cannot be coded instead of refusing the scene", 0, 1, 0,
     false, true},
    {"effort",
     "how hard k-means and zstd try: sets kmeans-iterations, kmeans-sample and zstd-level", 1, 9, 7,
     false, true},
    {"coding", "0 codebooks, 1 transform, 2 whichever costs less", 0, 2, 1, true, true},
    {"quality", "of transforms and fixed positions: fidelity to aim at, in dB", 20, 90, 44, false,
     false},
    {"quality-offset", "dB on top of the quality", -30, 30, 0, true, false},
    {"fixed-positions", "positions in fixed point, with a step that follows the quality", 0, 1, 1,
     false, true},
    {"mean-t-shift", "low bits of binary16 mean times left out; -1 = as the quality allows", -1, 10,
     -1, false, true},
    {"rans", "code pages by rANS, not zstd", 0, 1, 1, false, true},
    {"weight-metric", "what the weights are: 0 sums of derivatives, 1 Gauss-Newton", 0, 1, 0, false,
     true},
    {"prune-cost",
     "drop Gaussians that cost more bits than they are worth, by this factor; 0 = none", 0, 10, 0.2,
     false, false},
    {"rate-lambda", "price of the bits of codebook indices; 0 = nearest codeword", 0, 10, 0, true,
     false},
    {"position-offset", "dB on top of the quality, of fixed positions", -30, 60, 6, false, false},
    {"profile",
     "declared profile: 1 indexed, 2 main, 3 lossless, 0 none; -1 = what the stream keeps to", -1,
     3, -1, false, true},
    {"level", "declared conformance level, 0 = none; -1 = the smallest that the stream keeps to",
     -1, 6, -1, false, true},
    {"codebooks-by-cost", "sizes and depths of codebooks follow the quality", 0, 1, 0, false, true},
    {"refine", "rounds in which residual stages are coded again for each other", 0, 20, 0, false,
     true},
    {"sh-base", "SH transforms: 0 freely chosen axes, 1 base colours first", 0, 1, 1, false, true},
    {"max-position-error", "of each Gaussian while seen, in its own sizes; 0 = no bound", 0, 1e6,
     0.5, false, false},
    {"max-covariance-factor", "of each Gaussian's variances; 1 or less = no bound", 0, 1e6, 1.5,
     false, false},
    {"max-opacity-error", "of each Gaussian at any instant; 0 = no bound", 0, 1, 0.1, false, false},
    {"max-visible-error", "distance of each Gaussian while visible, scene units; 0 = no bound", 0,
     1e30, 0, false, false},
    {"weight-views",
     "what the weights were measured from: 0 unknown, 1 all views, so that what shows in none is "
     "dropped, 2 some views, so that it is kept",
     0, 2, 0, false, true},
    {"max-base-color-error", "of each Gaussian, colour units 0 to 1; 0 = no bound", 0, 1e6, 0.05,
     false, false},
    {"max-directional-color-error", "of each Gaussian in any direction; 0 = no bound", 0, 1e6, 0.5,
     false, false},
};

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

const ParameterDescription& describe_parameter(l4d_encoder_parameter id) {
  return kParameters[static_cast<size_t>(id)];
}

const PresetDescription* describe_preset(uint32_t index) {
  return index < std::size(kPresets) ? &kPresets[index] : nullptr;
}

EncoderSettings::EncoderSettings() {
  for (size_t id = 0; id < L4D_ENC_PARAMETER_COUNT; ++id) values_[id].fill(kParameters[id].initial);
  stages_.fill({1.0f, 0.5f});
  stages_[L4D_COMPONENT_SH] = {1.0f, 0.6f, 0.4f, 0.2f, 0.1f};
}

Status EncoderSettings::set(l4d_encoder_parameter id, int component, double value) {
  if (static_cast<int>(id) < 0 || id >= L4D_ENC_PARAMETER_COUNT) {
    return invalid_argument("unknown parameter");
  }
  const ParameterDescription& p = describe_parameter(id);
  if (component < L4D_ALL_COMPONENTS || component >= L4D_COMPONENT_COUNT ||
      (!p.per_component && component != L4D_ALL_COMPONENTS)) {
    return invalid_argument(std::string(p.name) + ": no such component");
  }
  if (!(value >= p.min && value <= p.max) || (p.integer && value != std::floor(value))) {
    char text[160];
    std::snprintf(text, sizeof text, "%s must be %s from %g to %g", p.name,
                  p.integer ? "an integer" : "a number", p.min, p.max);
    return invalid_argument(text);
  }
  auto& values = values_[static_cast<size_t>(id)];
  if (component == L4D_ALL_COMPONENTS) {
    values.fill(value);
  } else {
    values[static_cast<size_t>(component)] = value;
  }
  was_set_[static_cast<size_t>(id)] = true;
  if (id == L4D_ENC_ESCAPE_THRESHOLD) values_[L4D_ENC_CODEBOOKS_BY_COST].fill(0);
  if (id == L4D_ENC_EFFORT) {
    const Effort& effort = kEfforts[static_cast<size_t>(value) - 1];
    values_[L4D_ENC_KMEANS_ITERATIONS].fill(effort.kmeans_iterations);
    values_[L4D_ENC_KMEANS_SAMPLE].fill(effort.kmeans_sample);
    values_[L4D_ENC_ZSTD_LEVEL].fill(effort.zstd_level);
  }
  return {};
}

Status EncoderSettings::set_stages(int component, const std::vector<float>& fractions) {
  if (component < L4D_ALL_COMPONENTS || component >= L4D_COMPONENT_COUNT) {
    return invalid_argument("stages: no such component");
  }
  if (fractions.empty() || fractions.size() > L4D_MAX_STAGES || fractions[0] != 1.0f) {
    return invalid_argument("stages: 1 to 8 fractions, the first of them 1");
  }
  for (size_t s = 1; s < fractions.size(); ++s) {
    if (!(fractions[s] >= 0 && fractions[s] <= fractions[s - 1])) {
      return invalid_argument("stages: fractions must lie in [0, 1] and not grow");
    }
  }
  if (component == L4D_ALL_COMPONENTS) {
    stages_.fill(fractions);
  } else {
    stages_[static_cast<size_t>(component)] = fractions;
  }
  values_[L4D_ENC_CODEBOOKS_BY_COST].fill(0);
  return {};
}

Status EncoderSettings::set_tiers(const std::vector<double>& shares) {
  if (shares.size() >= L4D_MAX_TIERS) {
    return invalid_argument("tiers: at most " + std::to_string(L4D_MAX_TIERS - 1) + " shares");
  }
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
  values_[L4D_ENC_MAX_POSITION_ERROR].fill(position);
  values_[L4D_ENC_MAX_COVARIANCE_FACTOR].fill(covariance);
  values_[L4D_ENC_MAX_OPACITY_ERROR].fill(opacity);
  values_[L4D_ENC_MAX_BASE_COLOR_ERROR].fill(base_color);
  values_[L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR].fill(directional_color);
}

// Codebooks that follow no quality, and what a page of indices holds beside them.
void EncoderSettings::use_codebooks() {
  values_[L4D_ENC_CODING].fill(0);
  values_[L4D_ENC_FIXED_POSITIONS].fill(0);
  values_[L4D_ENC_MEAN_T_SHIFT].fill(0);
  values_[L4D_ENC_OPACITY_BITS].fill(8);
  values_[L4D_ENC_PRUNE_COST].fill(0);
  set_bounds(0, 0, 0, 0, 0);
}

Status EncoderSettings::set_preset(const char* name) {
  EncoderSettings fresh;
  for (const QualityPreset& p : kQualityPresets) {
    if (std::strcmp(name, p.name) != 0) continue;
    fresh.values_[L4D_ENC_QUALITY].fill(p.quality);
    fresh.preset_quality_ = p.quality;
    fresh.set_bounds(p.position, p.covariance, p.opacity, p.base_color, p.directional_color);
    *this = fresh;
    return {};
  }
  for (const QualityPreset& p : kIndexedPresets) {
    if (std::strcmp(name, p.name) != 0) continue;
    fresh.values_[L4D_ENC_CODING].fill(0);
    fresh.values_[L4D_ENC_CODEBOOKS_BY_COST].fill(1);
    // More would take long where SH coefficients are noise.
    fresh.values_[L4D_ENC_CODEBOOK_SIZE].fill(4096);
    fresh.values_[L4D_ENC_CODEBOOK_SIZE][L4D_COMPONENT_SH] = 2048;
    fresh.values_[L4D_ENC_REFINE].fill(2);
    fresh.values_[L4D_ENC_QUALITY].fill(p.quality);
    fresh.preset_quality_ = p.quality;
    fresh.set_bounds(p.position, p.covariance, p.opacity, p.base_color, p.directional_color);
    *this = fresh;
    return {};
  }
  if (std::strcmp(name, "lossless") == 0) {
    fresh.values_[L4D_ENC_LOSSLESS].fill(1);
    fresh.set_bounds(0, 0, 0, 0, 0);
    fresh.values_[L4D_ENC_PAGE_SIZE].fill(kStreamPageSize);
  } else if (std::strcmp(name, "paper-small") == 0 || std::strcmp(name, "paper-large") == 0) {
    fresh.use_codebooks();
    const PaperPreset& paper = name[6] == 's' ? kPaperSmall : kPaperLarge;
    const auto set = [&](l4d_encoder_parameter id, int component, double value) {
      fresh.values_[static_cast<size_t>(id)][static_cast<size_t>(component)] = value;
    };
    fresh.values_[L4D_ENC_RANS].fill(0);
    fresh.values_[L4D_ENC_PAGE_SIZE].fill(kStreamPageSize);
    set(L4D_ENC_ESCAPE_THRESHOLD, L4D_COMPONENT_SH, paper.sh_threshold);
    set(L4D_ENC_ESCAPE_THRESHOLD, L4D_COMPONENT_SCALE, kPaperScaleThreshold);
    set(L4D_ENC_ESCAPE_THRESHOLD, L4D_COMPONENT_ROTOR_SPATIAL, kPaperSpatialThreshold);
    set(L4D_ENC_ESCAPE_THRESHOLD, L4D_COMPONENT_ROTOR_TEMPORAL, kPaperTemporalThreshold);
    fresh.stages_.fill({1.0f});
    fresh.values_[L4D_ENC_CODEBOOK_SIZE].fill(4096);
    fresh.values_[L4D_ENC_CODEBOOK_SIZE][L4D_COMPONENT_SH] = paper.sh_codebook;
    fresh.values_[L4D_ENC_RCQ].fill(2);
    fresh.values_[L4D_ENC_RCQ_SIZE].fill(kPaperRcqSize);
    fresh.values_[L4D_ENC_PRUNE_WEIGHT].fill(0);
  } else {
    return invalid_argument("unknown preset '" + std::string(name) + "'");
  }
  *this = fresh;
  return {};
}

Pruning EncoderSettings::pruning(bool has_alpha_t) const {
  Pruning p = {get(L4D_ENC_PRUNE_WEIGHT), get(L4D_ENC_PRUNE_COST)};
  const int views = get_int(L4D_ENC_WEIGHT_VIEWS);
  if (views == L4D_WEIGHT_VIEWS_UNKNOWN || p.weight >= 0) return p;
  if (views == L4D_WEIGHT_VIEWS_SOME || get_bool(L4D_ENC_LOSSLESS)) {
    if (!was_set_[L4D_ENC_PRUNE_COST]) p.cost = 0;
  } else if (has_alpha_t && !was_set_[L4D_ENC_PRUNE_WEIGHT]) {
    p.weight = 0;
  }
  return p;
}

bool EncoderSettings::codes_half_mean_times() const {
  if (get_int(L4D_ENC_MEAN_T_SHIFT) >= 0) return true;
  for (int c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (get_int(L4D_ENC_CODING, c) != 0) return false;
  }
  return !codes_fixed_positions();
}

double EncoderSettings::color_bound(l4d_encoder_parameter id) const {
  const double below = preset_quality_ - get(L4D_ENC_QUALITY);
  const bool follows = preset_quality_ > 0 && below > 0 && !was_set_[static_cast<size_t>(id)];
  return follows ? get(id) * std::pow(10.0, below / 20) : get(id);
}

bool EncoderSettings::codes_fixed_positions() const {
  const bool for_indices = get_int(L4D_ENC_PROFILE) == static_cast<int>(ProfileId::kIndexed);
  return get_bool(L4D_ENC_FIXED_POSITIONS) && (!for_indices || was_set_[L4D_ENC_FIXED_POSITIONS]);
}

Status EncoderSettings::check_profile() const {
  const int profile = get_int(L4D_ENC_PROFILE);
  if (profile <= 0) return {};
  const auto refuse = [&](const std::string& why) {
    return invalid_argument(std::string("profile ") + profile_name(static_cast<unsigned>(profile)) +
                            why);
  };
  if (profile == static_cast<int>(ProfileId::kLossless)) {
    return get_bool(L4D_ENC_LOSSLESS) ? Status() : refuse(" needs lossless = 1");
  }
  if (get_bool(L4D_ENC_LOSSLESS)) return refuse(" does not allow lossless = 1");
  if (profile == static_cast<int>(ProfileId::kMain)) return {};
  static constexpr const char* kComponents[] = {"sh", "scale", "rotor-spatial", "rotor-temporal"};
  for (int c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (get_int(L4D_ENC_CODING, c) != 0) {
      return refuse(
          std::string(get_int(L4D_ENC_CODING, c) == 1
                          ? " does not allow coding = 1, transforms, of "
                          : " does not allow coding = 2, transforms where they cost less, of ") +
          kComponents[c]);
    }
  }
  if (codes_fixed_positions()) return refuse(" does not allow fixed-positions = 1");
  return {};
}

}  // namespace l4d
