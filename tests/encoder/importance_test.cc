// SPDX-License-Identifier: Apache-2.0
// Importance that a caller states: what is refused, and what it makes of a stream.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <string>

#include "l4d/experimental/inspect.h"
#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

void expect_valid(const Bytes& bytes) {
  for (const Violation& v : validate(bytes)) ADD_FAILURE() << v.clause << ": " << v.message;
}

TestScene scene_of(uint64_t count, uint64_t seed = 1) {
  SceneOptions o;
  o.count = count;
  o.seed = seed;
  return make_scene(o);
}

TEST(Weights, AreChecked) {
  const EncoderHandle e;
  const TestScene scene = scene_of(10);
  std::vector<float> w(10, 1.0f);
  l4d_importance importance = L4D_INIT(l4d_importance);
  importance.count = 10;
  importance.weights[L4D_WEIGHT_SH] = w.data();
  const auto set = [&] { return l4d_encoder_set_importance(e.get(), &importance); };
  EXPECT_EQ(set(), L4D_ERR_INVALID_STATE);
  EXPECT_EQ(l4d_encoder_set_importance(e.get(), nullptr), L4D_ERR_INVALID_STATE);
  const l4d_gaussians g = scene.view();
  e.check(l4d_encoder_set_scene(e.get(), &g, &scene.timeline, nullptr));
  for (const uint64_t count : {0u, 9u, 11u}) {
    importance.count = count;
    EXPECT_EQ(set(), L4D_ERR_INVALID_ARGUMENT) << count;
  }
  importance.count = 10;
  for (uint32_t* field : {&importance.metric, &importance.views}) {
    *field = 3;
    EXPECT_EQ(set(), L4D_ERR_INVALID_ARGUMENT);
    *field = 1;
  }
  importance.min_sizes = w.data();
  for (const float bad : {-1.0f, kNan, kInf}) {
    w[7] = bad;
    for (const bool has_weights : {true, false}) {
      importance.weights[L4D_WEIGHT_SH] = has_weights ? w.data() : nullptr;
      EXPECT_EQ(set(), L4D_ERR_INVALID_SCENE);
      const std::string message = l4d_last_error_message();
      EXPECT_NE(message.find("Gaussian 7"), std::string::npos);
      EXPECT_NE(message.find(has_weights ? "weight" : "minimum size"), std::string::npos);
    }
  }
  w[7] = 0;
  EXPECT_EQ(set(), L4D_OK);
  importance.struct_size = offsetof(l4d_importance, min_sizes);
  EXPECT_EQ(set(), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_set_importance(e.get(), nullptr), L4D_OK);
}

// What is set counts until the next importance or scene, and a call that fails changes nothing.
TEST(Weights, ArePartOfTheScene) {
  const TestScene scene = scene_of(40);
  const l4d_gaussians g = scene.view();
  std::vector<float> alpha(40, 1.0f);
  alpha[5] = 0;
  l4d_importance importance = L4D_INIT(l4d_importance);
  importance.count = 40;
  importance.views = L4D_WEIGHT_VIEWS_ALL;
  importance.weights[L4D_WEIGHT_ALPHA_T] = alpha.data();
  const EncoderHandle e;
  const auto pruned = [&] {
    e.encode();
    l4d_encode_report report = L4D_INIT(l4d_encode_report);
    e.check(l4d_encoder_get_report(e.get(), &report));
    return report.pruned;
  };
  const auto set_scene = [&] {
    e.check(l4d_encoder_set_scene(e.get(), &g, &scene.timeline, nullptr));
  };
  set_scene();
  e.check(l4d_encoder_set_importance(e.get(), &importance));
  EXPECT_EQ(pruned(), 1u);
  l4d_importance wrong = importance;
  wrong.views = L4D_WEIGHT_VIEWS_SOME;
  wrong.count = 39;
  EXPECT_EQ(l4d_encoder_set_importance(e.get(), &wrong), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(pruned(), 1u);
  e.check(l4d_encoder_set_importance(e.get(), nullptr));
  EXPECT_EQ(pruned(), 0u);
  e.check(l4d_encoder_set_importance(e.get(), &importance));
  set_scene();
  EXPECT_EQ(pruned(), 0u);
}

// What is coded was fitted; what is stated is about the scene.
TEST(FittedOpacity, LeavesErrorsStatedAgainstTheScene) {
  TestScene scene = scene_of(40);
  scene.flags &= ~static_cast<uint32_t>(L4D_OPACITY_LOGIT);
  for (float& opacity : scene.opacity) opacity = 0.8f;
  const l4d_gaussians g = scene.view();
  const std::vector<float> fitted(40, 0.3f);
  const EncoderHandle e;
  EXPECT_EQ(l4d_encoder_set_fitted_opacity(e.get(), fitted.data()), L4D_ERR_INVALID_STATE);
  e.check(l4d_encoder_set_scene(e.get(), &g, &scene.timeline, nullptr));
  const auto stated = [&] {
    const std::vector<unsigned char> stream = e.encode();
    l4d_encode_report report = L4D_INIT(l4d_encode_report);
    e.check(l4d_encoder_get_report(e.get(), &report));
    DecoderHandle decoder;
    decoder.open_memory(stream.data(), stream.size());
    l4d_coding_errors errors = L4D_INIT(l4d_coding_errors);
    decoder.check(l4d_decoder_get_coding_errors(decoder.get(), &errors));
    EXPECT_NEAR(errors.opacity, report.max_opacity_error, 1e-6);
    // A bound that the scene does not keep is not stated.
    EXPECT_EQ(errors.opacity_bound > 0, errors.opacity < 0.1f);
    return report.max_opacity_error;
  };
  EXPECT_LT(stated(), 0.1);
  e.check(l4d_encoder_set_fitted_opacity(e.get(), fitted.data()));
  EXPECT_NEAR(stated(), 0.5, 0.05);
  e.check(l4d_encoder_set(e.get(), L4D_ENC_LOSSLESS, 1));
  EXPECT_THROW(e.encode(), Error);
  e.check(l4d_encoder_set(e.get(), L4D_ENC_LOSSLESS, 0));
  e.check(l4d_encoder_set_fitted_opacity(e.get(), nullptr));
  EXPECT_LT(stated(), 0.1);
  e.check(l4d_encoder_set_fitted_opacity(e.get(), fitted.data()));
  e.check(l4d_encoder_set_scene(e.get(), &g, &scene.timeline, nullptr));
  EXPECT_LT(stated(), 0.1);
}

TEST(Weights, PruneByAlpha) {
  const TestScene scene = scene_of(400);
  std::vector<float> alpha(400);
  for (size_t i = 0; i < alpha.size(); ++i) alpha[i] = static_cast<float>(i % 4);
  EncodeOptions o = small_options();
  o.settings.push_back({L4D_ENC_PRUNE_WEIGHT, 1});
  try {
    encode(scene, o);
    ADD_FAILURE() << "pruning without weights";
  } catch (const Error& e) {
    EXPECT_EQ(e.status(), L4D_ERR_INVALID_ARGUMENT);
  }
  o.weights = {{L4D_WEIGHT_ALPHA_T, &alpha}};
  const Encoded e = encode(scene, o);
  EXPECT_EQ(e.report.pruned, 200u);
  EXPECT_EQ(e.report.coded_gaussians, 200u);
  for (const uint32_t i : e.order) EXPECT_GE(i % 4, 2u);
}

// What weights were measured from decides what goes, unless the parameters do.
TEST(Weights, ViewsDecideWhatIsPruned) {
  const TestScene scene = scene_of(400);
  std::vector<float> alpha(400), opacity(400);
  for (size_t i = 0; i < alpha.size(); ++i) {
    alpha[i] = static_cast<float>(i % 4);
    opacity[i] = i % 5 == 0 ? 1e-20f : 1e3f;  // a fifth costs more than it shows
  }
  const auto pruned = [&](const char* preset, uint32_t views,
                          std::vector<std::pair<const char*, double>> more = {}) {
    EncodeOptions o;
    o.preset = preset;
    o.metric = L4D_SENSITIVITY_GAUSS_NEWTON;
    o.views = views;
    for (const auto& [id, value] : more) o.settings.push_back({id, value});
    o.weights = {{L4D_WEIGHT_ALPHA_T, &alpha}, {L4D_WEIGHT_OPACITY, &opacity}};
    return encode(scene, o).report.pruned;
  };
  constexpr uint64_t kUnseen = 100, kNotWorthIt = 80, kBoth = kUnseen + kNotWorthIt - 20;
  EXPECT_EQ(pruned("default", L4D_WEIGHT_VIEWS_UNKNOWN), kNotWorthIt);
  EXPECT_EQ(pruned("default", L4D_WEIGHT_VIEWS_ALL), kBoth);
  EXPECT_EQ(pruned("default", L4D_WEIGHT_VIEWS_SOME), 0u);
  EXPECT_EQ(pruned("lossless", L4D_WEIGHT_VIEWS_ALL), 0u);
  // What is set counts more.
  EXPECT_EQ(pruned("default", L4D_WEIGHT_VIEWS_ALL,
                   {{L4D_ENC_PRUNE_WEIGHT, -1}, {L4D_ENC_PRUNE_COST, 0}}),
            0u);
  EXPECT_EQ(pruned("default", L4D_WEIGHT_VIEWS_SOME, {{L4D_ENC_PRUNE_COST, 0.2}}), kNotWorthIt);
  EXPECT_EQ(pruned("default", L4D_WEIGHT_VIEWS_SOME, {{L4D_ENC_PRUNE_WEIGHT, 0}}), kBoth);
  EXPECT_EQ(pruned("lossless", L4D_WEIGHT_VIEWS_SOME, {{L4D_ENC_PRUNE_WEIGHT, 0}}), kUnseen);
}

TEST(Weights, AllZero) {
  const TestScene scene = scene_of(800);
  const std::vector<float> zero(800, 0.0f);
  EncodeOptions o = small_options();
  o.stages = {{L4D_ENC_STAGES, {1, 0.5f}}};
  for (uint32_t w = 0; w < L4D_WEIGHT_COUNT; ++w) o.weights.emplace_back(w, &zero);
  const Encoded e = encode(scene, o);
  EXPECT_EQ(e.report.coded_gaussians, 800u);
  expect_valid(e.bytes);
  for (const float v : decode(e.bytes, all_query()).rotor) EXPECT_TRUE(std::isfinite(v));
}

}  // namespace
}  // namespace l4d
