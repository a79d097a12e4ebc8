// SPDX-License-Identifier: Apache-2.0
#include "encoder/prepare/scene.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <optional>
#include <string>

#include "encoder/prepare/estimates.h"
#include "encoder/prepare/quality.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/math/gauge.h"
#include "libl4dcodec/scene/attributes.h"
#include "libl4dcodec/scene/layers.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d {
namespace {

// Weights may be any finite floats. Far above this no code tells them apart, and squares of errors
// and sums over a scene still fit a float.
constexpr double kMaxWeight = 1e24;

// The box of the scene is that of all Gaussians but this share on each side of each axis, and a
// little more: a floater in twenty is not taken for the scene.
constexpr double kTail = 0.05;
constexpr double kBeyondTails = 1.25;

float bounded_weight(double weight) { return static_cast<float>(std::min(weight, kMaxWeight)); }

double extent_of(const std::vector<double>& axis) {
  const size_t tail = static_cast<size_t>(kTail * static_cast<double>(axis.size()));
  const double most = axis[axis.size() - 1 - tail] - axis[tail];
  return std::min(kBeyondTails * most, axis.back() - axis.front());
}

// Squared change of the image by one number of each component, where only sums of derivatives are
// known: averages over a trained scene (basketball) of the ratio to those sums. They say what
// matters more, not how much in decibels.
constexpr double kSquarePerSum[L4D_COMPONENT_COUNT] = {5e-3, 2.5e-3, 6e-2, 1.0};

// Of measured and estimated squares, where the views are some of all.
constexpr double kMeasuredPart = 0.25, kEstimatedPart = 0.5;

double exposure_of(const EncoderInput& input, const EncoderScene& s, size_t i) {
  return input.exposure == nullptr ? 1.0 : static_cast<double>(input.exposure[s.source[i]]);
}

bool is_gauss_newton(const EncoderInput& input) {
  return input.importance.metric == L4D_SENSITIVITY_GAUSS_NEWTON;
}

void set_importance(const EncoderInput& input, int threads, EncoderScene* scene) {
  EncoderScene& s = *scene;
  const l4d_importance& given = input.importance;
  const bool gauss_newton = is_gauss_newton(input);
  const float* alpha_t = given.weights[L4D_WEIGHT_ALPHA_T];
  static constexpr unsigned kOwn[L4D_COMPONENT_COUNT] = {
      L4D_WEIGHT_SH, L4D_WEIGHT_SCALE, L4D_WEIGHT_ROTOR_SPATIAL, L4D_WEIGHT_ROTOR_TEMPORAL};
  const float* own[L4D_COMPONENT_COUNT];
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) own[c] = given.weights[kOwn[c]];
  const float* own_position = gauss_newton ? given.weights[L4D_WEIGHT_POSITION] : nullptr;
  // A few views say what matters there, and too little of what other views show.
  const bool mixes = gauss_newton && alpha_t != nullptr && given.views == L4D_WEIGHT_VIEWS_SOME;
  double sum = 0;
  const std::vector<double> estimated = input.share == nullptr && (mixes || alpha_t == nullptr)
                                            ? estimated_shares(s, &sum)
                                            : std::vector<double>();
  // Where all is measured nothing is estimated.
  const bool is_whole = !mixes && own_position != nullptr &&
                        std::find(std::begin(own), std::end(own), nullptr) == std::end(own);
  std::optional<ShapeFactors> shape;
  if (!is_whole) shape.emplace(s);
  const auto estimate = [&](size_t i) {
    if (!shape) return ImageSquares{};
    const double share = alpha_t != nullptr && !mixes ? static_cast<double>(alpha_t[s.source[i]])
                         : input.share != nullptr     ? input.share[s.source[i]]
                                                      : estimated[i];
    return shape->squares(i, share);
  };
  // Gauss-Newton weights add up the three channels of a pixel; an image error is their mean.
  const auto square = [](double v) { return v * v / 3; };
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) s.importance[c].resize(s.count);
  s.position_importance.resize(s.count);
  const auto set = [&](size_t i) {
    const size_t from = s.source[i];
    const double exposure = exposure_of(input, s, i);
    ImageSquares squares = estimate(i);
    const auto mix = [&](double measured, double* value) {
      *value = mixes ? kMeasuredPart * measured + kEstimatedPart * *value : measured;
    };
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      if (own[c] == nullptr) continue;
      const double weight = static_cast<double>(own[c][from]);
      mix(gauss_newton ? square(weight) : kSquarePerSum[c] * weight, &squares.component[c]);
    }
    if (own_position != nullptr) {
      mix(square(static_cast<double>(own_position[from])), &squares.position);
    } else if (own[L4D_COMPONENT_SCALE] != nullptr) {
      squares.position = shape->position_per_scale(i) * squares.component[L4D_COMPONENT_SCALE];
    }
    if (own[L4D_COMPONENT_ROTOR_TEMPORAL] == nullptr) {
      squares.component[L4D_COMPONENT_ROTOR_TEMPORAL] =
          shape->temporal_per_position(i) * squares.position;
    }
    for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
      s.importance[c][i] = bounded_weight(exposure * squares.component[c]);
    }
    s.position_importance[i] = bounded_weight(exposure * squares.position);
  };
  parallel_for(threads, s.count, kGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) set(i);
  });
}

Status check_numbers(const float* numbers, uint64_t count, const char* name) {
  for (uint64_t i = 0; numbers != nullptr && i < count; ++i) {
    if (!(numbers[i] >= 0 && std::isfinite(numbers[i]))) {
      return Status(L4D_ERR_INVALID_SCENE, std::string("the ") + name + " of Gaussian " +
                                               std::to_string(i) + " is not a number >= 0");
    }
  }
  return {};
}

// count: Gaussians of the scene.
Status check_importance(const l4d_importance& given, uint64_t count) {
  const bool any =
      given.min_sizes != nullptr || std::any_of(given.weights, given.weights + L4D_WEIGHT_COUNT,
                                                [](const float* w) { return w != nullptr; });
  if (any && given.count != count) {
    return invalid_argument("importance of " + std::to_string(given.count) + " Gaussians for " +
                            std::to_string(count));
  }
  if (given.metric > L4D_SENSITIVITY_GAUSS_NEWTON || given.views > L4D_WEIGHT_VIEWS_SOME) {
    return invalid_argument("importance: unknown metric or views");
  }
  for (const float* weights : given.weights) {
    L4D_RETURN_IF_ERROR(check_numbers(weights, count, "weight"));
  }
  return check_numbers(given.min_sizes, count, "minimum size");
}

// A decoder takes the middle of a window for the time that the position is of, and so does all that
// follows.
void refer_to_window(bool at_mean, size_t i, EncoderScene* scene) {
  EncoderScene& s = *scene;
  const double given = at_mean ? s.mean_t[i] : reference_time(s.timeline, s.mean_t[i]);
  s.mean_t[i] = window_middle(s.timeline, s.window[i]);
  s.lambda[i] = 0;
  const double dt = reference_time(s.timeline, s.mean_t[i]) - given;
  for (size_t k = 0; k < 3; ++k) {
    const double moved = s.velocity[3 * i + k] * dt;
    if (moved == 0) continue;  // what is stored as it is stays as it is
    s.position[3 * i + k] += moved;
    if (!s.raw_position.empty()) {
      s.raw_position[3 * i + k] = static_cast<float>(s.position[3 * i + k]);
    }
  }
}

}  // namespace

void slice_in_double(const float* rotor, const float* log_scale, SeenGaussian* out) {
  const Slice4D<double> slice = slice_attributes<double>(rotor, log_scale);
  std::copy_n(slice.velocity, 3, out->velocity);
  std::copy_n(slice.covariance, 6, out->covariance);
  out->lambda = slice.lambda;
}

SeenGaussian EncoderScene::seen(size_t i) const {
  const size_t from = source[i];
  SeenGaussian g{};
  slice_in_double(given.rotor + 8 * from, given.log_scale + 4 * from, &g);
  if (is_flat(i)) g.lambda = 0;
  g.mean = mean_t[i];
  g.reference = reference_time(timeline, g.mean);
  g.opacity = linear_opacity(static_cast<double>(given.opacity[from]),
                             (given.flags & L4D_OPACITY_LOGIT) != 0);
  std::copy_n(position.data() + 3 * i, 3, g.position);
  if (min_sizes != nullptr) g.min_size = static_cast<double>(min_sizes[from]);
  return g;
}

SeenGaussian EncoderScene::stated(size_t i) const {
  SeenGaussian g = seen(i);
  if (stated_opacity != nullptr) {
    g.opacity = linear_opacity(static_cast<double>(stated_opacity[source[i]]),
                               (given.flags & L4D_OPACITY_LOGIT) != 0);
  }
  return g;
}

std::vector<double> EncoderScene::sorted_axis(size_t k) const {
  std::vector<double> axis(count);
  for (size_t i = 0; i < count; ++i) axis[i] = position[3 * i + k];
  std::sort(axis.begin(), axis.end());
  return axis;
}

Sequence EncoderScene::shown(size_t i) const {
  if (!is_flat(i)) return sequence_of(timeline);
  return {time_of_frame(timeline, window[i].begin), time_of_frame(timeline, window[i].end)};
}

double EncoderScene::sigma_t(size_t i) const { return 1.0 / std::sqrt(lambda[i]); }

Status check_input(const EncoderInput& input) {
  const l4d_gaussians& g = input.gaussians;
  if (g.count == 0) return Status(L4D_ERR_INVALID_SCENE, "the scene holds no Gaussian");
  if (g.count > (uint64_t{1} << 30)) return invalid_argument("more than 2^30 Gaussians");
  if (g.sh_degree > 3) return invalid_argument("sh_degree must be 0 to 3");
  if (!has_all_arrays(g)) return invalid_argument("an attribute array is NULL");
  if (!is_valid(input.timeline)) return invalid_argument(kTimelineRule);
  const l4d_placement& p = input.placement;
  if (!is_valid(p)) {
    return invalid_argument("placement: origin and scale must be finite");
  }
  if (!(p.scale > 0)) return invalid_argument("placement: scale must be above 0");
  if (p.coordinate_system > 255 || p.color_space > 255) {
    return invalid_argument("placement: coordinate_system and color_space are ids below 256");
  }
  return check_importance(input.importance, g.count);
}

namespace {

// Why Gaussian i cannot be coded, with the limit and the way out.
std::string refusal(const l4d_gaussians& g, size_t i, const std::string& attribute) {
  std::string text = "Gaussian " + std::to_string(i) + " has an invalid " + attribute;
  if (attribute == "window") return text + ": it must lie within the frames of the sequence";
  size_t index = 0;
  for_each_attribute(
      [&](const AttributeInfo& a, const float* values) {
        const float largest = kLargestNumbers[index++];
        if (attribute != a.name) return;
        const bool time = a.flag == info_of(Attribute::kMeanTime).flag;
        const size_t n = a.numbers(g.sh_degree);
        char line[160];
        for (size_t k = 0; k < n; ++k) {
          const double value = time ? mean_time(g, i) : static_cast<double>(values[n * i + k]);
          if (std::fabs(value) <= static_cast<double>(largest) && n > 1) continue;
          const bool opacity = a.flag == info_of(Attribute::kOpacity).flag;
          if (opacity) {
            std::snprintf(line, sizeof line, ": %.9g; it must be %s", value,
                          (g.flags & L4D_OPACITY_LOGIT) != 0 ? "finite" : "between 0 and 1");
          } else {
            std::snprintf(line, sizeof line, ": %.9g; its magnitude must be at most %.9g", value,
                          static_cast<double>(largest));
          }
          text += line;
          break;
        }
      },
      g);
  if (attribute == info_of(Attribute::kLogScale).name) {
    text +=
        ", a size between 4.1e-8 and 2.4e7. Where lengths are too small or too large, scale the "
        "scene to other units before encoding it";
  }
  return text + "; with drop-invalid such Gaussians are left out";
}

// Chooses the Gaussians that are coded: s.source, and the numbers of the others.
Status choose_gaussians(const EncoderInput& input, const EncoderSettings& settings,
                        EncoderScene* out) {
  const l4d_gaussians& g = input.gaussians;
  EncoderScene& s = *out;
  const float* alpha_t = input.importance.weights[L4D_WEIGHT_ALPHA_T];
  const Pruning pruning = settings.pruning(input.importance.views, alpha_t != nullptr);
  const double prune = pruning.weight;
  if (prune >= 0 && alpha_t == nullptr) {
    return invalid_argument(
        "prune-weight needs alpha_t weights: measure them from cameras, or do without "
        "(prune-weight=-1)");
  }
  // What is seen of a Gaussian ends with its opacity, so to leave it out is to take that away.
  const float* of_opacity = is_gauss_newton(input) && !settings.get_bool(Parameter::kLossless)
                                ? input.importance.weights[L4D_WEIGHT_OPACITY]
                                : nullptr;
  const double pruning_error = Quality(settings, g.count).pruning_error(pruning.cost);
  bool has_windows = false;
  const auto hardly_matters = [&](size_t i) {
    if (of_opacity == nullptr) return false;
    const double change =
        static_cast<double>(of_opacity[i]) *
        linear_opacity(static_cast<double>(g.opacity[i]), (g.flags & L4D_OPACITY_LOGIT) != 0);
    return change * change / 3 < pruning_error;
  };
  for (uint32_t i = 0; i < g.count; ++i) {
    const char* attribute = invalid_attribute(g, i);
    if (attribute == nullptr && !has_valid_window(g, i, s.timeline.num_frames)) {
      attribute = "window";
    }
    if (attribute != nullptr) {
      if (!settings.get_bool(Parameter::kDropInvalid)) {
        return Status(L4D_ERR_INVALID_SCENE, refusal(g, i, attribute));
      }
      ++s.invalid_dropped;
    } else if ((prune >= 0 && static_cast<double>(alpha_t[i]) <= prune) || hardly_matters(i)) {
      ++s.pruned;
    } else {
      s.source.push_back(i);
      has_windows = has_windows || window_of(g, i).is_flat();
    }
  }
  if (has_windows && !tells_frames_apart(s.timeline)) {
    return invalid_argument(
        "a scene with flat windows has to lie within 2^40 frames of time 0: choose time_begin "
        "nearer to 0");
  }
  s.count = s.source.size();
  s.window.resize(has_windows ? s.count : 0);
  if (s.count == 0) return Status(L4D_ERR_INVALID_SCENE, "no Gaussian is left to code");
  return {};
}

void resize(EncoderScene* out, bool lossless) {
  EncoderScene& s = *out;
  const size_t n = s.count;
  s.position.resize(3 * n);
  s.mean_t.resize(n);
  s.log_scale.resize(4 * n);
  s.rotor.resize(8 * n);
  s.opacity.resize(n);
  s.sh.resize(s.sh_dim() * n);
  s.velocity.resize(3 * n);
  s.lambda.resize(n);
  if (!lossless) return;
  s.raw_position.resize(3 * n);
  s.has_double_times = s.given.mean_t_double != nullptr;
  s.raw_mean_t.resize(s.has_double_times ? 0 : n);
}

// Gaussian i as it is given, with its velocity and lambda.
void gather(EncoderScene* out, size_t i, bool lossless) {
  EncoderScene& s = *out;
  const l4d_gaussians& g = s.given;
  const size_t from = s.source[i], sh_dim = s.sh_dim();
  float* rotor = s.rotor.data() + 8 * i;
  float* log_scale = s.log_scale.data() + 4 * i;
  std::copy_n(g.rotor + 8 * from, 8, rotor);
  std::copy_n(g.log_scale + 4 * from, 4, log_scale);
  std::copy_n(g.sh + sh_dim * from, sh_dim, s.sh.data() + sh_dim * i);
  s.mean_t[i] = mean_time(g, from);
  for (size_t k = 0; k < 3; ++k) {
    s.position[3 * i + k] = static_cast<double>(g.position[3 * from + k]);
  }
  s.opacity[i] = g.opacity[from];
  SeenGaussian slice{};
  slice_in_double(rotor, log_scale, &slice);
  std::copy_n(slice.velocity, 3, s.velocity.data() + 3 * i);
  s.lambda[i] = slice.lambda;
  if (lossless) std::copy_n(g.position + 3 * from, 3, s.raw_position.data() + 3 * i);
  if (!s.window.empty()) s.window[i] = window_of(g, from);
  if (s.is_flat(i)) refer_to_window((g.flags & L4D_POSITION_AT_MEAN_TIME) != 0, i, out);
  if (!lossless) return;
  if (!s.has_double_times) s.raw_mean_t[i] = g.mean_t[from];
}

// Brings Gaussian i to the form in which lossy streams have it.
void normalize(EncoderScene* out, size_t i, int gauge) {
  EncoderScene& s = *out;
  float* rotor = s.rotor.data() + 8 * i;
  float* log_scale = s.log_scale.data() + 4 * i;
  const bool logit = (s.given.flags & L4D_OPACITY_LOGIT) != 0;
  s.opacity[i] = static_cast<float>(linear_opacity(static_cast<double>(s.opacity[i]), logit));
  // In the arithmetic of a decoder, which makes what hardly moves stand still. Escapes keep the
  // rotor given.
  normalize_rotor(rotor, rotor);
  if (gauge >= 1) align_halves(rotor);
  if (gauge == 1) canonicalize_sign(rotor);
  if (gauge == 2) canonicalize(rotor, log_scale, GaugeMode::kNearestIdentity);
  if (gauge == 3) canonicalize(rotor, log_scale, GaugeMode::kSortedScales);
  if ((s.given.flags & L4D_POSITION_AT_MEAN_TIME) == 0 || s.is_flat(i)) return;
  const double dt = reference_time(s.timeline, s.mean_t[i]) - s.mean_t[i];
  for (size_t k = 0; k < 3; ++k) s.position[3 * i + k] += s.velocity[3 * i + k] * dt;
}

// Measured where it was, else as it seems from a Gaussian's size, opacity and life.
void set_light(const EncoderInput& input, bool lossless, EncoderScene* out) {
  EncoderScene& s = *out;
  const float* const alpha_t = input.importance.weights[L4D_WEIGHT_ALPHA_T];
  const float* const of_opacity = input.importance.weights[L4D_WEIGHT_OPACITY];
  const bool logit = lossless && (s.given.flags & L4D_OPACITY_LOGIT) != 0;
  s.light.resize(s.count);
  for (size_t i = 0; i < s.count; ++i) {
    const double opacity = linear_opacity(static_cast<double>(s.opacity[i]), logit);
    const size_t from = s.source[i];
    s.light[i] = alpha_t != nullptr ? alpha_t[from]
                 : of_opacity != nullptr
                     ? bounded_weight(opacity * static_cast<double>(of_opacity[from]))
                     : bounded_weight(opacity * shown_area(s, i));
  }
}

void set_weights(const EncoderInput& input, EncoderScene* out) {
  EncoderScene& s = *out;
  const bool gauss_newton = is_gauss_newton(input);
  static constexpr unsigned kOwn[L4D_COMPONENT_COUNT] = {
      L4D_WEIGHT_SH, L4D_WEIGHT_SCALE, L4D_WEIGHT_ROTOR_SPATIAL, L4D_WEIGHT_ROTOR_TEMPORAL};
  for (size_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    const float* own = input.importance.weights[kOwn[c]];
    const float* given = own != nullptr ? own : input.importance.weights[L4D_WEIGHT_ALPHA_T];
    s.weight[c].resize(s.count);
    for (size_t i = 0; i < s.count; ++i) {
      const double w =
          static_cast<double>(given != nullptr ? given[s.source[i]] : proxy_weight(s, i));
      s.weight[c][i] =
          bounded_weight(exposure_of(input, s, i) * (own != nullptr && gauss_newton ? w * w : w));
    }
  }
}

}  // namespace

Status prepare_scene(const EncoderInput& input, const EncoderSettings& settings, int threads,
                     EncoderScene* out) {
  EncoderScene& s = *out;
  const bool lossless = settings.get_bool(Parameter::kLossless);
  s = EncoderScene();
  s.given = input.gaussians;
  s.min_sizes = input.importance.min_sizes;
  s.stated_opacity = input.stated_opacity;
  s.sh_degree = input.gaussians.sh_degree;
  s.timeline = input.timeline;
  s.duration = sequence_duration(input.timeline);
  s.shared_count = input.shared_count;
  L4D_RETURN_IF_ERROR(choose_gaussians(input, settings, out));
  resize(out, lossless);
  const int gauge = settings.get_int(Parameter::kGauge);
  parallel_for(threads, s.count, kGrain, [&](size_t begin, size_t end) {
    for (size_t i = begin; i < end; ++i) {
      gather(out, i, lossless);
      if (!lossless) normalize(out, i, gauge);
    }
  });
  for (size_t k = 0; k < 3; ++k) s.extent = std::max(s.extent, extent_of(s.sorted_axis(k)));
  if (!settings.tiers().empty()) set_light(input, lossless, out);
  if (lossless) return {};
  set_weights(input, out);
  set_importance(input, threads, out);
  return {};
}

}  // namespace l4d
