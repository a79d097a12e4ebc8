// SPDX-License-Identifier: Apache-2.0
// Coded layers to pages: order inside buckets, columns, page records.
#pragma once

#include <functional>
#include <vector>

#include "encoder/layer/coded_scene.h"
#include "encoder/prepare/scene.h"
#include "libl4dcodec/container/directory.h"
#include "libl4dcodec/container/page.h"

namespace l4d {

struct PageOptions {
  size_t size = 0;  // Gaussians
  int zstd_level = 0;
  bool rans = false;
  const std::function<bool()>* cancelled = nullptr;  // asked on any thread
};

struct BuiltPage {
  PageRecord record;  // offsets open, block as index in the layer
  Bytes bytes;        // stored form
  Bytes sh_detail;    // SH chunk
};

struct BuiltLayer {
  std::vector<BuiltPage> pages;       // by bucket
  std::vector<uint32_t> order;        // scene index of each Gaussian in stored order
  Bytes entropy;                      // tables of rANS pages; empty where the layer has none
  unsigned symbols_per_gaussian = 0;  // of rANS pages, at most
};

// header, layer_header: as choose_header chose them. Throws Cancelled.
BuiltLayer build_layer(const EncoderScene& scene, const SceneHeader& header,
                       const LayerHeader& layer_header, const CodedLayer& layer,
                       const PageOptions& options, int threads);

// The record of block b as far as pages need it: entries, no chunks.
BlockRecord block_entries(const CodedLayer& layer, size_t block);

}  // namespace l4d
