// SPDX-License-Identifier: Apache-2.0
// What each coding tool costs: scenes with one effect after the other, their bytes and decode time.
#include <cstdio>

#include "bench/tables/common.h"
#include "io/synth/synth.h"
#include "l4d/experimental/inspect.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

std::string tool_names(uint32_t tools) {
  static constexpr const char* kNames[] = {"motion",          "temporal_opacity", "view_dependence",
                                           "residual_stages", "escapes",          "rcq",
                                           "lossless"};
  std::string s;
  for (unsigned i = 0; i < 7; ++i) {
    if ((tools & (1u << i)) != 0) s += (s.empty() ? "" : ", ") + std::string(kNames[i]);
  }
  return s.empty() ? "none" : s;
}

}  // namespace

int main() {
  struct Row {
    const char* name;
    std::vector<std::string> effects;
  };
  const Row rows[] = {
      {"static", {"static"}},
      {"static + view", {"static", "view"}},
      {"static + flicker", {"static", "flicker"}},
      {"static + appear", {"static", "appear"}},
      {"static + rigid", {"static", "rigid"}},
      {"static + deform", {"static", "deform"}},
      {"all", {}},
  };
  std::puts(
      "| effects | tools in the file | layers | bytes/Gaussian | position | mean_t | sh |"
      " scale | rotor_spatial | rotor_temporal | codebooks | decode ns/Gaussian |"
      " slice ms |");
  std::puts("|---|---|---|---|---|---|---|---|---|---|---|---|---|");
  for (const Row& row : rows) {
    io::SynthOptions options;
    options.gaussians = 300000;
    options.seconds = 10;
    options.effects = row.effects;
    const WeightedScene scene{io::synthesize(options), {}};
    const std::vector<unsigned char> file = make_encoder(scene, {}, "small").encode();
    l4d_decoder_options one_thread = L4D_INIT(l4d_decoder_options);
    one_thread.threads = 1;
    DecoderHandle d(&one_thread);
    d.open_memory(file.data(), file.size());
    uint64_t b[L4D_SECTION_COUNT];
    d.check(l4d_decoder_get_sections(d.get(), b, L4D_SECTION_COUNT, nullptr, nullptr, 0));
    GaussianArrays a = d.decode(whole_query());
    a.spans.clear();
    l4d_gaussian_buffers out = a.buffers();
    const l4d_query query = whole_query();
    const double decode =
        time_median(7, [&] { d.check(l4d_decoder_decode(d.get(), &query, &out)); });
    l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
    std::vector<float> p(3 * a.count()), c(6 * a.count()), o(a.count()), sh(a.sh.size());
    splats.capacity = a.count();
    splats.position = p.data();
    splats.covariance = c.data();
    splats.opacity = o.data();
    splats.sh = sh.data();
    const double slice = time_median(7, [&] { d.check(l4d_decoder_slice(d.get(), 5.0, &splats)); });
    const double n = static_cast<double>(a.count());
    const auto per = [&](uint32_t s) { return static_cast<double>(b[s]) / n; };
    std::printf(
        "| %s | %s | %u | %.2f | %.2f | %.2f | %.2f | %.2f | %.2f | %.2f | %.2f | %.1f |"
        " %.2f |\n",
        row.name, tool_names(d.info().tools).c_str(), d.info().num_layers,
        static_cast<double>(file.size()) / n, per(L4D_SECTION_POSITION), per(L4D_SECTION_MEAN_T),
        per(L4D_SECTION_SH), per(L4D_SECTION_SCALE), per(L4D_SECTION_ROTOR_SPATIAL),
        per(L4D_SECTION_ROTOR_TEMPORAL), per(L4D_SECTION_CODEBOOKS), decode * 1e9 / n, slice * 1e3);
    std::fflush(stdout);
  }
  return 0;
}
