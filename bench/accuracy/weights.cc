// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/weights.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <numeric>

#include "bench/accuracy/timing.h"
#include "eval/views/views.h"
#include "io/ply/weights.h"

namespace l4d::bench {
namespace {

// FNV-1a over 64-bit words: tells scenes apart, defends against nobody.
struct Hash {
  uint64_t value = 14695981039346656037ull;
  void add(const void* data, size_t bytes) {
    const auto* p = static_cast<const unsigned char*>(data);
    for (size_t i = 0; i < bytes; i += 8) {
      uint64_t word = 0;
      std::memcpy(&word, p + i, std::min<size_t>(8, bytes - i));
      value = (value ^ word) * 1099511628211ull;
      value ^= value >> 29;
    }
  }
  void add(const std::vector<float>& v) { add(v.data(), v.size() * sizeof(float)); }
  void add(double v) { add(&v, sizeof v); }
};

uint64_t identity(const BenchScene& s, const l4d_measure_options& options) {
  Hash h;
  for_each_attribute([&](const AttributeInfo&, const std::vector<float>& v) { h.add(v); }, s.scene);
  for (const uint32_t i : s.training) {
    const l4d_camera& c = s.cameras[i];
    for (const double v : {double(c.width), double(c.height), c.fx, c.fy, c.cx, c.cy}) h.add(v);
    h.add(c.world_to_camera, sizeof c.world_to_camera);
  }
  h.add(options.agreement);
  h.add(options.max_share);
  h.add(double(options.metric + 2 * options.skip_visibility));
  h.add(double(s.scene.timeline.num_frames));
  return h.value;
}

std::vector<std::vector<float>*> columns(io::Weights& w) {
  return {&w.alpha_t,        &w.sh,       &w.scale,   &w.rotor_spatial,
          &w.rotor_temporal, &w.position, &w.opacity, &w.mean_t};
}

bool load(const std::string& path, uint64_t id, size_t count, bool gauss_newton, Measured* m) {
  std::ifstream in(path, std::ios::binary);
  uint64_t head[2] = {0, 0};
  const auto get = [&](void* to, size_t n) { in.read(static_cast<char*>(to), std::streamsize(n)); };
  get(head, sizeof head);
  if (!in || head[0] != id || head[1] != count) return false;
  get(&m->seconds, sizeof m->seconds);
  get(&m->report, sizeof m->report);
  for (std::vector<float>* column : columns(m->weights)) {
    column->resize(count);
    get(column->data(), count * sizeof(float));
  }
  m->weights.count = count;
  m->weights.gauss_newton = gauss_newton;
  return static_cast<bool>(in);
}

void store(const std::string& path, uint64_t id, Measured& m) {
  std::filesystem::create_directories(std::filesystem::path(path).parent_path());
  {
    std::ofstream out(path + ".new", std::ios::binary);
    const auto put = [&](const void* from, size_t n) {
      out.write(static_cast<const char*>(from), std::streamsize(n));
    };
    const uint64_t head[2] = {id, m.weights.count};
    put(head, sizeof head);
    put(&m.seconds, sizeof m.seconds);
    put(&m.report, sizeof m.report);
    for (const std::vector<float>* column : columns(m.weights)) {
      put(column->data(), column->size() * sizeof(float));
    }
    if (!out) throw io::Error(L4D_ERR_IO, path + ": writing failed");
  }
  std::filesystem::rename(path + ".new", path);
}

std::vector<double> ranks(const std::vector<float>& values) {
  std::vector<uint32_t> order(values.size());
  std::iota(order.begin(), order.end(), 0u);
  std::sort(order.begin(), order.end(),
            [&](uint32_t a, uint32_t b) { return values[a] < values[b]; });
  std::vector<double> rank(values.size());
  for (size_t i = 0, end = 0; i < order.size(); i = end) {
    while (end < order.size() && values[order[end]] == values[order[i]]) ++end;
    for (size_t k = i; k < end; ++k) rank[order[k]] = 0.5 * static_cast<double>(i + end - 1);
  }
  return rank;
}

}  // namespace

l4d_measure_options measure_options(uint32_t metric, double agreement, double max_share) {
  l4d_measure_options options = L4D_INIT(l4d_measure_options);
  options.metric = metric;
  options.agreement = agreement;
  options.max_share = max_share;
  return options;
}

Measured measure(const BenchScene& s, const l4d_measure_options& options,
                 const l4d_renderer_options* renderer) {
  const l4d_renderer_options defaults = L4D_INIT(l4d_renderer_options);
  return eval::measure_importance(renderer != nullptr ? *renderer : defaults, s.scene,
                                  s.training_views(), options);
}

Measured measure_made_up(const io::Scene& scene, uint32_t backend) {
  l4d_renderer_options rendering = L4D_INIT(l4d_renderer_options);
  rendering.backend = backend;
  const eval::CameraViews views = eval::made_up_views(scene);
  return eval::measure_importance(rendering, scene, views,
                                  eval::measure_options(views.views.size(), views.views.size(), 0));
}

Measured measure_cached(const BenchScene& s, const l4d_measure_options& options,
                        const std::string& path) {
  const uint64_t id = identity(s, options);
  Measured m;
  const bool gauss_newton = options.metric == L4D_SENSITIVITY_GAUSS_NEWTON;
  if (load(path, id, s.scene.count(), gauss_newton, &m)) return m;
  m = measure(s, options);
  store(path, id, m);
  return m;
}

double rank_correlation(const std::vector<float>& a, const std::vector<float>& b) {
  std::vector<float> x, y;
  for (size_t i = 0; i < a.size(); ++i) {
    if (a[i] > 0 || b[i] > 0) {
      x.push_back(a[i]);
      y.push_back(b[i]);
    }
  }
  const std::vector<double> rx = ranks(x), ry = ranks(y);
  const double mean = 0.5 * (static_cast<double>(x.size()) - 1);
  double xy = 0, xx = 0, yy = 0;
  for (size_t i = 0; i < rx.size(); ++i) {
    xy += (rx[i] - mean) * (ry[i] - mean);
    xx += (rx[i] - mean) * (rx[i] - mean);
    yy += (ry[i] - mean) * (ry[i] - mean);
  }
  return xx > 0 && yy > 0 ? xy / std::sqrt(xx * yy) : 1;
}

}  // namespace l4d::bench
