// SPDX-License-Identifier: Apache-2.0
// What a studio asks of a preset: bytes, quality on average and at worst, and the time and memory
// of all that is done with the file. On CPUs, and where there is a CUDA device, on that.
#include "bench/accuracy/sections.h"
#include "bench/accuracy/timing.h"
#include "bench/accuracy/worst.h"

namespace l4d::bench {
namespace {

// Times of one thread, in seconds.
struct Playback {
  double decode = 0, first_slice = 0, next_slice = 0;
  uint64_t decode_memory = 0, slice_memory = 0;  // of the decoder, arrays of results not counted
};

Playback play(const BenchScene& scene, const std::vector<unsigned char>& file, int runs) {
  Playback p;
  l4d_query query = L4D_INIT(l4d_query);
  {
    DecoderHandle d = open(file, L4D_BACKEND_CPU, 1);
    p.decode = time_median(runs, [&] { d.decode(query); });
    p.decode_memory = d.counters().peak_memory_bytes;
  }
  const double middle = scene.time_of(scene.scene.timeline.num_frames / 2);
  p.first_slice = time_median(runs, [&] {
    DecoderHandle d = open(file, L4D_BACKEND_CPU, 1);
    d.slice(middle);
    p.slice_memory = d.counters().peak_memory_bytes;
  });
  DecoderHandle d = open(file, L4D_BACKEND_CPU, 1);
  p.next_slice = time_median(runs, [&] { d.slice(middle); });
  return p;
}

Json preset_row(Bench& bench, const BenchScene& scene, const std::string& name) {
  const Coding coding = preset(name);
  const Measured& measured = bench.measured(scene, coding.metric);
  const int runs = bench.quick() ? 1 : 3;
  const Encoded with = encode(scene.scene, measured.weights, coding, runs);
  // As the tool encodes a scene that comes without cameras.
  const bool is_paper = coding.metric == L4D_SENSITIVITY_SUM;
  const bool looks_around = !is_paper && name != "lossless";
  const Measured made_up = looks_around ? measure_made_up(scene.scene) : Measured();
  // The paper's pruning is by a weight that is not there then.
  Coding unweighted = is_paper ? coding.with(L4D_ENC_PRUNE_WEIGHT, -1) : coding;
  unweighted.views = looks_around ? L4D_WEIGHT_VIEWS_SOME : L4D_WEIGHT_VIEWS_UNKNOWN;
  const Encoded without = encode(scene.scene, made_up.weights, unweighted, runs);
  const WorstGaussian worst = worst_gaussian(scene.scene, with);
  const Playback p = play(scene, with.file, bench.quick() ? 3 : 9);
  const Judge& judge = bench.judge(scene);
  return {{"name", name},
          {"bytes", with.file.size()},
          {"ratio", with.ratio()},
          {"fidelity_db", std::min(judge.of_file(with.file).psnr, kMaxDecibels)},
          {"worst_position", worst.position},
          {"worst_mean_time", worst.mean_time},
          {"worst_covariance", worst.covariance},
          {"worst_opacity", worst.opacity},
          {"measure_s", measured.seconds},
          {"encode_s", with.report.total_seconds},
          {"bytes_unweighted", without.file.size()},
          {"fidelity_unweighted_db", std::min(judge.of_file(without.file).psnr, kMaxDecibels)},
          {"encode_unweighted_s", made_up.seconds + without.report.total_seconds},
          {"decode_s", p.decode},
          {"first_slice_s", p.first_slice},
          {"next_slice_s", p.next_slice},
          {"decode_memory_bytes", p.decode_memory},
          {"slice_memory_bytes", p.slice_memory}};
}

}  // namespace

Json run_presets(Bench& bench) {
  const BenchScene& scene = bench.real();
  Json rows = Json::array();
  for (const std::string& name : bench.take(EncoderHandle::preset_names()))
    bench.add(rows, preset_row(bench, scene, name));
  return {{"presets", rows}};
}

namespace {

Json device_row(const BenchScene& scene, const char* name, const Measured& measured) {
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  options.backend = L4D_BACKEND_CUDA;
  const Encoded e = encode(scene.scene, measured.weights, preset(name), 3, options);
  l4d_query query = L4D_INIT(l4d_query);
  DecoderHandle d = open(e.file, L4D_BACKEND_CUDA, 0);
  const double decode = time_median(9, [&] { d.decode(query); });
  return {{"name", name},
          {"bytes", e.file.size()},
          {"measure_s", measured.seconds},
          {"encode_s", e.report.total_seconds},
          {"decode_s", decode}};
}

}  // namespace

Json run_device(Bench& bench) {
  l4d_renderer_options renderer = L4D_INIT(l4d_renderer_options);
  renderer.backend = L4D_BACKEND_CUDA;
  const BenchScene& scene = bench.real();
  Json rows = Json::array();
  for (const char* name : {"tiny", "small", "default", "large", "archive", "indexed"}) {
    const Measured measured =
        measure(scene, measure_options(preset(name).metric, kDeviceAgreement), &renderer);
    bench.add(rows, device_row(scene, name, measured));
  }
  return {{"presets", rows}};
}

}  // namespace l4d::bench
