// SPDX-License-Identifier: Apache-2.0
// Time per encoder step and peak memory: the basketball scene, and 1.4 million Gaussians over 1200
// frames (the size of the paper's 40 s scene, whose VQ, RCQ and SQ took 12.4 s on a GPU).
#include <cstdio>

#include "bench/tables/common.h"
#include "io/synth/synth.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

void run(const char* name, const WeightedScene& scene, const std::vector<float>& sh) {
  reset_peak_rss();
  const uint64_t before = peak_rss_bytes();
  EncoderHandle e = make_encoder(scene, sh, "small");
  const std::vector<unsigned char> file = e.encode();
  const l4d_encode_report r = report_of(e);
  std::printf(
      "\n%s: %llu Gaussians, %llu -> %zu bytes, ratio %.2f, peak memory %.0f MB"
      " (%.0f MB of it the input)\n\n",
      name, static_cast<unsigned long long>(r.coded_gaussians),
      static_cast<unsigned long long>(r.raw_bytes), file.size(),
      static_cast<double>(r.raw_bytes) / static_cast<double>(file.size()),
      static_cast<double>(peak_rss_bytes()) / 1e6, static_cast<double>(before) / 1e6);
  std::puts("| step | seconds |\n|---|---|");
  double quantisation = 0;
  for (uint32_t i = 0; i < r.num_steps; ++i) {
    const double s = r.steps[i].seconds;
    const std::string text = r.steps[i].name;
    std::printf("| %s | %.2f |\n", text.c_str(), s);
    if (text != "prepare" && text != "check" && text != "write") quantisation += s;
  }
  std::printf("| VQ, RCQ and SQ together | %.2f |\n| all | %.2f |\n", quantisation,
              r.total_seconds);
  std::fflush(stdout);
}

}  // namespace

int main() {
  {
    io::SynthOptions options;
    options.gaussians = 1400000;
    options.seconds = 40;
    const WeightedScene synth{io::synthesize(options), {}};
    run("synth, 40 s at 30 fps", synth, {});
  }
  if (data_dir().empty()) {
    std::puts("\nbasketball: SKIPPED, set L4D_DATA_DIR");
    return 0;
  }
  const WeightedScene scene = load_basketball();
  run("basketball", scene, sh_weights(scene));
  return 0;
}
