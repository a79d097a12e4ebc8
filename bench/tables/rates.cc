// SPDX-License-Identifier: Apache-2.0
// Bytes and encoding time of the quantisation schemes on the basketball scene, with the order-0
// entropy of what is coded. Prints a Markdown table.
#include <array>
#include <cmath>
#include <cstdio>
#include <map>

#include "bench/tables/common.h"
#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"
#include "l4d/experimental/parameters.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

struct Scheme {
  const char* name;
  uint32_t codebook;
  std::vector<double> sh, geometry;
  bool paper_thresholds;
};

double entropy_bits(const std::vector<uint16_t>& symbols) {
  std::map<uint16_t, size_t> count;
  for (const uint16_t s : symbols) ++count[s];
  double bits = 0;
  for (const auto& [symbol, n] : count) {
    bits += static_cast<double>(n) *
            std::log2(static_cast<double>(symbols.size()) / static_cast<double>(n));
  }
  return bits;
}

// Order-0 entropies, bits per Gaussian: indices of stage 0 by component and layer, opacity, factor.
struct Entropies {
  double opacity = 0, factor = 0, index = 0;
};

Entropies measure(const std::vector<unsigned char>& file) {
  DecoderHandle d;
  d.open_memory(file.data(), file.size());
  const l4d_query query = whole_query();
  const l4d_selection s = d.select(query);
  const size_t n = static_cast<size_t>(s.num_gaussians);
  std::vector<uint16_t> opacity(n), factor(n);
  std::vector<l4d_bucket_span> spans(static_cast<size_t>(s.num_spans));
  std::array<std::vector<uint16_t>, L4D_COMPONENT_COUNT> index;
  std::array<std::vector<uint8_t>, L4D_COMPONENT_COUNT> depth;
  l4d_packed_buffers b = L4D_INIT(l4d_packed_buffers);
  b.capacity = n;
  b.opacity = opacity.data();
  b.scale_factor = factor.data();
  b.spans = spans.data();
  b.span_capacity = spans.size();
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    index[c].resize(n * L4D_MAX_STAGES);
    depth[c].resize(n);
    b.component[c].index = index[c].data();
    b.component[c].depth = depth[c].data();
  }
  d.check(l4d_decoder_decode_packed(d.get(), &query, &b));
  Entropies e;
  e.opacity = entropy_bits(opacity) / static_cast<double>(n);
  size_t streams = 0;
  double bits = 0;
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    // Codebooks differ from layer to layer (but for SH), so statistics do too.
    std::map<uint32_t, std::vector<uint16_t>> by_layer;
    for (const l4d_bucket_span& r : spans) {
      for (uint64_t i = r.first; i < r.first + r.count; ++i) {
        if (depth[c][i] > 0 && depth[c][i] != 255) {
          by_layer[c == L4D_COMPONENT_SH ? 0 : r.layer].push_back(index[c][i]);
          ++streams;
        }
      }
    }
    for (const auto& [layer, symbols] : by_layer) bits += entropy_bits(symbols);
  }
  e.index = streams == 0 ? 0 : bits / static_cast<double>(streams);
  std::map<uint32_t, std::vector<uint16_t>> factors;
  for (const l4d_bucket_span& r : spans) {
    auto& to = factors[r.layer];
    to.insert(to.end(), factor.begin() + static_cast<long>(r.first),
              factor.begin() + static_cast<long>(r.first + r.count));
  }
  for (const auto& [layer, symbols] : factors) e.factor += entropy_bits(symbols);
  e.factor /= static_cast<double>(n);
  return e;
}

}  // namespace

int main() {
  if (data_dir().empty()) {
    std::puts("SKIPPED: set L4D_DATA_DIR to a folder with basketball/basketball.ply");
    return 0;
  }
  const WeightedScene scene = load_basketball();
  const std::vector<float> sh = sh_weights(scene);
  const Scheme schemes[] = {
      {"plain, K=4096 (preset indexed-small)", 4096, {1}, {1}, false},
      {"2 stages for all, K=1024", 1024, {1, 1}, {1, 1}, false},
      {"100/50 %, K=4096", 4096, {1, .5f}, {1, .5f}, false},
      {"100/50/25 %, K=4096", 4096, {1, .5f, .25f}, {1, .5f, .25f}, false},
      {"100/50/25/10 %, K=1024", 1024, {1, .5f, .25f, .1f}, {1, .5f, .25f, .1f}, false},
      {"100/60/40/20/10 %, K=256", 256, {1, .6f, .4f, .2f, .1f}, {1, .6f, .4f, .2f, .1f}, false},
      {"SH 100/60/40/20/10 %, geometry 100/50 %, K=1024 (preset indexed)",
       1024,
       {1, .6f, .4f, .2f, .1f},
       {1, .5f},
       false},
      {"3 stages for all, K=1024", 1024, {1, 1, 1}, {1, 1, 1}, false},
      {"paper Small thresholds, escapes", 4096, {1}, {1}, true},
  };
  std::puts(
      "| scheme | bytes | ratio | codebooks | position + mean_t bits | stage-0 index H0 |"
      " opacity H0 | factor H0 | encode s |");
  std::puts("|---|---|---|---|---|---|---|---|---|");
  for (const Scheme& s : schemes) {
    EncoderHandle e = make_encoder(scene, sh, "indexed");
    e.set(L4D_ENC_CODEBOOK_SIZE, s.codebook);
    e.set_list(L4D_ENC_STAGES, s.geometry);
    e.set_list(L4D_ENC_STAGES ".sh", s.sh);
    if (s.paper_thresholds) {
      e.set(L4D_ENC_ESCAPE_THRESHOLD ".sh", 6e-7);
      e.set(L4D_ENC_ESCAPE_THRESHOLD ".scale", 2e-7);
      e.set(L4D_ENC_ESCAPE_THRESHOLD ".rotor-spatial", 1e-6);
      e.set(L4D_ENC_ESCAPE_THRESHOLD ".rotor-temporal", 8e-6);
    }
    const std::vector<unsigned char> file = e.encode();
    const l4d_encode_report r = report_of(e);
    DecoderHandle d;
    d.open_memory(file.data(), file.size());
    uint64_t sections[L4D_SECTION_COUNT];
    d.check(l4d_decoder_get_sections(d.get(), sections, L4D_SECTION_COUNT, nullptr, nullptr, 0));
    const Entropies h = measure(file);
    const double n = static_cast<double>(r.coded_gaussians);
    std::printf(
        "| %s | %llu | %.2f | %llu | %.1f | %.2f | %.2f | %.2f | %.1f |\n", s.name,
        static_cast<unsigned long long>(r.file_bytes),
        static_cast<double>(r.raw_bytes) / static_cast<double>(r.file_bytes),
        static_cast<unsigned long long>(sections[L4D_SECTION_CODEBOOKS]),
        8.0 * static_cast<double>(sections[L4D_SECTION_POSITION] + sections[L4D_SECTION_MEAN_T]) /
            n,
        h.index, h.opacity, h.factor, r.total_seconds);
    std::fflush(stdout);
  }
  EncoderHandle e = make_encoder(scene, sh, "lossless");
  e.encode();
  const l4d_encode_report r = report_of(e);
  std::printf("| lossless | %llu | %.2f | 0 | | | | | %.1f |\n",
              static_cast<unsigned long long>(r.file_bytes),
              static_cast<double>(r.raw_bytes) / static_cast<double>(r.file_bytes),
              r.total_seconds);
  return 0;
}
