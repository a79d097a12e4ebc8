// SPDX-License-Identifier: Apache-2.0
// What a blocking player asks a network for: reads, bytes and waiting to the first picture, in
// playback and for a seek, as a plain reader and as one that tells its block size
// (l4d_reader.block_bytes). Prints Markdown tables.
//   tables_requests [STREAM.l4d...]: otherwise of two synthetic scenes of ten minutes.
#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <string>

#include "bench/tables/common.h"
#include "io/synth/synth.h"

namespace {

using namespace l4d;
using namespace l4d::bench;

constexpr double kFps = 30;
constexpr double kRoundTrip = 0.05;  // seconds
constexpr double kBytesPerSecond = 25e6 / 8;
constexpr uint64_t kBlock = 65536;

struct Network {
  const std::vector<unsigned char>* file;
  uint64_t block = 0;
  uint64_t reads = 0, rounds = 0, bytes = 0;

  // Of reads one after the other; those of one read_many share a round trip.
  double seconds() const {
    return static_cast<double>(rounds) * kRoundTrip + static_cast<double>(bytes) / kBytesPerSecond;
  }
  void copy(void* dst, size_t n, uint64_t offset) {
    ++reads;
    bytes += n;
    std::copy_n(file->data() + offset, n, static_cast<unsigned char*>(dst));
  }
  l4d_reader reader() {
    l4d_reader r = L4D_INIT(l4d_reader);
    r.user = this;
    r.block_bytes = block;
    r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
      auto* self = static_cast<Network*>(user);
      ++self->rounds;
      self->copy(dst, n, offset);
      return static_cast<int64_t>(n);
    };
    r.read_many = [](void* user, const l4d_read* all, size_t count) -> int {
      auto* self = static_cast<Network*>(user);
      ++self->rounds;
      for (size_t i = 0; i < count; ++i) self->copy(all[i].dst, all[i].size, all[i].offset);
      return 0;
    };
    r.size = [](void* user) -> int64_t {
      return static_cast<int64_t>(static_cast<Network*>(user)->file->size());
    };
    return r;
  }
  void forget() { reads = rounds = bytes = 0; }
};

void print_row(const std::string& name, const char* what, const Network& n, double per,
               const std::string& more) {
  std::printf("| %s | %s | %s | %.1f | %.1f | %.1f | %.2f | %s |\n", name.c_str(),
              n.block == 0 ? "plain" : "64 KiB", what, static_cast<double>(n.reads) / per,
              static_cast<double>(n.rounds) / per, static_cast<double>(n.bytes) / per / 1e3,
              n.seconds() / per, more.c_str());
}

void measure(const std::string& name, const std::vector<unsigned char>& file) {
  for (const uint64_t block : {uint64_t{0}, kBlock}) {
    Network network{&file, block};
    DecoderHandle d;
    d.open(network.reader());
    const l4d_timeline timeline = d.info().timeline;
    const double begin = timeline.time_begin;
    const double seconds = timeline.num_frames * static_cast<double>(timeline.fps_den) /
                           static_cast<double>(timeline.fps_num);
    (void)d.slice(begin);
    print_row(name, "first picture, at the begin", network, 1, "");

    const double play = std::min(20.0, seconds - 1);
    network.forget();
    uint64_t waits = 0;
    for (int frame = 1; frame <= play * kFps; ++frame) {
      const uint64_t before = network.rounds;
      (void)d.slice(begin + frame / kFps);
      waits += network.rounds != before;
    }
    print_row(name, "a second of playback", network, play,
              std::to_string(waits) + " of " + std::to_string(static_cast<int>(play * kFps)) +
                  " frames wait");

    network.forget();
    constexpr int kSeeks = 20;
    for (int i = 0; i < kSeeks; ++i) {
      (void)d.slice(begin + seconds * ((7 * i) % kSeeks + 0.5) / kSeeks);
    }
    print_row(name, "a seek", network, kSeeks, "");

    Network late{&file, block};
    DecoderHandle fresh;
    fresh.open(late.reader());
    (void)fresh.slice(begin + seconds / 2);
    print_row(name, "first picture, in the middle", late, 1, "");
  }
}

std::vector<unsigned char> synthetic(double static_share) {
  io::SynthOptions options;
  options.seconds = 600;
  options.gaussians = 1000000;
  options.static_gaussians = static_cast<uint64_t>(static_share * 1e6);
  const WeightedScene scene{io::synthesize(options), {}};
  EncoderHandle encoder = make_encoder(scene, {}, "default");
  return encoder.encode();
}

}  // namespace

int main(int argc, char** argv) {
  std::printf("Round trips of %.0f ms, %.0f Mbit/s; reads of one batch share a round trip.\n\n",
              kRoundTrip * 1e3, kBytesPerSecond * 8 / 1e6);
  std::puts("| stream | reader | what | reads | round trips | kB | seconds of waiting | |");
  std::puts("|---|---|---|---|---|---|---|---|");
  for (int i = 1; i < argc; ++i) {
    std::ifstream in(argv[i], std::ios::binary);
    const std::vector<unsigned char> file((std::istreambuf_iterator<char>(in)),
                                          std::istreambuf_iterator<char>());
    if (file.empty()) {
      std::fprintf(stderr, "cannot read %s\n", argv[i]);
      return 1;
    }
    const std::string path = argv[i];
    measure(path.substr(path.find_last_of('/') + 1), file);
  }
  if (argc > 1) return 0;
  measure("10 min, 75 % static", synthetic(0.75));
  measure("10 min, 20 % static", synthetic(0.2));
  return 0;
}
