// SPDX-License-Identifier: Apache-2.0
#include "tests/common/codec.h"

#include <unistd.h>

#include <algorithm>
#include <cstring>

namespace l4d::test {

EncodeOptions small_options() {
  EncodeOptions o;
  o.preset = "indexed-small";
  o.settings = {{L4D_ENC_CODEBOOK_SIZE, 64},
                {L4D_ENC_KMEANS_ITERATIONS, 4},
                {L4D_ENC_MERGE_COUNT, 40},
                {L4D_ENC_PAGE_SIZE, 128},
                {L4D_ENC_ZSTD_LEVEL, 3},
                // Nothing that follows a quality: tests say what there is.
                {L4D_ENC_CODEBOOKS_BY_COST, 0},
                {L4D_ENC_REFINE, 0},
                {L4D_ENC_FIXED_POSITIONS, 0},
                {L4D_ENC_MEAN_T_SHIFT, 0},
                {L4D_ENC_OPACITY_BITS, 8},
                {L4D_ENC_PRUNE_COST, 0},
                {L4D_ENC_MAX_POSITION_ERROR, 0},
                {L4D_ENC_MAX_COVARIANCE_FACTOR, 0},
                {L4D_ENC_MAX_OPACITY_ERROR, 0},
                {L4D_ENC_MAX_BASE_COLOR_ERROR, 0},
                {L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR, 0}};
  o.stages = {{L4D_ENC_STAGES, {1}}};
  return o;
}

l4d_importance importance_of(const TestScene& scene, const EncodeOptions& options) {
  l4d_importance importance = L4D_INIT(l4d_importance);
  importance.count = scene.count();
  importance.metric = options.metric;
  importance.views = options.views;
  for (const auto& [which, weights] : options.weights) {
    importance.weights[which] = weights->data();
  }
  if (options.min_sizes != nullptr) importance.min_sizes = options.min_sizes->data();
  return importance;
}

l4d_encoder_options one_thread() {
  l4d_encoder_options options = L4D_INIT(l4d_encoder_options);
  options.threads = 1;
  return options;
}

void prepare_encoder(const TestScene& scene, const EncodeOptions& options, const EncoderHandle& e) {
  e.check(l4d_encoder_set_preset(e.get(), options.preset));
  e.set(L4D_ENC_RANS, options.rans ? 1 : 0);
  for (const Setting& s : options.settings) e.set(s.name, s.value);
  for (const auto& [name, fractions] : options.stages) e.set_list(name, fractions);
  e.set_list(L4D_ENC_TIERS, options.tiers);
  const l4d_gaussians view = scene.view();
  e.check(l4d_encoder_set_scene(e.get(), &view, &scene.timeline, nullptr));
  const l4d_importance importance = importance_of(scene, options);
  e.check(l4d_encoder_set_importance(e.get(), &importance));
}

Encoded encode(const TestScene& scene, const EncodeOptions& options) {
  l4d_encoder_options o = L4D_INIT(l4d_encoder_options);
  o.threads = options.threads;
  o.seed = options.seed;
  EncoderHandle e(&o);
  prepare_encoder(scene, options, e);
  Encoded out;
  out.bytes = e.encode();
  out.report = L4D_INIT(l4d_encode_report);
  e.check(l4d_encoder_get_report(e.get(), &out.report));
  out.order.resize(out.report.coded_gaussians);
  e.check(l4d_encoder_get_order(e.get(), out.order.data(), out.order.size()));
  return out;
}

const Bytes& dynamic_file() {
  static const Bytes kBytes = encode(make_scene({}), small_options()).bytes;
  return kBytes;
}

const Bytes& transform_file() {
  static const Bytes kBytes = [] {
    EncodeOptions o;
    o.preset = "default";
    o.rans = true;
    // No layer of escapes: tests have pages of one kind.
    o.settings = {{L4D_ENC_MERGE_COUNT, 40},
                  {L4D_ENC_PAGE_SIZE, 128},
                  {L4D_ENC_MAX_POSITION_ERROR, 0},
                  {L4D_ENC_MAX_COVARIANCE_FACTOR, 0},
                  {L4D_ENC_MAX_OPACITY_ERROR, 0}};
    return encode(make_scene({}), o).bytes;
  }();
  return kBytes;
}

const Bytes& staged_file() {
  static const Bytes kBytes = [] {
    EncodeOptions o = small_options();
    o.stages = {{L4D_ENC_STAGES, {1.0f, 0.5f, 0.25f}}};
    const TestScene scene = make_scene({});
    std::vector<float> weights(scene.count());
    for (size_t i = 0; i < weights.size(); ++i) weights[i] = static_cast<float>(i % 40);
    o.settings.push_back({L4D_ENC_ESCAPE_THRESHOLD, 37.5});
    for (uint32_t w = L4D_WEIGHT_SH; w <= L4D_WEIGHT_ROTOR_TEMPORAL; ++w) {
      o.weights.emplace_back(w, &weights);
    }
    return encode(scene, o).bytes;
  }();
  return kBytes;
}

const Bytes& rcq_file() {
  static const Bytes kBytes = [] {
    SceneOptions s;
    s.count = 24000;
    s.sh_degree = 0;
    s.permanent = 0.05;
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_RCQ, 2});
    o.settings.push_back({L4D_ENC_RCQ_SIZE, 32});
    o.settings.push_back({L4D_ENC_PAGE_SIZE, 4096});
    return encode(make_scene(s), o).bytes;
  }();
  return kBytes;
}

const Bytes& wandering_file() {
  static const Bytes kBytes = [] {
    SceneOptions o;
    o.count = 1500;
    o.permanent = 0;
    o.outside = 0;
    o.moving = false;
    TestScene s = make_scene(o);
    for (size_t i = 0; i < s.count(); ++i) {
      s.position[3 * i] = 1 + 100 * s.mean_t[i];
      s.position[3 * i + 1] = s.position[3 * i + 2] = 0;
      s.log_scale[4 * i + 3] = -4;
    }
    EncodeOptions e = small_options();
    e.settings.push_back({L4D_ENC_MERGE_COUNT, 1e9});
    e.settings.push_back({L4D_ENC_PAGE_SIZE, 64});
    return encode(s, e).bytes;
  }();
  return kBytes;
}

const Bytes& lossless_file() {
  static const Bytes kBytes = [] {
    EncodeOptions o;
    o.preset = "lossless";
    o.settings = {{L4D_ENC_MERGE_COUNT, 40}, {L4D_ENC_PAGE_SIZE, 128}, {L4D_ENC_ZSTD_LEVEL, 3}};
    TestScene scene = make_scene({});
    scene.flags = L4D_POSITION_AT_MEAN_TIME;
    return encode(scene, o).bytes;
  }();
  return kBytes;
}

const Bytes& tiny_file() {
  static const Bytes kBytes = [] {
    SceneOptions s;
    s.count = 12;
    s.sh_degree = 0;
    s.num_frames = 4;
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 2});
    o.settings.push_back({L4D_ENC_MERGE_COUNT, 3});
    return encode(make_scene(s), o).bytes;
  }();
  return kBytes;
}

l4d_decoder_options decoder_options(uint32_t backend, uint32_t threads) {
  l4d_decoder_options o = L4D_INIT(l4d_decoder_options);
  o.backend = backend;
  o.threads = threads;
  return o;
}

l4d_query all_query() {
  l4d_query q = L4D_INIT(l4d_query);
  return q;
}

l4d_query time_query(double time) {
  l4d_query q = L4D_INIT(l4d_query);
  q.kind = L4D_QUERY_TIME;
  q.time_begin = time;
  return q;
}

l4d_query range_query(double begin, double end) {
  l4d_query q = L4D_INIT(l4d_query);
  q.kind = L4D_QUERY_RANGE;
  q.time_begin = begin;
  q.time_end = end;
  return q;
}

GaussianArrays decode(const Bytes& bytes, const l4d_query& query, uint32_t backend,
                      uint32_t threads) {
  const l4d_decoder_options o = decoder_options(backend, threads);
  DecoderHandle d(&o);
  d.open_memory(bytes.data(), bytes.size());
  return d.decode(query);
}

testing::AssertionResult same_bits(const char* what, const std::vector<float>& a,
                                   const std::vector<float>& b) {
  if (a.size() != b.size()) {
    return testing::AssertionFailure()
           << what << ": " << a.size() << " and " << b.size() << " numbers";
  }
  for (size_t i = 0; i < a.size(); ++i) {
    if (std::memcmp(&a[i], &b[i], sizeof(float)) != 0) {
      return testing::AssertionFailure()
             << what << "[" << i << "] of " << a.size() << ": " << a[i] << " and " << b[i];
    }
  }
  return testing::AssertionSuccess();
}

testing::AssertionResult same_bits(const GaussianArrays& a, const GaussianArrays& b) {
  const std::pair<const char*, std::vector<float> GaussianArrays::*> kArrays[] = {
      {"position", &GaussianArrays::position},
      {"mean_t", &GaussianArrays::mean_t},
      {"mean_t_local", &GaussianArrays::mean_t_local},
      {"log_scale", &GaussianArrays::log_scale},
      {"rotor", &GaussianArrays::rotor},
      {"opacity", &GaussianArrays::opacity},
      {"sh", &GaussianArrays::sh}};
  for (const auto& [name, array] : kArrays) {
    const testing::AssertionResult result = same_bits(name, a.*array, b.*array);
    if (!result) return result;
  }
  if (a.spans.size() != b.spans.size()) return testing::AssertionFailure() << "ranges differ";
  for (size_t i = 0; i < a.spans.size(); ++i) {
    const l4d_bucket_span& x = a.spans[i];
    const l4d_bucket_span& y = b.spans[i];
    if (x.first != y.first || x.count != y.count || x.layer != y.layer || x.bucket != y.bucket ||
        x.block != y.block || x.level != y.level || x.center != y.center || x.width != y.width) {
      return testing::AssertionFailure() << "range " << i << " differs";
    }
  }
  return testing::AssertionSuccess();
}

testing::AssertionResult same_bits(const SplatArrays& a, const SplatArrays& b) {
  const std::pair<const char*, std::vector<float> SplatArrays::*> kArrays[] = {
      {"position", &SplatArrays::position},
      {"covariance", &SplatArrays::covariance},
      {"opacity", &SplatArrays::opacity},
      {"sh", &SplatArrays::sh}};
  for (const auto& [name, array] : kArrays) {
    const testing::AssertionResult result = same_bits(name, a.*array, b.*array);
    if (!result) return result;
  }
  return testing::AssertionSuccess();
}

l4d_reader memory_reader(const Bytes& bytes) {
  l4d_reader r = L4D_INIT(l4d_reader);
  r.user = const_cast<Bytes*>(&bytes);
  r.read_at = [](void* user, void* dst, size_t n, uint64_t offset) -> int64_t {
    const Bytes& from = *static_cast<const Bytes*>(user);
    if (offset >= from.size()) return 0;
    n = std::min(n, from.size() - static_cast<size_t>(offset));
    std::memcpy(dst, from.data() + offset, n);
    return static_cast<int64_t>(n);
  };
  r.size = [](void* user) -> int64_t {
    return static_cast<int64_t>(static_cast<const Bytes*>(user)->size());
  };
  return r;
}

std::vector<Violation> validate(const Bytes& bytes) {
  std::vector<Violation> found;
  const uint64_t count = l4d::validate(memory_reader(bytes), nullptr, [&](const l4d_violation& v) {
    found.push_back({v.status, v.clause, v.offset, v.message});
  });
  EXPECT_EQ(count, found.size());
  return found;
}

std::string temporary_path(const std::string& suffix) {
  static int counter = 0;
  return testing::TempDir() + "l4d-test-" + std::to_string(::getpid()) + "-" +
         std::to_string(counter++) + suffix;
}

}  // namespace l4d::test
