// SPDX-License-Identifier: Apache-2.0
// What one instant costs as a scene gets longer at equal content per second: open, bytes read,
// decode time, memory. Prints a Markdown table.
#include <cstdio>

#include "bench/tables/common.h"
#include "io/synth/synth.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

struct CountingReader {
  const std::vector<unsigned char>* file;
  uint64_t reads = 0, bytes = 0;
  l4d_reader reader() {
    l4d_reader r = L4D_INIT(l4d_reader);
    r.user = this;
    r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
      auto* self = static_cast<CountingReader*>(user);
      ++self->reads;
      self->bytes += n;
      std::copy_n(self->file->data() + offset, n, static_cast<unsigned char*>(dst));
      return static_cast<int64_t>(n);
    };
    r.size = [](void* user) -> int64_t {
      return static_cast<int64_t>(static_cast<CountingReader*>(user)->file->size());
    };
    return r;
  }
};

}  // namespace

int main() {
  std::puts(
      "| seconds | frames | Gaussians | file bytes | levels | open us | open bytes |"
      " seek reads | seek bytes | of these directory | buckets | Gaussians read | visible |"
      " decode ms | decoder memory MB |");
  std::puts("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
  for (const double seconds : {10.0, 80.0, 640.0}) {
    // Equal content at any instant: the static share is fixed, the dynamic share grows with time.
    io::SynthOptions options;
    options.seconds = seconds;
    options.gaussians = static_cast<uint64_t>(60000 + 2000 * seconds);
    options.static_gaussians = 60000;
    const WeightedScene scene{io::synthesize(options), {}};
    EncoderHandle encoder = make_encoder(scene, {}, "small");
    const std::vector<unsigned char> file = encoder.encode();

    std::vector<double> open_us, decode_ms;
    uint64_t open_bytes = 0, reads = 0, bytes = 0, memory = 0, visible = 0, levels = 0;
    l4d_selection selection{};
    constexpr int kSeeks = 9;
    for (int i = 0; i < kSeeks; ++i) {
      const double t = seconds * (i + 0.5) / kSeeks;
      CountingReader counting{&file};
      DecoderHandle d;
      double started = seconds_now();
      d.open(counting.reader());
      open_us.push_back((seconds_now() - started) * 1e6);
      open_bytes = counting.bytes;
      started = seconds_now();
      GaussianArrays a = d.decode(time_query(t));
      decode_ms.push_back((seconds_now() - started) * 1e3);
      reads += counting.reads;
      bytes += counting.bytes - open_bytes;
      selection = d.select(time_query(t));
      visible += d.slice(t).count();
      memory = std::max(memory, d.counters().peak_memory_bytes);
      levels = d.info().num_layers;
    }
    std::printf(
        "| %.0f | %u | %zu | %zu | %llu | %.0f | %llu | %llu | %llu | %llu | %llu | %llu |"
        " %llu | %.2f | %.1f |\n",
        seconds, scene.scene.timeline.num_frames, scene.scene.count(), file.size(),
        static_cast<unsigned long long>(levels), median(open_us),
        static_cast<unsigned long long>(open_bytes),
        static_cast<unsigned long long>(reads / kSeeks),
        static_cast<unsigned long long>(bytes / kSeeks),
        static_cast<unsigned long long>(selection.directory_bytes),
        static_cast<unsigned long long>(selection.num_spans),
        static_cast<unsigned long long>(selection.num_gaussians),
        static_cast<unsigned long long>(visible / kSeeks), median(decode_ms),
        static_cast<double>(memory) / 1e6);
    std::fflush(stdout);
  }
  return 0;
}
