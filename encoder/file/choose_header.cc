// SPDX-License-Identifier: Apache-2.0
#include "encoder/file/choose_header.h"

#include "encoder/component/codebook_coder.h"
#include "encoder/layer/observed_errors.h"
#include "encoder/layer/position_coding.h"
#include "encoder/prepare/scalar.h"

namespace l4d {
namespace {

ScalarCoding choose_opacity(const HeaderSource& source, const std::vector<CodedLayer>& layers) {
  if (source.lossless) {
    ScalarCoding raw;
    raw.coding = ScalarCodingId::kRaw32;
    return raw;
  }
  std::vector<float> all;
  for (const CodedLayer& layer : layers) {
    all.insert(all.end(), layer.opacity.begin(), layer.opacity.end());
  }
  return choose_scalar_coding(all, source.positions.opacity_bits);
}

LayerHeader layer_header(const CodedLayer& layer) {
  LayerHeader header;
  header.level = layer.level;
  header.permanent = layer.permanent;
  header.num_gaussians = layer.gaussians.size();
  header.raw_position = layer.escape;
  header.tier = layer.tier;
  static_cast<MeanTimeCoding&>(header) = layer.mean_times;
  header.log_scale_t = layer.log_scale_t;
  header.scale_factor = layer.scale_factor;
  for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
    describe_component(layer.component[c], &header.component[c]);
  }
  header.directory_bits = layer.directory_bits;
  return header;
}

}  // namespace

SceneHeader choose_header(const HeaderSource& source, const CodedScene& coded,
                          GaussianErrors* worst, GaussianErrors* stated) {
  const EncoderInput& input = source.input;
  SceneHeader header;
  header.num_gaussians = source.scene.count;
  header.timeline = source.scene.timeline;
  header.placement = input.placement;
  header.sh_degree = source.scene.sh_degree;
  header.metadata = source.metadata;
  header.rendering = input.rendering;
  header.presentation = input.presentation;
  if (source.lossless) {
    header.position_at_mean_time = (input.gaussians.flags & L4D_POSITION_AT_MEAN_TIME) != 0;
    header.opacity_logit = (input.gaussians.flags & L4D_OPACITY_LOGIT) != 0;
  }
  static_cast<PositionCoding&>(header) =
      choose_positions(source.positions, coded.layers, source.lossless);
  header.opacity = choose_opacity(source, coded.layers);
  describe_component(coded.sh, &header.sh);
  if (const auto* transform = std::get_if<CodedTransform>(&coded.sh)) {
    header.sh_base = static_cast<unsigned>(transform->base);
  }
  for (const CodedLayer& layer : coded.layers) header.layers.push_back(layer_header(layer));
  // Lossless streams have no errors.
  *worst = {};
  if (!source.lossless) {
    *worst = observed_errors(source.scene, header, header.opacity, coded.layers, source.bounds,
                             source.threads);
  }
  worst->base_color = source.colors.base;
  worst->directional_color = source.colors.directional;
  *stated = *worst;
  if (source.scene.stated_opacity != nullptr) {
    // Fitted opacities move nothing else, but decide when a Gaussian counts as visible.
    const GaussianErrors of_scene =
        observed_errors(source.scene, header, header.opacity, coded.layers, source.bounds,
                        source.threads, ErrorsAgainst::kScene);
    stated->position = of_scene.position;
    stated->opacity = of_scene.opacity;
    stated->visible = of_scene.visible;
  }
  ErrorBounds kept = source.bounds;
  // Nothing bounds how binary16 rounds a Gaussian far from the centre.
  if (header.position == CoordinateCodingId::kF16) kept.position = kept.visible = 0;
  header.errors = statement_of(*stated, kept);
  header.errors.own_min_sizes = !source.lossless && input.importance.min_sizes != nullptr;
  return header;
}

}  // namespace l4d
