// SPDX-License-Identifier: Apache-2.0
// Coded layers to pages: order inside buckets, columns, page records.
#pragma once

#include <vector>

#include "encoder/layer_coder.h"
#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/container/page.h"

namespace l4d {

struct PageOptions {
  size_t size = 0;  // Gaussians
  int zstd_level = 0;
  bool rans = false;
};

struct BuiltPage {
  PageRecord record;  // offsets open, block as index in the layer
  Bytes bytes;        // stored form
  Bytes sh_detail;    // second part
};

struct BuiltLayer {
  std::vector<BuiltPage> pages;  // by bucket
  std::vector<uint32_t> order;   // scene index of each Gaussian in stored order
  Bytes entropy;                 // tables of rANS pages; empty where the layer has none
};

// Frame of the coded positions and opacity coding, chosen over all layers.
void choose_frame(const std::vector<CodedLayer>& layers, bool lossless, SceneHeader* header);
// Fixed-point coordinates with a step of about `step`, or as fine as their bits allow.
void choose_fixed_frame(const std::vector<CodedLayer>& layers, double step, SceneHeader* header);
void choose_opacity(const std::vector<CodedLayer>& layers, unsigned bits, SceneHeader* header);

// What a position is decoded to along axis k.
double coded_position(const SceneHeader& header, const LayerHeader& layer, size_t k, double x);

BuiltLayer build_layer(const EncoderScene& scene, const SceneHeader& header,
                       const LayerHeader& layer_header, const CodedLayer& layer,
                       const CodedComponent& sh, const PageOptions& options, int threads);

// The record of block b as far as pages need it: entries, no chunks.
BlockRecord block_entries(const CodedLayer& layer, size_t block);

}  // namespace l4d
