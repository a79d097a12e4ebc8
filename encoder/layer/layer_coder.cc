// SPDX-License-Identifier: Apache-2.0
#include "encoder/layer/layer_coder.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "encoder/component/codebook_coder.h"
#include "encoder/layer/closed_loop.h"
#include "encoder/layer/position_coding.h"
#include "encoder/layer/shape_coder.h"
#include "encoder/plan/mean_times.h"
#include "encoder/prepare/quality.h"
#include "l4d/attributes.hpp"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/layers.h"

namespace l4d {
namespace {

// Directory pages of about this many buckets in use keep a seek to a few kilobytes.
constexpr double kBucketsPerDirectoryPage = 128;
// Fewer Gaussians than this do not earn a codebook of their own.
constexpr size_t kMinBlockGaussians = 8192;
constexpr size_t kMaxBlocksPerDirectoryPage = 256;
// Gaussians in the order of their buckets, of a layer whose level is known.
void place_in_buckets(const EncoderScene& scene, const std::vector<uint32_t>& gaussians,
                      CodedLayer* layer) {
  const unsigned level = layer->level;
  std::vector<std::pair<uint32_t, uint32_t>> order;
  order.reserve(gaussians.size());
  for (const uint32_t i : gaussians) {
    const uint32_t bucket =
        layer->flat ? bucket_of_window(scene.window[i], level, scene.timeline.num_frames)
                    : bucket_of_time(scene.timeline, scene.mean_t[i], level);
    order.emplace_back(bucket, i);
  }
  std::sort(order.begin(), order.end());
  size_t used = 0;
  for (size_t j = 0; j < order.size(); ++j) {
    used += j == 0 || order[j].first != order[j - 1].first;
    layer->bucket.push_back(order[j].first);
    layer->gaussians.push_back(order[j].second);
  }
  const double buckets = num_buckets(level);
  const double span =
      kBucketsPerDirectoryPage * buckets / std::max<double>(1, static_cast<double>(used));
  unsigned bits = 0;
  while (bits < 16 && static_cast<double>(1u << bits) < std::min(span, buckets)) ++bits;
  layer->directory_bits = bits;
}

unsigned bits_of(uint32_t largest) {
  unsigned bits = 0;
  while (bits < 32 && largest >> bits != 0) ++bits;
  return bits;
}

// The shortest codes that hold the windows of all Gaussians, whose buckets are known.
void choose_window_codes(const EncoderScene& scene, CodedLayer* layer) {
  MeanTimeCoding& coding = layer->mean_times;
  coding.mean_t = CoordinateCodingId::kWindow;
  uint32_t largest_begin = 0, least = L4D_MAX_FRAMES, longest = 0;
  for (size_t j = 0; j < layer->gaussians.size(); ++j) {
    const FrameWindow window = scene.window[layer->gaussians[j]];
    const uint32_t base = window_base(layer->bucket[j], layer->level, scene.timeline.num_frames);
    largest_begin = std::max(largest_begin, window.begin - base);
    least = std::min(least, window.end - window.begin);
    longest = std::max(longest, window.end - window.begin);
  }
  coding.window_begin_bits = bits_of(largest_begin);
  coding.window_length_bits = bits_of(longest - least);
  coding.window_length = least;
}

class LayerCoder {
 public:
  LayerCoder(const EncoderScene& scene, const LayerPlan& plan, const CoderOptions& options)
      : scene_(scene),
        plan_(plan),
        options_(options),
        settings_(*options.settings),
        quality_(settings_, scene.count, scene.shared_count) {}

  CodedLayer run(std::vector<uint32_t>* demoted, std::vector<uint32_t>* escapes) {
    lossless_ = settings_.get_bool(Parameter::kLossless);
    out_.level = plan_.level;
    out_.permanent = plan_.permanent;
    out_.flat = plan_.flat;
    out_.tier = plan_.tier;
    place_in_buckets(scene_, plan_.gaussians, &out_);
    code_mean_times();
    if (lossless_) {
      describe_lossless();
    } else {
      make_blocks();
      code_shapes(scene_, options_, quality_, &out_);
    }
    place_all();
    drop_demoted(demoted, escapes);
    if (!lossless_) {
      finish_shapes(&out_);
      for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
        auto* vq = std::get_if<CodedVq>(&out_.component[c]);
        if (vq != nullptr) sort_codebooks_by_frequency(*vq, out_.blocks);
      }
    }
    return std::move(out_);
  }

 private:
  size_t count() const { return out_.gaussians.size(); }
  const l4d_timeline& timeline() const { return scene_.timeline; }

  // Runs of whole buckets within one directory page, each large enough to earn a codebook.
  void make_blocks() {
    if (plan_.level == 0 || settings_.get_int(Parameter::kRcq) == 0) return;
    const unsigned bits = out_.directory_bits;
    size_t blocks_in_page = 0;
    for (size_t j = 0; j < count();) {
      size_t end = j;
      const uint32_t page = out_.bucket[j] >> bits;
      while (end < count() && out_.bucket[end] >> bits == page) {
        const bool bucket_starts = end == j || out_.bucket[end] != out_.bucket[end - 1];
        if (bucket_starts && end - j >= kMinBlockGaussians) break;
        ++end;
      }
      const bool same_page =
          !out_.blocks.empty() && out_.bucket[out_.blocks.back().begin] >> bits == page;
      blocks_in_page = same_page ? blocks_in_page : 0;
      const bool too_thin = end - j < kMinBlockGaussians / 2;
      if (same_page && (too_thin || blocks_in_page == kMaxBlocksPerDirectoryPage)) {
        out_.blocks.back().end = end;
      } else {
        out_.blocks.push_back({j, end});
        ++blocks_in_page;
      }
      j = end;
    }
  }

  void code_mean_times() {
    const size_t n = count();
    if (plan_.flat) {
      choose_window_codes(scene_, &out_);
    } else if (plan_.permanent || lossless_) {
      out_.mean_times.mean_t = plan_.permanent           ? CoordinateCodingId::kNone
                               : scene_.has_double_times ? CoordinateCodingId::kRaw64
                                                         : CoordinateCodingId::kRaw32;
    } else {
      std::vector<MeanTimeTarget> targets(n);
      for (size_t j = 0; j < n; ++j) {
        targets[j] = mean_target(j, scene_.mean_t[out_.gaussians[j]], 1);
      }
      choose_mean_times(targets, plan_.far || settings_.codes_half_mean_times(),
                        settings_.get_int(Parameter::kMeanTShift),
                        bucket_width(timeline(), plan_.level), &out_.mean_times);
    }
    out_.decoded_mean_t.resize(n);
    out_.mean_t.resize(out_.mean_times.has_mean_codes() ? n : 0);
    out_.mean_t_fine.resize(out_.mean_times.mean_t_fine ? n : 0);
    for (size_t j = 0; j < n; ++j) {
      const double mean = scene_.mean_t[out_.gaussians[j]];
      if (plan_.permanent) {
        out_.decoded_mean_t[j] = bucket_center(timeline(), plan_.level, out_.bucket[j]);
      } else if (lossless_ || plan_.flat) {
        out_.decoded_mean_t[j] = mean;
      } else {
        set_mean(j, code_mean(mean_target(j, mean, 1)));
      }
    }
  }

  void describe_lossless() {
    out_.scale_factor.coding = ScalarCodingId::kConstant;
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      out_.component[c] = RawRows{};
    }
  }

  // As a decoder will have the shapes; then means and opacities, which absorb what those are off by
  // (closed_loop.h); then what is off by too much all the same is coded again.
  void place_all() {
    const size_t n = count();
    out_.decoded_lambda.resize(n);
    out_.decoded_velocity.resize(3 * n);
    out_.position.resize(3 * n);
    out_.opacity.resize(n);
    escape_.assign(n, 0);
    const bool bounded = options_.bounds.any() && !lossless_;
    parallel_for(options_.threads, n, kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        const SeenGaussian seen = place(j);
        if (!bounded) continue;
        const SeenGaussian original = scene_.seen(out_.gaussians[j]);
        if (excess(j, original, seen) > 1) repair(j, original);
      }
    });
  }

  // The decoder's float arithmetic, then the slice in double.
  SeenGaussian place(size_t j) {
    const size_t i = out_.gaussians[j];
    float rotor[8], log_scale[4];
    decoded_gaussian(j, rotor, log_scale);
    SeenGaussian seen{};
    slice_in_double(rotor, log_scale, &seen);
    out_.decoded_lambda[j] = seen.lambda;
    std::copy_n(seen.velocity, 3, out_.decoded_velocity.data() + 3 * j);
    out_.opacity[j] = scene_.opacity[i];
    std::copy_n(scene_.position.data() + 3 * i, 3, out_.position.data() + 3 * j);
    if (settings_.get_bool(Parameter::kClosedLoop) && !lossless_) close_loop(j);
    if (!out_.fades()) seen.lambda = 0;
    seen.mean = out_.decoded_mean_t[j];
    seen.reference = reference_time(timeline(), seen.mean);
    seen.opacity = static_cast<double>(out_.opacity[j]);
    for (size_t k = 0; k < 3; ++k) {
      seen.position[k] = options_.positions == nullptr
                             ? out_.position[3 * j + k]
                             : coded_position(*options_.positions, out_, j, k);
    }
    return seen;
  }

  double excess(size_t j, const SeenGaussian& original, const SeenGaussian& decoded) const {
    const Sequence shown = scene_.shown(out_.gaussians[j]);
    return excess_of(errors_of(original, decoded, shown.begin, shown.end, options_.bounds,
                               options_.bounds.opacity),
                     options_.bounds);
  }

  // Codes Gaussian j more finely until it keeps to the bounds: each time the component that helps
  // most. What no code can do is left to an escape.
  void repair(size_t j, const SeenGaussian& original) {
    ShapeRefiner refiner(scene_, &out_);
    const double mean = out_.decoded_mean_t[j];
    const uint16_t mean_code = out_.mean_t.empty() ? uint16_t{0} : out_.mean_t[j];
    const auto mean_fine = out_.mean_t_fine.empty() ? 0 : out_.mean_t_fine[j];
    const auto placed_excess = [&] {
      out_.decoded_mean_t[j] = mean;
      if (!out_.mean_t.empty()) out_.mean_t[j] = mean_code;
      if (!out_.mean_t_fine.empty()) {
        out_.mean_t_fine[j] = static_cast<uint16_t>(mean_fine);
      }
      return excess(j, original, place(j));
    };
    double worst = placed_excess();
    while (worst > 1) {
      double best = std::numeric_limits<double>::infinity();
      double gain = -std::numeric_limits<double>::infinity();
      unsigned helps_most = 0;
      for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
        const ShapeRefiner::State before = refiner.save(j, c);
        if (!refiner.refine(j, c)) continue;
        const double then = placed_excess();
        refiner.restore(j, c, before);
        // What a bit more for each of its numbers gains, as far as it has to.
        const double gained = std::log(worst / std::max(then, 1.0)) /
                              static_cast<double>(rows_of(out_.component[c]).dim);
        if (gained > gain) {
          gain = gained;
          best = then;
          helps_most = c;
        }
      }
      if (helps_most == 0) break;
      // Where none helps by itself, all of them may.
      for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
        if (c == helps_most || !(best < worst)) refiner.refine(j, c);
      }
      worst = placed_excess();
    }
    escape_[j] = worst > 1;
  }

  void decoded_gaussian(size_t j, float* rotor, float* log_scale) const {
    const size_t i = out_.gaussians[j];
    if (lossless_) {
      std::copy_n(scene_.rotor.data() + 8 * i, 8, rotor);
      std::copy_n(scene_.log_scale.data() + 4 * i, 4, log_scale);
      return;
    }
    decoded_shape(out_, j, rotor, log_scale);
  }

  void drop_demoted(std::vector<uint32_t>* demoted, std::vector<uint32_t>* escapes) {
    demoted->clear();
    const size_t n = count();
    std::vector<uint8_t> keep(n, 1);
    for (size_t j = 0; j < n; ++j) {
      if (escape_[j] != 0 && escapes != nullptr) {
        escapes->push_back(out_.gaussians[j]);
        keep[j] = 0;
      } else if (plan_.level != 0 && !plan_.flat &&
                 !fits_layer(out_.decoded_mean_t[j], 1 / std::sqrt(out_.decoded_lambda[j]),
                             out_.bucket[j], plan_.level, timeline())) {
        demoted->push_back(out_.gaussians[j]);
        keep[j] = 0;
      }
    }
    if (std::find(keep.begin(), keep.end(), 0) == keep.end()) return;
    std::sort(demoted->begin(), demoted->end());
    std::vector<size_t> before(n + 1, 0);  // kept Gaussians before j
    for (size_t j = 0; j < n; ++j) before[j + 1] = before[j] + keep[j];
    for (BlockRange& b : out_.blocks) b = {before[b.begin], before[b.end]};
    keep_rows(keep, 1, &out_.gaussians);
    keep_rows(keep, 1, &out_.bucket);
    keep_rows(keep, 1, &out_.factor);
    keep_rows(keep, 1, &out_.mean_t);
    keep_rows(keep, 1, &out_.mean_t_fine);
    keep_rows(keep, 1, &out_.decoded_mean_t);
    keep_rows(keep, 1, &out_.decoded_lambda);
    keep_rows(keep, 3, &out_.decoded_velocity);
    keep_rows(keep, 3, &out_.position);
    keep_rows(keep, 1, &out_.opacity);
    if (lossless_) return;
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      drop_gaussians(out_.component[c], keep);
    }
  }

  void close_loop(size_t j) {
    const size_t i = out_.gaussians[j];
    const double begin = scene_.shown(i).begin;
    const double end = scene_.shown(i).end;
    // What is permanent or has a window does not fade, to a decoder.
    const Fading original{static_cast<double>(scene_.opacity[i]), scene_.mean_t[i],
                          out_.fades() ? scene_.lambda[i] : 0.0};
    Fading decoded{original.opacity, out_.decoded_mean_t[j],
                   out_.fades() ? out_.decoded_lambda[j] : 0.0};
    if (out_.fades()) {
      // Level 0 has one bucket, and its Gaussians may be centred anywhere in time.
      if (plan_.level == 0) {
        const SeenSpan seen({original}, begin, end);
        // Half of what the mean may be off for the match, half for its code.
        const double half = mean_target(j, original.mean, 0.5).tolerance;
        const double match = std::clamp(seen.matching_mean(original, decoded.lambda),
                                        original.mean - half, original.mean + half);
        const MeanTimeCode code = code_mean(mean_target(j, match, 0.5));
        Fading moved = decoded;
        moved.mean = decoded_mean(j, code);
        const SeenSpan any({original, decoded, moved}, begin, end);
        if (code.within &&
            any.match_opacity(original, &moved) < any.match_opacity(original, &decoded)) {
          set_mean(j, code);
          decoded.mean = moved.mean;
        }
      }
      SeenSpan({original, decoded}, begin, end).match_opacity(original, &decoded);
      out_.opacity[j] = static_cast<float>(decoded.opacity);
    }
    Moving moving, decoded_moving;
    std::copy_n(scene_.position.data() + 3 * i, 3, moving.position);
    std::copy_n(scene_.velocity.data() + 3 * i, 3, moving.velocity);
    std::copy_n(out_.decoded_velocity.data() + 3 * j, 3, decoded_moving.velocity);
    moving.reference = reference_time(timeline(), original.mean);
    decoded_moving.reference = reference_time(timeline(), out_.decoded_mean_t[j]);
    SeenSpan({original, decoded}, begin, end)
        .match_position(original, decoded, moving, &decoded_moving);
    std::copy_n(decoded_moving.position, 3, out_.position.data() + 3 * j);
  }

  // A mean time of Gaussian j, and `share` of what it may be off.
  MeanTimeTarget mean_target(size_t j, double mean, double share) const {
    const size_t i = out_.gaussians[j];
    return {mean - bucket_center(timeline(), plan_.level, out_.bucket[j]),
            share * quality_.mean_t_error() * scene_.sigma_t(i)};
  }
  MeanTimeCode code_mean(const MeanTimeTarget& target) const {
    return code_mean_time(out_.mean_times, bucket_width(timeline(), plan_.level), target);
  }
  double decoded_mean(size_t j, const MeanTimeCode& code) const {
    return bucket_center(timeline(), plan_.level, out_.bucket[j]) + static_cast<double>(code.local);
  }
  void set_mean(size_t j, const MeanTimeCode& code) {
    out_.mean_t[j] = code.code;
    if (out_.mean_times.mean_t_fine) out_.mean_t_fine[j] = code.fine;
    out_.decoded_mean_t[j] = decoded_mean(j, code);
  }

  const EncoderScene& scene_;
  const LayerPlan& plan_;
  const CoderOptions& options_;
  const EncoderSettings& settings_;
  Quality quality_;
  bool lossless_ = false;
  CodedLayer out_;
  std::vector<uint8_t> escape_;  // [m] what no code brings within the bounds
};

}  // namespace

CodedLayer code_layer(const EncoderScene& scene, const LayerPlan& plan, const CoderOptions& options,
                      std::vector<uint32_t>* demoted, std::vector<uint32_t>* escapes) {
  return LayerCoder(scene, plan, options).run(demoted, escapes);
}

// Of an escape's mean time in binary32, in temporal standard deviations.
constexpr double kMaxRoundedMean = 0.001;

CodedLayer code_escapes(const EncoderScene& scene, unsigned level, bool flat,
                        const std::vector<uint32_t>& gaussians) {
  CodedLayer out;
  out.level = level;
  out.flat = flat;
  place_in_buckets(scene, gaussians, &out);
  out.escape = true;
  // Seconds since 1970 in binary32 are off by a minute.
  const bool doubles =
      flat || std::any_of(gaussians.begin(), gaussians.end(), [&](uint32_t i) {
        const SeenGaussian seen = scene.seen(i);
        const double off = seen.mean - static_cast<double>(static_cast<float>(seen.mean));
        // What moves fast is elsewhere a thousandth of its life later.
        const double* v = seen.velocity;
        const bool moves = v[0] != 0 || v[1] != 0 || v[2] != 0;
        return (moves && off != 0) || std::fabs(off) * std::sqrt(seen.lambda) > kMaxRoundedMean;
      });
  out.mean_times.mean_t = doubles ? CoordinateCodingId::kRaw64 : CoordinateCodingId::kRaw32;
  if (flat) choose_window_codes(scene, &out);
  out.scale_factor.coding = ScalarCodingId::kConstant;
  for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
    out.component[c] = RawRows{};
  }
  for (const uint32_t i : out.gaussians) {
    const SeenGaussian seen = scene.seen(i);
    // binary32, as they are stored.
    out.decoded_mean_t.push_back(doubles ? seen.mean
                                         : static_cast<double>(static_cast<float>(seen.mean)));
    out.decoded_lambda.push_back(seen.lambda);
    out.opacity.push_back(scene.opacity[i]);
    for (size_t k = 0; k < 3; ++k) {
      // binary32, as they are stored.
      out.position.push_back(static_cast<double>(static_cast<float>(seen.position[k])));
      out.decoded_velocity.push_back(seen.velocity[k]);
    }
  }
  return out;
}

}  // namespace l4d
