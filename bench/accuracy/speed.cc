// SPDX-License-Identifier: Apache-2.0
// Speed that costs no accuracy (decoder), and some that costs a little (renderer).
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "bench/accuracy/sections.h"
#include "bench/accuracy/timing.h"
#include "l4d/experimental/packed.h"

namespace l4d::bench {
namespace {

struct Setup {
  const char* backend_name;
  uint32_t backend, threads;
};

l4d_query whole_query() {
  l4d_query query = L4D_INIT(l4d_query);
  return query;
}

template <typename T>
void append(std::vector<unsigned char>& bytes, const std::vector<T>& v) {
  const auto* p = reinterpret_cast<const unsigned char*>(v.data());
  bytes.insert(bytes.end(), p, p + v.size() * sizeof(T));
}

// Seconds of one call, and all it wrote.
struct Result {
  double seconds = 0;
  std::vector<unsigned char> bytes;
};

Result expanded(DecoderHandle& d, int runs) {
  const l4d_query query = whole_query();
  GaussianArrays a = d.decode(query);
  a.spans.clear();
  l4d_gaussian_buffers b = a.buffers();
  Result r;
  r.seconds = time_median(runs, [&] { d.check(l4d_decoder_decode(d.get(), &query, &b)); });
  for_each_attribute([&](const AttributeInfo&, const std::vector<float>& v) { append(r.bytes, v); },
                     a);
  return r;
}

Result packed(DecoderHandle& d, int runs) {
  const l4d_query query = whole_query();
  const size_t n = static_cast<size_t>(d.select(query).num_gaussians);
  std::vector<uint16_t> position(3 * n), mean(n), opacity(n), factor(n), index[L4D_COMPONENT_COUNT];
  l4d_packed_buffers b = L4D_INIT(l4d_packed_buffers);
  b.capacity = n;
  b.position = position.data();
  b.mean_t = mean.data();
  b.opacity = opacity.data();
  b.scale_factor = factor.data();
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    index[c].resize(n * L4D_MAX_STAGES);
    b.component[c].index = index[c].data();
  }
  Result r;
  r.seconds = time_median(runs, [&] { d.check(l4d_decoder_decode_packed(d.get(), &query, &b)); });
  for (const auto* v :
       {&position, &mean, &opacity, &factor, &index[0], &index[1], &index[2], &index[3]}) {
    append(r.bytes, *v);
  }
  return r;
}

// An instant whose buckets are in the cache: what a step in time costs once they are decoded.
Result sliced(DecoderHandle& d, double time, int runs) {
  SplatArrays a = d.slice(time);
  l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
  b.capacity = a.count();
  b.position = a.position.data();
  b.covariance = a.covariance.data();
  b.opacity = a.opacity.data();
  b.sh = a.sh.data();
  Result r;
  r.seconds = time_median(runs, [&] { d.check(l4d_decoder_slice(d.get(), time, &b)); });
  for (const auto* v : {&a.position, &a.covariance, &a.opacity, &a.sh}) append(r.bytes, *v);
  return r;
}

struct Path {
  const char* name;
  uint32_t path, exponential;
};

// Times and errors of one path against images of the first.
struct PathResult {
  double seconds = 0;
  std::vector<io::Image> images;
  uint64_t visible = 0;
};

PathResult render(const BenchScene& scene, const std::vector<uint32_t>& frames,
                  const std::vector<size_t>& cameras, const Path& path) {
  l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
  options.backend = path.path;
  options.exponential = path.exponential;
  RendererHandle renderer(&options);
  renderer.set_gaussians(scene.scene.view(), scene.scene.timeline);
  PathResult result;
  // The reference is slow enough to need no repetition.
  const int runs = path.path == L4D_BACKEND_REFERENCE ? 0 : 5;
  for (const uint32_t f : frames) {
    renderer.set_time(scene.time_of(f));
    for (const size_t c : cameras) {
      const l4d_camera& camera = scene.cameras[c];
      io::Image image(camera.width, camera.height);
      const double started = seconds_now();
      renderer.render(camera, image.rgb.data());
      const double once = seconds_now() - started;
      result.seconds +=
          runs == 0 ? once : time_median(runs, [&] { renderer.render(camera, image.rgb.data()); });
      result.images.push_back(std::move(image));
    }
    result.visible = std::max(result.visible, renderer.stats().visible);
  }
  result.seconds /= static_cast<double>(result.images.size());
  return result;
}

void add_paths(Bench& bench, Json& table, const BenchScene& scene,
               const std::vector<uint32_t>& frames, const std::vector<size_t>& cameras) {
  const Path paths[] = {{"double", L4D_BACKEND_REFERENCE, L4D_RENDER_EXP_ACCURATE},
                        {"float", L4D_BACKEND_CPU, L4D_RENDER_EXP_ACCURATE},
                        {"float, fast exponential", L4D_BACKEND_CPU, L4D_RENDER_EXP_FAST}};
  std::vector<io::Image> reference;
  for (const Path& path : paths) {
    PathResult r = render(scene, frames, cameras, path);
    if (reference.empty()) reference = r.images;
    double largest = 0, squares = 0, count = 0;
    for (size_t i = 0; i < reference.size(); ++i) {
      for (size_t k = 0; k < reference[i].rgb.size(); ++k) {
        const double e =
            static_cast<double>(r.images[i].rgb[k]) - static_cast<double>(reference[i].rgb[k]);
        largest = std::max(largest, std::fabs(e));
        squares += e * e;
      }
      count += static_cast<double>(reference[i].rgb.size());
    }
    const l4d_camera& camera = scene.cameras[0];
    bench.add(table, {{"name", path.name},
                      {"scene", scene.name},
                      {"width", camera.width},
                      {"height", camera.height},
                      {"visible", r.visible},
                      {"views", reference.size()},
                      {"ms_per_view", r.seconds * 1e3},
                      {"max_error", largest},
                      {"rms_error", std::sqrt(squares / count)},
                      {"psnr_db", std::min(io::psnr_of_mse(squares / count), 200.0)}});
  }
}

}  // namespace

Json run_decoder(Bench& bench) {
  const BenchScene& scene = bench.real();
  const std::vector<unsigned char> file =
      encode(scene.scene, bench.weights(scene),
             preset("indexed").with(L4D_ENC_PROFILE, L4D_PROFILE_INDEXED))
          .file;
  const double middle = scene.time_of(scene.scene.timeline.num_frames / 2);
  const Setup setups[] = {{"reference", L4D_BACKEND_REFERENCE, 1},
                          {"SIMD", L4D_BACKEND_CPU, 1},
                          {"reference", L4D_BACKEND_REFERENCE, 2},
                          {"SIMD", L4D_BACKEND_CPU, 2}};
  Json rows = Json::array();
  for (const char* output : {"expanded", "packed", "slice"}) {
    std::vector<unsigned char> wanted;
    for (const Setup& setup : setups) {
      DecoderHandle d = open(file, setup.backend, setup.threads);
      const int runs = setup.backend == L4D_BACKEND_REFERENCE ? 3 : 15;
      const Result r = output[0] == 'e'   ? expanded(d, runs)
                       : output[0] == 'p' ? packed(d, runs)
                                          : sliced(d, middle, runs);
      if (wanted.empty()) wanted = r.bytes;
      const bool equal = r.bytes.size() == wanted.size() &&
                         std::memcmp(r.bytes.data(), wanted.data(), wanted.size()) == 0;
      if (!equal) throw std::runtime_error(std::string(output) + ": backends or threads differ");
      bench.add(rows, {{"name", output},
                       {"backend", setup.backend_name},
                       {"threads", setup.threads},
                       {"seconds", r.seconds},
                       {"compared_bytes", wanted.size()},
                       {"error", 0}});
    }
  }
  return {{"paths", rows}};
}

Json run_renderer(Bench& bench) {
  Json tables = {{"paths", Json::array()}};
  const BenchScene& scene = bench.real();
  std::vector<size_t> cameras;
  for (size_t c = 0; c < scene.cameras.size(); c += 8) cameras.push_back(c);
  add_paths(bench, tables["paths"], scene, scene.frames(2), cameras);
  io::SynthOptions o;
  o.gaussians = bench.synth_size(380000);
  o.seconds = 2;
  const bool quick = bench.quick();
  const BenchScene large = make_synth(o, 4, quick ? 338 : 1352, quick ? 254 : 1014);
  add_paths(bench, tables["paths"], large, large.frames(1), {0, 1, 2, 3});
  return tables;
}

}  // namespace l4d::bench
