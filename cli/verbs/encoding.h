// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "cli/common.h"
#include "cli/comparison.h"
#include "cli/pairing.h"
#include "cli/text/progress.h"

namespace l4d::cli {

// What one encode of a scene gave.
struct Encoding {
  std::vector<unsigned char> stream;  // empty where it went to a file
  l4d_encode_report report{};
  std::vector<uint32_t> order;                         // empty unless it was wanted
  std::vector<std::pair<std::string, double>> stages;  // name and seconds, each name once
};

// Encodes the scene of the encoder. path: of a file to write; in memory where it is empty.
Encoding encode_scene(Progress& progress, const EncoderHandle& encoder, const std::string& path,
                      bool wants_order);

// Decodes an encoding of a scene, whose order is known, and holds it against the scene.
Comparison compare_encoding(Context& context, Progress& progress, const io::Scene& scene,
                            const std::string& path, const Encoding& encoding);

double get_parameter(const EncoderHandle& encoder, l4d_encoder_parameter id,
                     int32_t component = L4D_ALL_COMPONENTS);
// Whether anything follows the quality: codebooks and lossless streams have none.
bool has_quality(const EncoderHandle& encoder);
// Whether some component is coded by codebooks.
bool has_codebooks(const EncoderHandle& encoder);

}  // namespace l4d::cli
