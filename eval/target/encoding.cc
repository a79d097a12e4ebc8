// SPDX-License-Identifier: Apache-2.0
#include "eval/target/encoding.h"

#include <algorithm>
#include <iterator>

#include "eval/scene/decoded_scene.h"
#include "l4d/experimental/parameters.h"

namespace l4d::eval {

Encoding encode_scene(Observer& observer, const EncoderHandle& encoder, const std::string& path,
                      bool wants_order, const io::Hold& holder) {
  Encoding result;
  encoder.check(l4d_encoder_set_progress(encoder.get(), &Observer::callback, &observer));
  if (path.empty()) {
    result.stream = encoder.encode();
    result.memory = io::hold(holder, result.stream.size(), "the stream that was made");
  } else {
    encoder.encode_file(path);
  }
  encoder.check(l4d_encoder_set_progress(encoder.get(), nullptr, nullptr));
  result.report = encoder.report();
  for (uint32_t s = 0; s < result.report.num_steps; ++s) {
    const auto& [stage, seconds] = result.report.steps[s];
    const auto known =
        std::find_if(result.stages.begin(), result.stages.end(),
                     [&, name = stage](const auto& other) { return other.first == name; });
    if (known == result.stages.end()) {
      result.stages.emplace_back(stage, seconds);
    } else {
      known->second += seconds;
    }
  }
  result.report.steps = nullptr;  // lent, until the encoder encodes again
  if (wants_order) result.order = encoder.order();
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
                        decoding.threads, decoding.min_sizes);
}

namespace {

bool any_component_is(const EncoderHandle& encoder, double coding) {
  const char* const all[] = {L4D_ENC_CODING ".sh", L4D_ENC_CODING ".scale",
                             L4D_ENC_CODING ".rotor-spatial", L4D_ENC_CODING ".rotor-temporal"};
  return std::any_of(std::begin(all), std::end(all),
                     [&](const char* name) { return encoder.value(name) == coding; });
}

}  // namespace

bool has_quality(const EncoderHandle& encoder) {
  if (encoder.value(L4D_ENC_LOSSLESS) != 0) return false;
  // Of codebooks with stages of their own it is the step of positions alone that follows a quality.
  return encoder.value(L4D_ENC_CODEBOOKS_BY_COST) != 0 || any_component_is(encoder, 1) ||
         any_component_is(encoder, 2);
}

bool has_codebooks(const EncoderHandle& encoder) {
  return encoder.value(L4D_ENC_LOSSLESS) == 0 &&
         (any_component_is(encoder, 0) || any_component_is(encoder, 2));
}

}  // namespace l4d::eval
