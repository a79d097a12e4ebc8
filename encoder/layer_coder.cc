// SPDX-License-Identifier: Apache-2.0
#include "encoder/layer_coder.h"

#include <algorithm>
#include <cmath>

#include "encoder/closed_loop.h"
#include "encoder/quality.h"
#include "decoder/transform.h"
#include "encoder/scalar.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/ordered.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/math/layers.h"
#include "libl4dcodec/math/slice.h"

namespace l4d {
namespace {

constexpr size_t kGrain = 4096;
// Directory pages of about this many buckets in use keep a seek to a few kilobytes.
constexpr double kBucketsPerDirectoryPage = 128;
// Fewer Gaussians than this do not earn a codebook of their own.
constexpr size_t kMinBlockGaussians = 8192;
constexpr size_t kMaxBlocksPerDirectoryPage = 256;
// Steps of what hardly weighs, at 42 dB: log scales, and stereographic coordinates of rotors.
constexpr double kMaxStep[L4D_COMPONENT_COUNT] = {0, 0.6, 0.08, 0.0215};
// A change of one of three coordinates moves the four numbers of a half about twice as far, and their
// squares are averages over four.
constexpr float kRotorPerStereographic = 6.0f;
constexpr double kNearMinusOne = -0.999999;

class LayerCoder {
 public:
  LayerCoder(const EncoderScene& scene, const LayerPlan& plan, const LayerCoderOptions& options)
      : scene_(scene),
        plan_(plan),
        options_(options),
        settings_(*options.settings),
        quality_(settings_, scene.count) {}

  CodedLayer run(std::vector<uint32_t>* misfits) {
    lossless_ = settings_.get_bool(L4D_ENC_LOSSLESS);
    out_.header.level = plan_.level;
    out_.header.permanent = plan_.permanent;
    place_in_buckets();
    code_mean_times();
    if (lossless_) {
      describe_lossless();
    } else {
      code_components();
    }
    decode();
    drop_misfits(misfits);
    if (!lossless_) {
      for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
        rank_codebooks(out_.component[c], out_.blocks);
      }
      describe_components();
    }
    place_means();
    return std::move(out_);
  }

 private:
  size_t count() const { return out_.members.size(); }
  const l4d_timeline& timeline() const { return scene_.timeline; }

  void place_in_buckets() {
    const unsigned level = plan_.level;
    std::vector<std::pair<uint32_t, uint32_t>> order;
    order.reserve(plan_.members.size());
    for (const uint32_t i : plan_.members) {
      order.emplace_back(bucket_of_time(timeline(), scene_.mean_t[i], level), i);
    }
    std::sort(order.begin(), order.end());
    size_t used = 0;
    for (size_t j = 0; j < order.size(); ++j) {
      used += j == 0 || order[j].first != order[j - 1].first;
      out_.bucket.push_back(order[j].first);
      out_.members.push_back(order[j].second);
    }
    const double buckets = num_buckets(level);
    const double span = kBucketsPerDirectoryPage * buckets / std::max<double>(1, static_cast<double>(used));
    unsigned bits = 0;
    while (bits < 16 && static_cast<double>(1u << bits) < std::min(span, buckets)) ++bits;
    out_.header.directory_bits = bits;
  }

  // Runs of whole buckets within one directory page, each large enough to earn a codebook.
  void make_blocks() {
    if (plan_.level == 0 || settings_.get_int(L4D_ENC_RCQ) == 0) return;
    const unsigned bits = out_.header.directory_bits;
    size_t blocks_in_page = 0;
    for (size_t j = 0; j < count();) {
      size_t end = j;
      const uint32_t page = out_.bucket[j] >> bits;
      while (end < count() && out_.bucket[end] >> bits == page) {
        const bool bucket_starts = end == j || out_.bucket[end] != out_.bucket[end - 1];
        if (bucket_starts && end - j >= kMinBlockGaussians) break;
        ++end;
      }
      const bool same_page = !out_.blocks.empty() &&
                             out_.bucket[out_.blocks.back().begin] >> bits == page;
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
    out_.header.mean_t = plan_.permanent ? MeanCodingId::kNone
                         : lossless_     ? MeanCodingId::kRaw32
                                         : MeanCodingId::kF16;
    if (out_.header.mean_t == MeanCodingId::kF16) out_.header.mean_t_shift = choose_mean_t_shift();
    out_.decoded_mean_t.resize(n);
    out_.mean_t.resize(out_.header.mean_t == MeanCodingId::kF16 ? n : 0);
    for (size_t j = 0; j < n; ++j) {
      const double mean = scene_.mean_t[out_.members[j]];
      if (plan_.permanent) {
        out_.decoded_mean_t[j] = bucket_center(timeline(), plan_.level, out_.bucket[j]);
      } else if (lossless_) {
        out_.decoded_mean_t[j] = mean;
      } else {
        out_.mean_t[j] = mean_code(mean, j, &out_.decoded_mean_t[j]);
      }
    }
  }

  // The most low bits that mean times can do without.
  unsigned choose_mean_t_shift() {
    const int set = settings_.get_int(L4D_ENC_MEAN_T_SHIFT);
    if (set >= 0) return static_cast<unsigned>(set);
    const double allowed = quality_.mean_t_error();
    for (unsigned shift = kMaxMeanShift; shift > 0; --shift) {
      out_.header.mean_t_shift = shift;
      double sum = 0;
      for (size_t j = 0; j < count(); ++j) {
        const size_t i = out_.members[j];
        double decoded = 0;
        mean_code(scene_.mean_t[i], j, &decoded);
        const double error = decoded - scene_.mean_t[i];
        sum += std::min(error * error * scene_.lambda[i], 1.0);
      }
      if (sum <= allowed * allowed * static_cast<double>(count())) return shift;
    }
    return 0;
  }

  void describe_lossless() {
    out_.header.scale_factor.coding = ScalarCodingId::kConstant;
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      out_.header.component[c].coding = ComponentCodingId::kRaw32;
    }
  }

  ComponentSettings settings_of(unsigned c) const {
    ComponentSettings s = component_settings(settings_, c);
    s.seed = options_.seed * 131 + plan_.level * 8 + c + (plan_.permanent ? 4096 : 0);
    s.threads = options_.threads;
    s.cancelled = options_.cancelled;
    return s;
  }

  void code_components() {
    make_blocks();
    const size_t n = count();
    const size_t scale_dim = out_.header.scale_dim();
    std::vector<float> factor(n, 0.0f), rows(n * 4), weights(n);
    const bool whole_scale = settings_.get_int(L4D_ENC_CODING, L4D_COMPONENT_SCALE) == 1;
    for (size_t j = 0; j < n && !whole_scale; ++j) {
      const float* s = scene_.log_scale.data() + 4 * size_t{out_.members[j]};
      float sum = 0;
      for (size_t k = 0; k < scale_dim; ++k) sum += s[k];
      factor[j] = sum / static_cast<float>(scale_dim);
    }
    const unsigned bits = static_cast<unsigned>(settings_.get_int(L4D_ENC_SCALE_FACTOR_BITS));
    out_.factor = quantize_scalar(factor, bits, &out_.header.scale_factor);
    for (size_t j = 0; j < n; ++j) factor[j] = decoded_factor(j);
    // Both halves of a rotor, or none: they are coordinates of the same map.
    const bool stereographic = settings_.get_int(L4D_ENC_CODING, L4D_COMPONENT_ROTOR_SPATIAL) == 1 &&
                               settings_.get_int(L4D_ENC_CODING, L4D_COMPONENT_ROTOR_TEMPORAL) == 1;
    if (plan_.permanent) out_.header.log_scale_t = largest_log_scale_t();

    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      static constexpr const char* kSteps[] = {"", "scale_vq", "rotor_spatial_vq",
                                               "rotor_temporal_vq"};
      options_.step(kSteps[c]);
      const bool rotor = c != L4D_COMPONENT_SCALE;
      const bool transform = rotor ? stereographic : whole_scale;
      const size_t dim = !rotor ? scale_dim : transform ? 3 : 4;
      bool any = false;
      for (size_t j = 0; j < n; ++j) {
        const size_t i = out_.members[j];
        weights[j] = scene_.weight[c][i];
        double u[2][3];
        if (rotor && transform) stereographic_rotor(i, u[0], u[1]);
        for (size_t k = 0; k < dim; ++k) {
          const float v = c == L4D_COMPONENT_SCALE ? scene_.log_scale[4 * i + k] - factor[j]
                          : transform ? static_cast<float>(u[c - L4D_COMPONENT_ROTOR_SPATIAL][k])
                          : c == L4D_COMPONENT_ROTOR_SPATIAL ? scene_.rotor[8 * i + k]
                                                             : scene_.rotor[8 * i + 4 + k];
          rows[j * dim + k] = v;
          any = any || v != 0;
        }
        if (transform) {
          weights[j] = scene_.importance[c][i] * (rotor ? kRotorPerStereographic : 1.0f);
        }
      }
      // The spatial half says what kind of map the temporal one belongs to.
      any = any || (transform && c == L4D_COMPONENT_ROTOR_SPATIAL);
      out_.header.component[c].coding =
          !any || (plan_.permanent && c == L4D_COMPONENT_ROTOR_TEMPORAL) ? ComponentCodingId::kZero
          : transform                                                    ? ComponentCodingId::kTransform
                                                                         : ComponentCodingId::kVq;
      if (out_.header.component[c].transform()) {
        TransformSettings s;
        s.distortion = quality_.per_number(c);
        s.max_step = quality_.max_step(kMaxStep[c]);
        s.threads = options_.threads;
        out_.component[c] = code_component_transform(rows.data(), weights.data(), n, dim, s);
        continue;
      }
      if (!out_.header.component[c].vq()) {
        out_.component[c].n = n;
        out_.component[c].dim = dim;
        out_.component[c].decoded.assign(n * dim, 0.0f);
        out_.component[c].depth.assign(n, 0);
        continue;
      }
      out_.component[c] =
          code_component(rows.data(), weights.data(), n, dim, out_.blocks, settings_of(c));
    }
  }

  // Stereographic coordinates of the spatial rotation, and what time adds to one half and takes from
  // the other.
  void stereographic_rotor(size_t i, double* spatial, double* temporal) const {
    double r[8], a[3], b[3];
    for (size_t k = 0; k < 8; ++k) r[k] = static_cast<double>(scene_.rotor[8 * i + k]);
    RotorHalves<double> h = normalized_halves(r);
    // (-1, 0, 0, 0) itself has no coordinates; a neighbour will do.
    h.a[0] = std::max(h.a[0], kNearMinusOne);
    h.b[0] = std::max(h.b[0], kNearMinusOne);
    stereographic_of_half(h.a, a);
    stereographic_of_half(h.b, b);
    for (size_t k = 0; k < 3; ++k) {
      spatial[k] = (a[k] + b[k]) / 2;
      temporal[k] = (a[k] - b[k]) / 2;
    }
  }

  static std::vector<uint16_t> quantize_scalar(const std::vector<float>& values, unsigned bits,
                                               ScalarCoding* coding) {
    std::vector<uint16_t> codes(values.size());
    *coding = choose_scalar_coding(values, bits);
    for (size_t j = 0; j < values.size(); ++j) codes[j] = scalar_code(*coding, values[j]);
    return codes;
  }

  float decoded_factor(size_t j) const {
    const ScalarCoding& f = out_.header.scale_factor;
    return f.coding == ScalarCodingId::kConstant
               ? f.offset
               : f.offset + f.step * static_cast<float>(out_.factor[j]);
  }

  float largest_log_scale_t() const {
    float largest = scene_.log_scale[4 * size_t{out_.members[0]} + 3];
    for (const uint32_t i : out_.members) {
      largest = std::max(largest, scene_.log_scale[4 * size_t{i} + 3]);
    }
    return sound_constant(largest);
  }

  // The decoder's float arithmetic, then the slice in double.
  void decode() {
    const size_t n = count();
    out_.decoded_lambda.resize(n);
    out_.decoded_velocity.resize(3 * n);
    parallel_for(options_.threads, n, kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        float rotor[8], log_scale[4];
        decoded_gaussian(j, rotor, log_scale);
        double r[8], s[4];
        for (size_t k = 0; k < 8; ++k) r[k] = static_cast<double>(rotor[k]);
        for (size_t k = 0; k < 4; ++k) s[k] = std::exp(static_cast<double>(log_scale[k]));
        const Slice4D<double> slice = slice_gaussian(normalized_halves(r), s);
        out_.decoded_lambda[j] = slice.lambda;
        std::copy_n(slice.velocity, 3, out_.decoded_velocity.data() + 3 * j);
      }
    });
  }

  void decoded_gaussian(size_t j, float* rotor, float* log_scale) const {
    const size_t i = out_.members[j];
    if (lossless_) {
      std::copy_n(scene_.rotor.data() + 8 * i, 8, rotor);
      std::copy_n(scene_.log_scale.data() + 4 * i, 4, log_scale);
      return;
    }
    const float factor = decoded_factor(j);
    const size_t dim = out_.header.scale_dim();
    for (size_t k = 0; k < dim; ++k) {
      log_scale[k] = factor + out_.component[L4D_COMPONENT_SCALE].decoded[j * dim + k];
    }
    if (plan_.permanent) log_scale[3] = out_.header.log_scale_t;
    if (SceneHeader::stereographic_rotor(out_.header)) {
      const bool moves = out_.header.component[L4D_COMPONENT_ROTOR_TEMPORAL].transform();
      transform_kernels_reference().rotors(
          out_.component[L4D_COMPONENT_ROTOR_SPATIAL].decoded.data() + 3 * j,
          moves ? out_.component[L4D_COMPONENT_ROTOR_TEMPORAL].decoded.data() + 3 * j : nullptr, 1,
          rotor, false);
      return;
    }
    float merged[8];
    std::copy_n(out_.component[L4D_COMPONENT_ROTOR_SPATIAL].decoded.data() + 4 * j, 4, merged);
    std::copy_n(out_.component[L4D_COMPONENT_ROTOR_TEMPORAL].decoded.data() + 4 * j, 4, merged + 4);
    normalize_rotor(merged, rotor);
  }

  void drop_misfits(std::vector<uint32_t>* misfits) {
    misfits->clear();
    if (plan_.level == 0) return;
    const size_t n = count();
    std::vector<uint8_t> keep(n);
    for (size_t j = 0; j < n; ++j) {
      keep[j] = fits_layer(out_.decoded_mean_t[j], 1 / std::sqrt(out_.decoded_lambda[j]),
                           out_.bucket[j], plan_.level, timeline());
      if (!keep[j]) misfits->push_back(out_.members[j]);
    }
    if (misfits->empty()) return;
    std::sort(misfits->begin(), misfits->end());
    std::vector<size_t> before(n + 1, 0);  // kept Gaussians before j
    for (size_t j = 0; j < n; ++j) before[j + 1] = before[j] + keep[j];
    for (BlockRange& b : out_.blocks) b = {before[b.begin], before[b.end]};
    size_t to = 0;
    for (size_t j = 0; j < n; ++j) {
      if (!keep[j]) continue;
      out_.members[to] = out_.members[j];
      out_.bucket[to] = out_.bucket[j];
      if (!out_.factor.empty()) out_.factor[to] = out_.factor[j];
      if (!out_.mean_t.empty()) out_.mean_t[to] = out_.mean_t[j];
      out_.decoded_mean_t[to] = out_.decoded_mean_t[j];
      out_.decoded_lambda[to] = out_.decoded_lambda[j];
      for (size_t k = 0; k < 3; ++k) {
        out_.decoded_velocity[3 * to + k] = out_.decoded_velocity[3 * j + k];
      }
      ++to;
    }
    out_.members.resize(to);
    out_.bucket.resize(to);
    if (!out_.factor.empty()) out_.factor.resize(to);
    if (!out_.mean_t.empty()) out_.mean_t.resize(to);
    out_.decoded_mean_t.resize(to);
    out_.decoded_lambda.resize(to);
    out_.decoded_velocity.resize(3 * to);
    if (lossless_) return;
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      drop_gaussians(out_.component[c], keep);
    }
  }

  void describe_components() {
    out_.header.num_gaussians = count();
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      describe_component(out_.component[c], &out_.header.component[c]);
    }
  }

  // Means and opacities last: see closed_loop.h.
  void place_means() {
    out_.header.num_gaussians = count();
    const size_t n = count();
    out_.position.resize(3 * n);
    out_.opacity.resize(n);
    const bool closed_loop = settings_.get_bool(L4D_ENC_CLOSED_LOOP) && !lossless_;
    parallel_for(options_.threads, n, kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) {
        const size_t i = out_.members[j];
        out_.opacity[j] = scene_.opacity[i];
        std::copy_n(scene_.position.data() + 3 * i, 3, out_.position.data() + 3 * j);
        if (closed_loop) close_loop(j);
      }
    });
  }

  void close_loop(size_t j) {
    const size_t i = out_.members[j];
    const double begin = timeline().time_begin;
    const double end = begin + scene_.duration;
    // What is permanent does not fade, to a decoder.
    const Fading original{static_cast<double>(scene_.opacity[i]), scene_.mean_t[i],
                          plan_.permanent ? 0.0 : scene_.lambda[i]};
    Fading decoded{original.opacity, out_.decoded_mean_t[j],
                   plan_.permanent ? 0.0 : out_.decoded_lambda[j]};
    if (!plan_.permanent) {
      // Level 0 has one bucket, and its Gaussians may be centred anywhere in time.
      if (plan_.level == 0) {
        const SeenSpan seen({original}, begin, end);
        Fading moved = decoded;
        const uint16_t code = mean_code(seen.matching_mean(original, decoded.lambda), j, &moved.mean);
        const SeenSpan any({original, decoded, moved}, begin, end);
        if (any.match_opacity(original, &moved) < any.match_opacity(original, &decoded)) {
          out_.mean_t[j] = code;
          out_.decoded_mean_t[j] = moved.mean;
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

  // The code of a mean time of member j, and the time that it decodes to.
  uint16_t mean_code(double mean, size_t j, double* decoded) const {
    const double width = bucket_width(timeline(), plan_.level);
    const double center = bucket_center(timeline(), plan_.level, out_.bucket[j]);
    uint16_t code = float_to_half_saturate(static_cast<float>((mean - center) / width));
    const unsigned shift = out_.header.mean_t_shift;
    if (shift > 0) {
      code = unorder_half(static_cast<uint16_t>(
          ((unsigned{order_half(code)} >> shift) << shift) | (1u << (shift - 1))));
    }
    *decoded = center + static_cast<double>(static_cast<float>(width) * half_to_float(code));
    return code;
  }

  const EncoderScene& scene_;
  const LayerPlan& plan_;
  const LayerCoderOptions& options_;
  const EncoderSettings& settings_;
  Quality quality_;
  bool lossless_ = false;
  CodedLayer out_;
};

}  // namespace

CodedLayer code_layer(const EncoderScene& scene, const LayerPlan& plan,
                      const LayerCoderOptions& options, std::vector<uint32_t>* misfits) {
  return LayerCoder(scene, plan, options).run(misfits);
}

}  // namespace l4d
