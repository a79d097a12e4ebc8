// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "eval/observer.h"
#include "eval/pair/comparison.h"
#include "io/file/memory.h"
#include "l4d/l4d.hpp"

namespace l4d::eval {

// What one encode of a scene gave.
struct Encoding {
  std::vector<unsigned char> stream;  // empty where it went to a file
  std::shared_ptr<void> memory;       // counts it
  l4d_encode_report report{};
  std::vector<uint32_t> order;                         // empty unless it was wanted
  std::vector<std::pair<std::string, double>> stages;  // name and seconds, each name once
};

// Encodes the scene of the encoder. path: of a file to write; in memory where it is empty, and
// `holder` then counts the stream, whose size is known once it is made.
Encoding encode_scene(Observer& observer, const EncoderHandle& encoder, const std::string& path,
                      bool wants_order, const io::Hold& holder = {});

// How streams are decoded to be compared.
struct Decoding {
  l4d_decoder_options decoder;
  uint32_t threads = 0;          // of the comparison, 0 = one per core
  std::vector<float> min_sizes;  // of the scene's Gaussians, as PairMeter takes them
  io::Hold holder;

  Decoding() { decoder = L4D_INIT(l4d_decoder_options); }
};

// Decodes an encoding of a scene, whose order is known, and holds it against the scene.
Comparison compare_encoding(const Decoding& decoding, Observer& observer, const io::Scene& scene,
                            const std::string& path, const Encoding& encoding);

// Whether anything follows the quality: codebooks and lossless streams have none.
bool has_quality(const EncoderHandle& encoder);
// Whether some component is coded by codebooks.
bool has_codebooks(const EncoderHandle& encoder);

}  // namespace l4d::eval
