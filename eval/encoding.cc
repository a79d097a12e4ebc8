// SPDX-License-Identifier: Apache-2.0
#include "eval/encoding.h"

#include <algorithm>

#include "eval/decoded_scene.h"

namespace l4d::eval {

Encoding encode_scene(Observer& observer, const EncoderHandle& encoder, const std::string& path,
                      bool wants_order) {
  Encoding result;
  encoder.check(l4d_encoder_set_progress(encoder.get(), &Observer::callback, &observer));
  if (path.empty()) {
    result.stream = encoder.encode();
  } else {
    encoder.check(l4d_encoder_encode_file(encoder.get(), path.c_str()));
  }
  encoder.check(l4d_encoder_set_progress(encoder.get(), nullptr, nullptr));
  l4d_encode_report_init(&result.report);
  encoder.check(l4d_encoder_get_report(encoder.get(), &result.report));
  for (uint32_t s = 0; s < result.report.num_steps; ++s) {
    const char* stage = nullptr;
    double seconds = 0;
    encoder.check(l4d_encoder_get_step(encoder.get(), s, &stage, &seconds));
    const auto known =
        std::find_if(result.stages.begin(), result.stages.end(),
                     [&](const auto& known_stage) { return known_stage.first == stage; });
    if (known == result.stages.end()) {
      result.stages.emplace_back(stage, seconds);
    } else {
      known->second += seconds;
    }
  }
  if (wants_order) {
    result.order.resize(static_cast<size_t>(result.report.coded_gaussians));
    encoder.check(l4d_encoder_get_order(encoder.get(), result.order.data(), result.order.size()));
  }
  return result;
}

Comparison compare_encoding(const Decoding& decoding, Observer& observer, const io::Scene& scene,
                            const std::string& path, const Encoding& encoding) {
  DecoderHandle decoder(&decoding.decoder);
  decoder.check(l4d_decoder_set_progress(decoder.get(), &Observer::callback, &observer));
  if (encoding.stream.empty()) {
    decoder.open_file(path);
  } else {
    decoder.open_memory(encoding.stream.data(), encoding.stream.size());
  }
  const DecodedScene decoded = decode_scene(decoder, nullptr, decoding.holder);
  return compare_scenes(scene, decoded, pair_by_order(scene, decoded.scene, encoding.order),
                        decoding.threads);
}

double get_parameter(const EncoderHandle& encoder, l4d_encoder_parameter id, int32_t component) {
  double value = 0;
  encoder.check(l4d_encoder_get(encoder.get(), id, component, &value));
  return value;
}

namespace {

bool any_component_is(const EncoderHandle& encoder, double coding) {
  for (int32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (get_parameter(encoder, L4D_ENC_CODING, c) == coding) return true;
  }
  return false;
}

}  // namespace

bool has_quality(const EncoderHandle& encoder) {
  if (get_parameter(encoder, L4D_ENC_LOSSLESS) != 0) return false;
  // Of codebooks with stages of their own it is the step of positions alone that follows a quality.
  return get_parameter(encoder, L4D_ENC_CODEBOOKS_BY_COST) != 0 || any_component_is(encoder, 1) ||
         any_component_is(encoder, 2);
}

bool has_codebooks(const EncoderHandle& encoder) {
  return get_parameter(encoder, L4D_ENC_LOSSLESS) == 0 &&
         (any_component_is(encoder, 0) || any_component_is(encoder, 2));
}

}  // namespace l4d::eval
