// SPDX-License-Identifier: Apache-2.0
#include "encoder/layer/shape_coder.h"

#include <algorithm>
#include <cmath>

#include "decoder/expand/transform.h"
#include "encoder/component/codebook_coder.h"
#include "encoder/component/coding_cost.h"
#include "encoder/prepare/scalar.h"
#include "libl4dcodec/base/async.h"
#include "libl4dcodec/base/half.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/math/rotor.h"
#include "libl4dcodec/scene/attributes.h"

namespace l4d {
namespace {

// Steps of what hardly weighs, at 42 dB: log scales, and stereographic coordinates of rotors.
constexpr double kMaxStep[L4D_COMPONENT_COUNT] = {0, 0.6, 0.08, 0.0215};
// A change of one of three coordinates moves the four numbers of a half about twice as far, and
// their squares are averages over four.
constexpr float kRotorPerStereographic = 6.0f;
constexpr double kStepShare = 0.95;
constexpr double kNearMinusOne = -0.999999;
// A change of a coordinate of a temporal rotor turns a slow Gaussian's speed about four times as
// far. Two octaves to spare, so that single Gaussians find finer steps.
constexpr double kSpeedPerStereographic = 4.0 * 4.0;
// What an escape takes more than a code.
constexpr double kEscapeBits = 350;
constexpr int kMostFinerOctaves = 16;

constexpr int kComponents = 3;

// Codings of the parameter.
enum { kCodebooks = 0, kTransforms = 1, kCheaper = 2 };

// Vectors of one component, [n, dim], and what their errors weigh.
struct Rows {
  size_t dim = 0;
  std::vector<float> values;
  std::vector<float> weights;     // of codewords
  std::vector<float> importance;  // of one number
  bool any = false;               // whether any number is not zero
};

float decoded_factor(const ScalarCoding& f, const std::vector<uint16_t>& codes, size_t j) {
  return f.coding == ScalarCodingId::kConstant ? f.offset
                                               : f.offset + f.step * static_cast<float>(codes[j]);
}

// In the decoder's float arithmetic.
void decoded_rotor(const CodedComponent& spatial, const CodedComponent& temporal, size_t j,
                   float* rotor) {
  const float* from = rows_of(spatial).decoded.data();
  const float* from_t = rows_of(temporal).decoded.data();
  if (std::holds_alternative<CodedTransform>(spatial)) {
    const bool moves = std::holds_alternative<CodedTransform>(temporal);
    transform_kernels_reference().rotors(from + 3 * j, moves ? from_t + 3 * j : nullptr, 1, rotor,
                                         false);
    return;
  }
  float merged[8];
  std::copy_n(from + 4 * j, 4, merged);
  std::copy_n(from_t + 4 * j, 4, merged + 4);
  normalize_rotor(merged, rotor);
}

// Log scales without the decoded factor.
void scale_row(const EncoderScene& scene, const CodedLayer& layer, size_t j, float factor,
               float* row) {
  const size_t i = layer.gaussians[j], dim = layer.scale_dim();
  for (size_t k = 0; k < dim; ++k) row[k] = scene.log_scale[4 * i + k] - factor;
}

// Stereographic coordinates of the spatial rotation, and what time adds to one half and takes
// from the other.
void stereographic_rows(const EncoderScene& scene, size_t i, float* spatial, float* temporal) {
  double r[8], a[3], b[3];
  for (size_t k = 0; k < 8; ++k) r[k] = static_cast<double>(scene.rotor[8 * i + k]);
  RotorHalves<double> h = normalized_halves(r);
  // (-1, 0, 0, 0) itself has no coordinates; a neighbour will do.
  h.a[0] = std::max(h.a[0], kNearMinusOne);
  h.b[0] = std::max(h.b[0], kNearMinusOne);
  stereographic_of_half(h.a, a);
  stereographic_of_half(h.b, b);
  for (size_t k = 0; k < 3; ++k) {
    spatial[k] = static_cast<float>((a[k] + b[k]) / 2);
    temporal[k] = static_cast<float>((a[k] - b[k]) / 2);
  }
}

class ShapeCoder {
 public:
  ShapeCoder(const EncoderScene& scene, const CoderOptions& options, const Quality& quality,
             CodedLayer& layer)
      : scene_(scene),
        options_(options),
        settings_(*options.settings),
        quality_(quality),
        out_(layer) {}

  void run() {
    if (out_.permanent) out_.log_scale_t = largest_log_scale_t();
    const int threads = resolve_threads(options_.threads);
    apart_ = threads >= kComponents && in_codebooks_only();
    threads_ = apart_ ? (threads + kComponents - 1) / kComponents : threads;
    options_.step("scale_vq");
    std::future<Scales> scales = start_async(apart_, [&] { return best_scales(); });
    Rotors rotors = best_rotors();
    if (apart_) options_.step("scale_vq");
    put_scales(scales.get());
    out_.component[L4D_COMPONENT_ROTOR_SPATIAL] = std::move(rotors[0]);
    out_.component[L4D_COMPONENT_ROTOR_TEMPORAL] = std::move(rotors[1]);
  }

 private:
  struct Scales {
    ScalarCoding factor_coding;
    std::vector<uint16_t> factor;
    CodedComponent coded;
  };
  using Rotors = std::array<CodedComponent, 2>;  // spatial, temporal

  size_t count() const { return out_.gaussians.size(); }
  int coding_of(unsigned c) const {
    return settings_.get_int(Parameter::kCoding, static_cast<int>(c));
  }

  bool in_codebooks_only() const {
    return coding_of(L4D_COMPONENT_SCALE) == kCodebooks &&
           coding_of(L4D_COMPONENT_ROTOR_SPATIAL) == kCodebooks &&
           coding_of(L4D_COMPONENT_ROTOR_TEMPORAL) == kCodebooks;
  }

  Scales best_scales() const {
    const int coding = coding_of(L4D_COMPONENT_SCALE);
    Scales best = scales_as(coding != kCodebooks);
    if (coding == kCheaper) {
      Scales other = scales_as(false);
      if (cost_of(other) < cost_of(best)) best = std::move(other);
    }
    return best;
  }

  void put_scales(Scales scales) {
    out_.scale_factor = scales.factor_coding;
    out_.factor = std::move(scales.factor);
    out_.component[L4D_COMPONENT_SCALE] = std::move(scales.coded);
  }

  Rotors best_rotors() const {
    const int spatial = coding_of(L4D_COMPONENT_ROTOR_SPATIAL);
    const int temporal = coding_of(L4D_COMPONENT_ROTOR_TEMPORAL);
    // Both halves of a rotor are stereographic, or none: they are coordinates of the same map.
    const bool cheaper = spatial == kCheaper || temporal == kCheaper;
    Rotors best = rotors_as(cheaper || (spatial == kTransforms && temporal == kTransforms));
    if (cheaper) {
      Rotors other = rotors_as(false);
      if (cost_of(other) < cost_of(best)) best = std::move(other);
    }
    return best;
  }

  // Transforms are of whole log scales, codebooks of what is left without their mean.
  Scales scales_as(bool transform) const {
    const size_t n = count(), dim = out_.scale_dim();
    std::vector<float> factor(n, 0.0f);
    if (!transform) {
      for_all([&](size_t j) {
        const float* s = scene_.log_scale.data() + 4 * size_t{out_.gaussians[j]};
        float sum = 0;
        for (size_t k = 0; k < dim; ++k) sum += s[k];
        factor[j] = sum / static_cast<float>(dim);
      });
    }
    Scales out;
    const unsigned bits = static_cast<unsigned>(settings_.get_int(Parameter::kScaleFactorBits));
    out.factor_coding = choose_scalar_coding(factor, bits);
    out.factor.resize(n);
    Rows rows = make_rows(L4D_COMPONENT_SCALE, dim);
    for_all([&](size_t j) {
      out.factor[j] = scalar_code(out.factor_coding, factor[j]);
      const float decoded = decoded_factor(out.factor_coding, out.factor, j);
      scale_row(scene_, out_, j, decoded, rows.values.data() + j * dim);
    });
    rows.any = any_number(rows);
    out.coded = code_rows(L4D_COMPONENT_SCALE, rows, transform, options_.cancelled);
    return out;
  }

  Rotors rotors_as(bool stereographic) const {
    options_.step("rotor_spatial_vq");
    const size_t dim = stereographic ? 3 : 4;
    Rows halves[2] = {make_rows(L4D_COMPONENT_ROTOR_SPATIAL, dim),
                      make_rows(L4D_COMPONENT_ROTOR_TEMPORAL, dim)};
    for_all([&](size_t j) {
      const size_t i = out_.gaussians[j];
      float* const rows[2] = {halves[0].values.data() + j * dim, halves[1].values.data() + j * dim};
      if (stereographic) stereographic_rows(scene_, i, rows[0], rows[1]);
      for (unsigned half = 0; half < 2; ++half) {
        if (!stereographic) std::copy_n(scene_.rotor.data() + 8 * i + 4 * half, 4, rows[half]);
        if (stereographic) halves[half].importance[j] *= kRotorPerStereographic;
      }
    });
    // The spatial half says what kind of map the temporal one belongs to.
    halves[0].any = stereographic || any_number(halves[0]);
    halves[1].any = !out_.permanent && any_number(halves[1]);
    std::future<CodedComponent> spatial = start_async(apart_, [&] {
      return code_rows(L4D_COMPONENT_ROTOR_SPATIAL, halves[0], stereographic, options_.cancelled);
    });
    options_.step("rotor_temporal_vq");
    Rotors out;
    out[1] = code_rows(L4D_COMPONENT_ROTOR_TEMPORAL, halves[1], stereographic, options_.cancelled);
    if (apart_) options_.step("rotor_spatial_vq");
    out[0] = spatial.get();
    return out;
  }

  Rows make_rows(unsigned c, size_t dim) const {
    const size_t n = count();
    Rows rows;
    rows.dim = dim;
    rows.values.resize(n * dim);
    rows.weights.resize(n);
    rows.importance.resize(n);
    for_all([&](size_t j) {
      rows.weights[j] = scene_.weight[c][out_.gaussians[j]];
      rows.importance[j] = scene_.importance[c][out_.gaussians[j]];
    });
    return rows;
  }
  static bool any_number(const Rows& rows) {
    return std::any_of(rows.values.begin(), rows.values.end(), [](float v) { return v != 0; });
  }

  // body(j) for all Gaussians, on several threads.
  template <typename Body>
  void for_all(const Body& body) const {
    parallel_for(threads_, count(), kGrain, [&](size_t begin, size_t end) {
      for (size_t j = begin; j < end; ++j) body(j);
    });
  }

  CodedComponent code_rows(unsigned c, const Rows& rows, bool transform,
                           const std::function<bool()>* cancelled) const {
    const size_t n = count();
    if (!rows.any) {
      return CodedRows{n, rows.dim, std::vector<float>(n * rows.dim, 0.0f)};
    }
    if (transform) {
      TransformSettings s;
      s.distortion = quality_.distortion_per_coefficient(c);
      s.max_step = quality_.max_step(kMaxStep[c]);
      // Half a step of a log scale is a factor of a variance. With a coarser one most Gaussians
      // would be beyond their bound, and pay for a whole bit.
      if (c == L4D_COMPONENT_SCALE && options_.bounds.covariance > 1) {
        s.max_step = std::min(s.max_step, kStepShare * std::log(options_.bounds.covariance));
      }
      if (c == L4D_COMPONENT_ROTOR_TEMPORAL) {
        s.max_step = std::ldexp(s.max_step, -finer_octaves(s.max_step, rows.dim));
      }
      // What does not move has to decode to what does not move, whatever others do.
      s.zero_origin = c == L4D_COMPONENT_ROTOR_TEMPORAL;
      s.all_coefficients = true;
      s.threads = threads_;
      return code_transform(rows.values.data(), rows.importance.data(), n, rows.dim, s);
    }
    ComponentSettings s = component_settings(settings_, c);
    s.seed = options_.seed * 131 + out_.level * 8 + c + (out_.permanent ? 4096 : 0);
    s.threads = threads_;
    s.device = options_.device;
    s.cancelled = cancelled;
    const bool by_cost =
        settings_.get_bool(Parameter::kCodebooksByCost) || coding_of(c) == kCheaper;
    if (by_cost) s.rd_lambda = quality_.rd_lambda(c);
    return code_vq(rows.values.data(), (by_cost ? rows.importance : rows.weights).data(), n,
                   rows.dim, out_.blocks, s);
  }

  // By how many octaves the largest step of temporal rotors is to be finer. A rotor mixes lengths
  // with seconds, so that the steps which keep positions follow the unit of the scene, and step
  // exponents may not reach them. Fewest bits: those of rows that need no such steps against those
  // of escapes.
  int finer_octaves(double step, size_t dim) const {
    if (!(options_.bounds.position > 0)) return 0;
    // TRAN-2: no step is below 2^-20.
    const int most = std::clamp(static_cast<int>(std::log2(step) + 20), 0, kMostFinerOctaves);
    double cost[kMostFinerOctaves + 1] = {};
    for (const uint32_t i : out_.gaussians) {
      const double wanted = std::log2(step / position_keeping_step(i));
      for (int o = 0; o <= most; ++o) {
        cost[o] += static_cast<double>(dim) * std::max(0.0, o - std::max(wanted, 0.0));
        if (wanted > o + static_cast<int>(kTransformStepExponents) - 1) cost[o] += kEscapeBits;
      }
    }
    return static_cast<int>(std::min_element(cost, cost + most + 1) - cost);
  }

  // The step of temporal rotors, about, with which Gaussian i stays within its bound of position.
  double position_keeping_step(size_t i) const {
    const SeenGaussian g = scene_.seen(i);
    const Sequence shown = scene_.shown(i);
    const double nearest = std::clamp(g.mean, shown.begin, shown.end) - g.mean;
    const double half = std::sqrt(nearest * nearest + 2 * std::log(2.0) / g.lambda);
    const double seconds = std::clamp(g.mean + half, shown.begin, shown.end) -
                           std::clamp(g.mean - half, shown.begin, shown.end);
    const double trace = g.covariance[0] + g.covariance[3] + g.covariance[5];
    const double size = std::max({std::sqrt(trace / 3), options_.bounds.min_size, g.min_size});
    double speed2 = 0;
    for (const double v : g.velocity) speed2 += v * v;
    const double moved = kSpeedPerStereographic * (1 + speed2) * 0.5 * seconds;  // for a step of 1
    return 2 * options_.bounds.position * size / std::max(moved, 1e-30);
  }

  // Bits, and errors in bits of the same worth.
  double cost_of(const Scales& scales) const {
    const size_t n = count(), dim = out_.scale_dim();
    const std::vector<float>& decoded = rows_of(scales.coded).decoded;
    double error = 0;
    for (size_t j = 0; j < n; ++j) {
      const size_t i = out_.gaussians[j];
      const float factor = decoded_factor(scales.factor_coding, scales.factor, j);
      const double importance = static_cast<double>(scene_.importance[L4D_COMPONENT_SCALE][i]);
      for (size_t k = 0; k < dim; ++k) {
        const double e = static_cast<double>(scene_.log_scale[4 * i + k]) -
                         static_cast<double>(factor + decoded[j * dim + k]);
        error += importance * e * e;
      }
    }
    const bool constant = scales.factor_coding.coding == ScalarCodingId::kConstant;
    return component_bits(scales.coded) + (constant ? 0 : codes_bits(scales.factor)) +
           error / quality_.rd_lambda(L4D_COMPONENT_SCALE);
  }

  double cost_of(const Rotors& rotors) const {
    double error[2] = {0, 0};
    for (size_t j = 0; j < count(); ++j) {
      const size_t i = out_.gaussians[j];
      float decoded[8];
      decoded_rotor(rotors[0], rotors[1], j, decoded);
      for (size_t k = 0; k < 8; ++k) {
        const double e =
            static_cast<double>(scene_.rotor[8 * i + k]) - static_cast<double>(decoded[k]);
        error[k / 4] +=
            static_cast<double>(scene_.importance[L4D_COMPONENT_ROTOR_SPATIAL + k / 4][i]) * e * e;
      }
    }
    double cost = 0;
    for (unsigned half = 0; half < 2; ++half) {
      cost += component_bits(rotors[half]) +
              error[half] / quality_.rd_lambda(L4D_COMPONENT_ROTOR_SPATIAL + half);
    }
    return cost;
  }

  float largest_log_scale_t() const {
    float largest = scene_.log_scale[4 * size_t{out_.gaussians[0]} + 3];
    for (const uint32_t i : out_.gaussians) {
      largest = std::max(largest, scene_.log_scale[4 * size_t{i} + 3]);
    }
    return sound_constant(largest);
  }

  const EncoderScene& scene_;
  const CoderOptions& options_;
  const EncoderSettings& settings_;
  const Quality& quality_;
  CodedLayer& out_;
  // Scales and both halves of rotors side by side: much of their training is one after the other.
  bool apart_ = false;
  int threads_ = 0;  // of each
};

}  // namespace

ShapeRefiner::ShapeRefiner(const EncoderScene& scene, CodedLayer* layer)
    : scene_(scene), layer_(*layer) {}

void ShapeRefiner::make_row(size_t j, unsigned c, float* row) const {
  const size_t i = layer_.gaussians[j];
  if (c == L4D_COMPONENT_SCALE) {
    scale_row(scene_, layer_, j, decoded_factor(layer_.scale_factor, layer_.factor, j), row);
    return;
  }
  const bool temporal = c == L4D_COMPONENT_ROTOR_TEMPORAL;
  if (!std::holds_alternative<CodedTransform>(layer_.component[c])) {
    std::copy_n(scene_.rotor.data() + 8 * i + (temporal ? 4 : 0), 4, row);
    return;
  }
  float rows[2][3];
  stereographic_rows(scene_, i, rows[0], rows[1]);
  std::copy_n(rows[temporal ? 1 : 0], 3, row);
}

bool ShapeRefiner::refine(size_t j, unsigned c) {
  float row[4];
  if (auto* transform = std::get_if<CodedTransform>(&layer_.component[c])) {
    make_row(j, c, row);
    return refine_row(row, j, *transform);
  }
  auto* vq = std::get_if<CodedVq>(&layer_.component[c]);
  if (vq == nullptr || vq->depth[j] == kEscapeDepth) return false;
  make_row(j, c, row);
  vq->depth[j] = kEscapeDepth;
  for (size_t k = 0; k < vq->dim; ++k) {
    vq->decoded[j * vq->dim + k] = half_to_float(float_to_half_saturate(row[k]));
  }
  return true;
}

ShapeRefiner::State ShapeRefiner::save(size_t j, unsigned c) const {
  const CodedComponent& component = layer_.component[c];
  const CodedRows& rows = rows_of(component);
  State s;
  std::copy_n(rows.decoded.data() + j * rows.dim, rows.dim, s.decoded);
  if (const auto* vq = std::get_if<CodedVq>(&component)) s.depth = vq->depth[j];
  if (const auto* transform = std::get_if<CodedTransform>(&component)) {
    s.step_exponent = transform->step_exponent[j];
    for (size_t k = 0; k < transform->coefficient.size(); ++k) {
      s.coefficient[k] = transform->coefficient[k][j];
    }
  }
  return s;
}

void ShapeRefiner::restore(size_t j, unsigned c, const State& s) {
  CodedComponent& component = layer_.component[c];
  CodedRows& rows = rows_of(component);
  std::copy_n(s.decoded, rows.dim, rows.decoded.data() + j * rows.dim);
  if (auto* vq = std::get_if<CodedVq>(&component)) vq->depth[j] = s.depth;
  if (auto* transform = std::get_if<CodedTransform>(&component)) {
    transform->step_exponent[j] = s.step_exponent;
    for (size_t k = 0; k < transform->coefficient.size(); ++k) {
      transform->coefficient[k][j] = s.coefficient[k];
    }
  }
}

void finish_shapes(CodedLayer* layer) {
  for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
    if (auto* transform = std::get_if<CodedTransform>(&layer->component[c])) {
      drop_unused_coefficients(*transform);
    } else if (auto* vq = std::get_if<CodedVq>(&layer->component[c])) {
      vq->any_escape =
          std::find(vq->depth.begin(), vq->depth.end(), kEscapeDepth) != vq->depth.end();
    }
  }
}

void code_shapes(const EncoderScene& scene, const CoderOptions& options, const Quality& quality,
                 CodedLayer* layer) {
  ShapeCoder(scene, options, quality, *layer).run();
}

void decoded_shape(const CodedLayer& layer, size_t j, float* rotor, float* log_scale) {
  const float factor = decoded_factor(layer.scale_factor, layer.factor, j);
  const size_t dim = layer.scale_dim();
  const std::vector<float>& scales = rows_of(layer.component[L4D_COMPONENT_SCALE]).decoded;
  for (size_t k = 0; k < dim; ++k) {
    log_scale[k] = clamp_log_scale(factor + scales[j * dim + k]);
  }
  if (layer.permanent) log_scale[3] = layer.log_scale_t;
  decoded_rotor(layer.component[L4D_COMPONENT_ROTOR_SPATIAL],
                layer.component[L4D_COMPONENT_ROTOR_TEMPORAL], j, rotor);
}

}  // namespace l4d
