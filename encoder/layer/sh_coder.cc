// SPDX-License-Identifier: Apache-2.0
#include "encoder/layer/sh_coder.h"

#include <utility>

#include "encoder/component/codebook_coder.h"
#include "encoder/component/coding_cost.h"
#include "encoder/layer/color_bounds.h"
#include "encoder/prepare/quality.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d {
namespace {

// Step of what hardly weighs, at 42 dB.
constexpr double kMaxShStep = 1.07;
constexpr unsigned kSh = L4D_COMPONENT_SH;

CodedComponent as_transform(const EncoderScene& scene, const CoderOptions& options,
                            const Quality& quality) {
  options.step("sh_transform");
  TransformSettings t;
  t.distortion = quality.distortion_per_coefficient(kSh);
  t.max_step = quality.max_step(kMaxShStep);
  t.principal_axes = true;
  t.integers = true;
  t.base = 3;
  t.keeps = color_check(scene, options.bounds);
  t.base_error = options.bounds.base_color / sh_constant::k0;
  t.threads = options.threads;
  return code_transform(scene.sh.data(), scene.importance[kSh].data(), scene.count, scene.sh_dim(),
                        t);
}

CodedComponent in_codebooks(const EncoderScene& scene, const CoderOptions& options,
                            double rd_lambda) {
  options.step("sh_vq");
  ComponentSettings s = component_settings(*options.settings, kSh);
  s.seed = options.seed * 131 + 7;
  s.threads = options.threads;
  s.device = options.device;
  s.cancelled = options.cancelled;
  s.rd_lambda = rd_lambda;
  s.keeps = color_check(scene, options.bounds);
  const std::vector<float>& weights = rd_lambda > 0 ? scene.importance[kSh] : scene.weight[kSh];
  CodedVq sh = code_vq(scene.sh.data(), weights.data(), scene.count, scene.sh_dim(), {}, s);
  sort_codebooks_by_frequency(sh, {});
  return sh;
}

}  // namespace

CodedComponent code_sh(const EncoderScene& scene, const CoderOptions& options) {
  const Quality quality(*options.settings, scene.count, scene.shared_count);
  const int coding = options.settings->get_int(Parameter::kCoding, kSh);
  const auto reaches_all = [&](const CodedComponent& c) {
    return check_colors(largest_color_errors(scene, c, options.threads), options.bounds).ok();
  };
  if (coding == 1) {
    CodedComponent coded = as_transform(scene, options, quality);
    if (reaches_all(coded)) return coded;
  }
  // Coefficients of 16 bits may not reach a colour far out. Codebooks do: they have escapes.
  const bool by_cost = coding >= 1 || options.settings->get_bool(Parameter::kCodebooksByCost);
  CodedComponent best = in_codebooks(scene, options, by_cost ? quality.rd_lambda(kSh) : 0);
  if (coding != 2) return best;
  CodedComponent other = as_transform(scene, options, quality);
  const auto cost = [&](const CodedComponent& c) {
    return component_bits(c) + weighted_error(scene.sh.data(), rows_of(c).decoded.data(),
                                              scene.importance[kSh].data(), scene.count,
                                              scene.sh_dim()) /
                                   quality.rd_lambda(kSh);
  };
  return cost(other) <= cost(best) && reaches_all(other) ? std::move(other) : std::move(best);
}

}  // namespace l4d
