// SPDX-License-Identifier: Apache-2.0
#include "tests/hostile/small_files.h"

#include <stdexcept>
#include <utility>

#include "l4d/experimental/parameters.h"
#include "l4d/l4d.hpp"
#include "libl4dcodec/base/ordered.h"
#include "tests/common/sh_detail.h"
#include "tests/common/stream_editor.h"
#include "tests/common/stream_writer.h"
#include "tests/common/test_scene.h"

namespace l4d::test {
namespace {

struct Recipe {
  uint32_t count = 12;
  uint32_t sh_degree = 0;
  const char* preset = "indexed-small";
  bool rans = false;
  uint32_t stages = 1;
  double escape_threshold = 0;
};

Bytes encode_small(const Recipe& recipe) {
  SceneOptions options;
  options.count = recipe.count;
  options.sh_degree = recipe.sh_degree;
  options.num_frames = 4;
  TestScene scene = make_scene(options);
  l4d_encoder_options encoder_options = L4D_INIT(l4d_encoder_options);
  encoder_options.threads = 1;
  const EncoderHandle e(&encoder_options);
  e.check(l4d_encoder_set_preset(e.get(), recipe.preset));
  const bool lossless = std::string(recipe.preset) == "lossless";
  if (lossless) scene.flags = L4D_POSITION_AT_MEAN_TIME;
  std::vector<std::pair<const char*, double>> settings = {{L4D_ENC_MERGE_COUNT, 3},
                                                          {L4D_ENC_PAGE_SIZE, 64},
                                                          {L4D_ENC_ZSTD_LEVEL, 3},
                                                          {L4D_ENC_RANS, recipe.rans ? 1 : 0}};
  if (std::string(recipe.preset) == "default") settings.push_back({L4D_ENC_CODING, 1});
  if (!lossless) {
    settings.insert(settings.end(), {{L4D_ENC_CODEBOOK_SIZE, 2},
                                     {L4D_ENC_KMEANS_ITERATIONS, 4},
                                     {L4D_ENC_ESCAPE_THRESHOLD, recipe.escape_threshold}});
  }
  if (std::string(recipe.preset) == "indexed-small") {
    // Nothing that follows a quality.
    settings.insert(settings.end(), {{L4D_ENC_CODEBOOKS_BY_COST, 0},
                                     {L4D_ENC_REFINE, 0},
                                     {L4D_ENC_FIXED_POSITIONS, 0},
                                     {L4D_ENC_MEAN_T_SHIFT, 0},
                                     {L4D_ENC_OPACITY_BITS, 8},
                                     {L4D_ENC_MAX_POSITION_ERROR, 0},
                                     {L4D_ENC_MAX_COVARIANCE_FACTOR, 0},
                                     {L4D_ENC_MAX_OPACITY_ERROR, 0},
                                     {L4D_ENC_MAX_BASE_COLOR_ERROR, 0},
                                     {L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR, 0}});
  }
  for (const auto& [id, value] : settings) {
    e.check(l4d_encoder_set(e.get(), id, value));
  }
  if (!lossless) {
    const double fractions[] = {1, 0.5, 0.25};
    e.check(l4d_encoder_set_list(e.get(), L4D_ENC_STAGES, fractions, recipe.stages));
  }
  const l4d_gaussians view = scene.view();
  e.check(l4d_encoder_set_scene(e.get(), &view, &scene.timeline, nullptr));
  std::vector<float> weights(scene.count());  // borrowed by the encoder
  if (recipe.escape_threshold > 0) {
    for (size_t i = 0; i < weights.size(); ++i) weights[i] = static_cast<float>(i % 4);
    l4d_importance importance = L4D_INIT(l4d_importance);
    importance.count = scene.count();
    for (uint32_t w = L4D_WEIGHT_SH; w <= L4D_WEIGHT_ROTOR_TEMPORAL; ++w) {
      importance.weights[w] = weights.data();
    }
    e.check(l4d_encoder_set_importance(e.get(), &importance));
  }
  return e.encode();
}

// The same Gaussians by way of a block codebook: each entry is the layer's own, plus zero.
Bytes with_blocks(const Bytes& file) {
  StreamEditor editor(file);
  const auto place = editor.find([](const LayerHeader& l) { return l.level > 0; });
  LayerHeader& layer = editor.header.layers[place.layer];
  EditedDirectoryPage& d = editor.at(place);
  d.page.blocks.resize(1);
  d.tables.resize(1);
  for (const unsigned c : {L4D_COMPONENT_SCALE, L4D_COMPONENT_ROTOR_SPATIAL}) {
    ComponentCoding& coding = layer.component[c];
    const uint32_t entries = coding.stages.at(0).num_entries;
    coding.has_rcq = true;
    coding.rcq.num_entries = 2;
    const unsigned dim = c == L4D_COMPONENT_SCALE ? layer.scale_dim() : 4;
    Bytes residual;
    for (unsigned k = 0; k < dim; ++k) {
      const Bytes column = packed_stream(std::vector<uint16_t>{0x8000, 0x8000}, 16);
      residual.insert(residual.end(), column.begin(), column.end());
    }
    editor.layers[place.layer].rcq[c].raw = residual;
    std::vector<uint16_t> global(entries), zero(entries, 0);
    for (uint32_t i = 0; i < entries; ++i) global[i] = static_cast<uint16_t>(i);
    Bytes table = bit_width(entries) == 0 ? Bytes{} : packed_stream(global, bit_width(entries));
    const Bytes second = packed_stream(zero, 1);
    table.insert(table.end(), second.begin(), second.end());
    d.page.blocks[0].tables[c].num_entries = entries;
    d.tables[0][c].raw = table;
  }
  for (PageRecord& p : d.page.pages) p.block = 0;
  return editor.build();
}

Bytes with_codec(const Bytes& file, uint32_t codec) {
  StreamEditor editor(file);
  for (EditedChunk& codebook : editor.sh_codebooks) codebook.codec = codec;
  for (EditedLayer& layer : editor.layers) {
    for (auto& codebooks : layer.codebooks) {
      for (EditedChunk& codebook : codebooks) codebook.codec = codec;
    }
    layer.entropy.codec = codec;
    for (EditedDirectoryPage& d : layer.directory) {
      d.chunk.codec = codec;
      for (EditedChunk& page : d.pages) {
        if (page.codec != static_cast<uint32_t>(ChunkCodec::kRans32)) page.codec = codec;
      }
    }
  }
  return editor.build();
}

}  // namespace

const std::vector<SmallFile>& small_files() {
  static const std::vector<SmallFile> kFiles = [] {
    Recipe stages, degree3, lossless, transform, rans;
    stages.stages = 3;
    stages.escape_threshold = 2.5;
    stages.sh_degree = 1;
    degree3.sh_degree = 3;
    lossless.preset = "lossless";
    transform.preset = "default";
    transform.sh_degree = 1;
    rans = stages;
    rans.rans = true;
    Recipe both = transform;
    both.rans = true;
    const Bytes rans_transform = with_codec(encode_small(both), 0);
    const Bytes rans_stages = with_codec(encode_small(rans), 0);
    // Stored chunks let damage reach what lies in them.
    const Bytes plain = with_codec(encode_small({}), 0);
    return std::vector<SmallFile>{{"plain", plain},
                                  {"stages", with_codec(encode_small(stages), 0)},
                                  {"degree3", with_codec(encode_small(degree3), 0)},
                                  {"blocks", with_blocks(plain)},
                                  {"lossless", with_codec(encode_small(lossless), 0)},
                                  {"packed", with_codec(encode_small(stages), 1)},
                                  {"transform", with_codec(encode_small(transform), 0)},
                                  {"rans", rans_stages},
                                  {"rans-transform", rans_transform},
                                  {"parts", with_sh_detail(rans_stages, 0)},
                                  {"parts-base", with_sh_detail(rans_transform, 3)}};
  }();
  return kFiles;
}

}  // namespace l4d::test
