// SPDX-License-Identifier: Apache-2.0
#include "bench/tables/common.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "io/ply/scene_ply.h"

namespace l4d::bench {

double seconds_now() {
  using Clock = std::chrono::steady_clock;
  return std::chrono::duration<double>(Clock::now().time_since_epoch()).count();
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

uint64_t peak_rss_bytes() {
  std::ifstream status("/proc/self/status");
  std::string word;
  while (status >> word) {
    if (word == "VmHWM:") {
      uint64_t kib = 0;
      status >> kib;
      return kib * 1024;
    }
  }
  return 0;
}

void reset_peak_rss() { std::ofstream("/proc/self/clear_refs") << "5"; }

double time_median(int runs, const std::function<void()>& call) {
  call();
  std::vector<double> seconds;
  for (int i = 0; i < runs; ++i) {
    const double started = seconds_now();
    call();
    seconds.push_back(seconds_now() - started);
  }
  return median(seconds);
}

std::string data_dir() {
  const char* set = std::getenv("L4D_DATA_DIR");
  const std::string dir = set != nullptr ? set : "../shared/data";
  return std::filesystem::exists(dir + "/basketball/basketball.ply") ? dir : std::string();
}

WeightedScene load_basketball() {
  const std::string dir = data_dir() + "/basketball/";
  return {io::read_scene_ply(dir + "basketball.ply"),
          io::read_weights_ply(dir + "basketball-weights.ply")};
}

std::vector<float> sh_weights(const WeightedScene& scene) {
  // The gradient-based SH weight of such files ignores occluders of clamped colour; blending weight
  // times the largest basis value of degree 3, averaged over directions, does not.
  std::vector<float> w = scene.weights.alpha_t;
  for (float& x : w) x *= 0.6f;
  return w;
}

EncoderHandle make_encoder(const WeightedScene& s, const std::vector<float>& sh, const char* preset,
                           uint32_t threads) {
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  options.threads = threads;
  EncoderHandle encoder(&options);
  encoder.check(l4d_encoder_set_preset(encoder.get(), preset));
  const l4d_gaussians view = s.scene.view();
  encoder.check(l4d_encoder_set_scene(encoder.get(), &view, &s.scene.timeline, &s.scene.placement));
  l4d_importance importance = s.weights.view();
  importance.count = s.scene.count();  // of none, too
  importance.weights[L4D_WEIGHT_SH] = sh.empty() ? nullptr : sh.data();
  encoder.check(l4d_encoder_set_importance(encoder.get(), &importance));
  return encoder;
}

l4d_encode_report report_of(const EncoderHandle& encoder) {
  l4d_encode_report report = L4D_INIT(l4d_encode_report);
  encoder.check(l4d_encoder_get_report(encoder.get(), &report));
  return report;
}

l4d_query whole_query() {
  l4d_query query = L4D_INIT(l4d_query);
  return query;
}

l4d_query time_query(double time) {
  l4d_query query = whole_query();
  query.kind = L4D_QUERY_TIME;
  query.time_begin = time;
  return query;
}

}  // namespace l4d::bench
