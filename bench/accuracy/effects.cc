// SPDX-License-Identifier: Apache-2.0
// What is off costs nothing: scenes of one size with one effect more each. Where an encoder's time
// goes.
#include <iterator>

#include "bench/accuracy/sections.h"
#include "bench/accuracy/timing.h"
#include "l4d/experimental/inspect.h"

namespace l4d::bench {
namespace {

struct Effects {
  const char* name;
  std::vector<std::string> effects;
};

std::string tool_names(uint32_t tools) {
  static constexpr const char* kNames[] = {"motion",          "temporal opacity", "view dependence",
                                           "residual stages", "escapes",          "RCQ",
                                           "lossless",        "transform",        "rANS"};
  std::string s;
  for (unsigned i = 0; i < std::size(kNames); ++i) {
    if ((tools & (1u << i)) != 0) s += (s.empty() ? "" : ", ") + std::string(kNames[i]);
  }
  return s.empty() ? "none" : s;
}

Json effect_row(const BenchScene& scene, const char* name) {
  const Encoded e = encode(scene.scene, {}, Coding{});
  l4d_decoder_options one_thread = L4D_INIT(l4d_decoder_options);
  one_thread.threads = 1;
  DecoderHandle d(&one_thread);
  d.open_memory(e.file.data(), e.file.size());
  l4d_query query = L4D_INIT(l4d_query);
  GaussianArrays a = d.decode(query);
  a.spans.clear();
  l4d_gaussian_buffers out = a.buffers();
  const double decoding =
      time_median(7, [&] { d.check(l4d_decoder_decode(d.get(), &query, &out)); });
  const double middle = scene.time_of(scene.scene.timeline.num_frames / 2);
  SplatArrays s = d.slice(middle);
  l4d_splat_buffers splats = L4D_INIT(l4d_splat_buffers);
  splats.capacity = s.count();
  splats.position = s.position.data();
  splats.covariance = s.covariance.data();
  splats.opacity = s.opacity.data();
  splats.sh = s.sh.data();
  const double slicing =
      time_median(7, [&] { d.check(l4d_decoder_slice(d.get(), middle, &splats)); });
  RendererHandle renderer;
  renderer.set_decoder(d);
  renderer.set_time(middle);
  const l4d_camera& camera = scene.cameras[0];
  io::Image image(camera.width, camera.height);
  const double rendering = time_median(5, [&] { renderer.render(camera, image.rgb.data()); });
  const double n = static_cast<double>(a.count());
  const auto section = [&](uint32_t kind) { return static_cast<double>(e.sections[kind]) / n; };
  return {{"name", name},
          {"tools", tool_names(d.info().tools)},
          {"sh_degree", d.info().sh_degree},
          {"layers", d.info().num_layers},
          {"visible", s.count()},
          {"bytes_per_gaussian", e.bytes() / n},
          {"sh_bytes", section(L4D_SECTION_SH)},
          {"mean_t_bytes", section(L4D_SECTION_MEAN_T)},
          {"rotor_temporal_bytes", section(L4D_SECTION_ROTOR_TEMPORAL)},
          {"encode_cpu_s", e.cpu_seconds},
          {"decode_ns_per_gaussian", decoding * 1e9 / n},
          {"slice_ms", slicing * 1e3},
          {"render_ms", rendering * 1e3}};
}

}  // namespace

Json run_effects(Bench& bench) {
  const std::vector<Effects> all = {{"static", {"static"}},
                                    {"static + view", {"static", "view"}},
                                    {"static + flicker", {"static", "flicker"}},
                                    {"static + rigid", {"static", "rigid"}},
                                    {"static + deform", {"static", "deform"}},
                                    {"all", {}}};
  Json rows = Json::array();
  for (const Effects& effects : bench.take(all)) {
    io::SynthOptions o;
    o.gaussians = bench.synth_size(300000);
    o.seconds = 10;
    o.effects = effects.effects;
    const bool quick = bench.quick();
    bench.add(rows,
              effect_row(make_synth(o, 1, quick ? 160 : 640, quick ? 90 : 360), effects.name));
  }
  return {{"effects", rows}};
}

Json run_stages(Bench& bench) {
  const BenchScene& scene = bench.real();
  Json rows = Json::array();
  for (const char* name : {"default", "indexed", "paper-small"}) {
    const Coding c = preset(name);
    const Measured& measured = bench.measured(scene, c.metric);
    const Encoded e = encode(scene.scene, measured.weights, c, 3);
    Json row = {{"name", name}, {"sensitivity", measured.seconds}};
    double vq = 0;
    for (const auto& [step, seconds] : e.steps) {
      row[step] = seconds;
      if (step != "prepare" && step != "layering" && step != "check" && step != "write")
        vq += seconds;
    }
    row["vq_rcq_sq"] = vq;
    row["encode_s"] = e.report.total_seconds;
    bench.add(rows, row);
  }
  return {{"stages", rows}};
}

}  // namespace l4d::bench
