// SPDX-License-Identifier: Apache-2.0
// Which views l4d_measure_importance takes, and what it reports.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "l4d/experimental/sensitivity.hpp"
#include "tests/render/scenes.h"

namespace l4d::render {
namespace {

struct Measured {
  l4d_status status = L4D_OK;
  l4d_measure_report report;
  std::vector<std::vector<float>> weights;
  std::string detail;
};

struct Request {
  std::vector<l4d_camera> cameras;
  std::vector<l4d_view> views;
  l4d_measure_options options;
  Request() { options = L4D_INIT(l4d_measure_options); }
  void add(double time, uint32_t camera) { views.push_back({time, camera, 0}); }
};

Measured measure(const io::Scene& scene, const RendererHandle& r, const Request& request) {
  Measured m;
  m.report = L4D_INIT(l4d_measure_report);
  m.weights.resize(L4D_WEIGHT_COUNT);
  std::vector<float*> weights;
  for (std::vector<float>& w : m.weights) {
    w.assign(scene.count(), -1.0f);
    weights.push_back(w.data());
  }
  m.status = l4d_measure_importance(r.get(), request.cameras.data(),
                                    static_cast<uint32_t>(request.cameras.size()),
                                    request.views.data(), request.views.size(), &request.options,
                                    weights.data(), scene.count(), &m.report);
  m.detail = l4d_last_error_message();
  const bool untouched =
      m.weights ==
      std::vector<std::vector<float>>(L4D_WEIGHT_COUNT, std::vector<float>(scene.count(), -1.0f));
  EXPECT_EQ(untouched, m.status != L4D_OK);
  return m;
}

Measured measure(const io::Scene& scene, const Request& request, uint32_t threads = 2) {
  RendererHandle r = make_renderer(L4D_BACKEND_CPU, threads);
  r.set_gaussians(scene.view(), scene.timeline);
  return measure(scene, r, request);
}

// `count` cameras on a ring, all of them at each of the times.
Request ring(uint32_t count, const std::vector<double>& times) {
  Request out;
  for (uint32_t c = 0; c < count; ++c) {
    out.cameras.push_back(ring_camera(64, 44, 6.2831853 * c / count));
  }
  for (const double t : times) {
    for (uint32_t c = 0; c < count; ++c) out.add(t, c);
  }
  return out;
}

TEST(Measure, AllViewsAreAllViews) {
  const io::Scene scene = synth(4000);
  Request request = ring(5, {0.5, 1.5, 3});
  request.options.agreement = 2;
  const Measured m = measure(scene, request);
  ASSERT_EQ(m.status, L4D_OK) << m.detail;
  EXPECT_EQ(m.report.views, 15u);
  EXPECT_EQ(m.report.views_measured, 15u);
  EXPECT_EQ(m.report.views_visibility_only, 0u);
  EXPECT_EQ(m.report.agreed, 0u);
  RendererHandle r = make_renderer(L4D_BACKEND_CPU);
  r.set_gaussians(scene.view(), scene.timeline);
  SensitivityHandle s(nullptr, scene.count(), scene.sh_degree);
  for (const l4d_view& v : request.views) {
    r.set_time(v.time);
    s.add_view(r, request.cameras[v.camera]);
  }
  uint64_t unseen = 0;
  for (uint32_t which = 0; which < L4D_WEIGHT_COUNT; ++which) {
    const std::vector<float> expected = s.weights(which);
    for (size_t i = 0; i < expected.size(); ++i) {
      EXPECT_NEAR(m.weights[which][i], expected[i], 1e-5f * expected[i]) << which << ", " << i;
      unseen += which == L4D_WEIGHT_ALPHA_T && expected[i] == 0;
    }
  }
  EXPECT_EQ(m.report.unseen, unseen);
  // The order in which views are given changes nothing, nor do threads.
  Request turned = request;
  for (size_t i = 0; i < turned.views.size(); ++i) {
    turned.views[i] = request.views[(i * 7 + 3) % request.views.size()];
  }
  for (const Measured& other : {measure(scene, turned, 1), measure(scene, request, 7)}) {
    for (uint32_t which = 0; which < L4D_WEIGHT_COUNT; ++which) {
      EXPECT_TRUE(equal_bits(m.weights[which], other.weights[which])) << which;
    }
  }
}

TEST(Measure, StopsWhereViewsRepeatEachOther) {
  const io::Scene scene = synth(3000);
  Request request = ring(32, {1, 1.05, 1.1, 1.15});
  for (l4d_camera& c : request.cameras) c = ring_camera(64, 44, 0.3);
  const Measured m = measure(scene, request);
  ASSERT_EQ(m.status, L4D_OK) << m.detail;
  EXPECT_EQ(m.report.agreed, 1u);
  EXPECT_EQ(m.report.rounds, 1u);
  EXPECT_LE(m.report.views_measured, 16u);
  // They show nothing new: asking ends with its first round.
  EXPECT_EQ(m.report.views_visibility_only, 8u);
  for (const double a : m.report.agreement) {
    EXPECT_GE(a, 0.95);
    EXPECT_LE(a, 1);
  }
  request.options.visibility_all = 1;
  const Measured all = measure(scene, request);
  EXPECT_EQ(all.report.views_measured + all.report.views_visibility_only, all.report.views);
  EXPECT_EQ(all.report.unseen, m.report.unseen);
  request.options.visibility_all = 0;
  request.options.skip_visibility = 1;
  const Measured skipped = measure(scene, request);
  EXPECT_EQ(skipped.report.views_measured, m.report.views_measured);
  EXPECT_EQ(skipped.report.views_visibility_only, 0u);
  // Views from all sides take longer to agree.
  Request sides = ring(32, {1, 1.05, 1.1, 1.15});
  EXPECT_GT(measure(scene, sides).report.views_measured, m.report.views_measured);
}

TEST(Measure, MaxShare) {
  const io::Scene scene = synth(2000);
  Request request = ring(10, {0.5, 1.5});
  request.options.agreement = 2;
  request.options.visibility_all = 1;
  for (const double share : {0.01, 0.25, 0.33, 1.0}) {
    request.options.max_share = share;
    const Measured m = measure(scene, request);
    ASSERT_EQ(m.status, L4D_OK);
    EXPECT_EQ(m.report.views_measured, static_cast<uint64_t>(std::max(1.0, std::ceil(share * 20))));
    EXPECT_EQ(m.report.views_measured + m.report.views_visibility_only, 20u);
    EXPECT_EQ(m.report.agreed, 0u);
  }
}

// Gaussians in front, behind, and where nobody looks; the camera that looks back is left out.
TEST(Measure, VisibilityViewsFindWhatOnlyTheyShow) {
  const double red[3] = {1, 0, 0};
  SceneBuilder builder;
  for (const double z : {4.0, -4.0}) builder.add_ball(0, 0, z, 0.2, 0.8, red);
  builder.add_ball(0, 50, 0, 0.2, 0.8, red);
  Request request;
  const double eye[3] = {0, 0, 0}, back[3] = {0, 0, -1};
  request.cameras = {axis_camera(32, 24, 30), call_on(32, 24, 30, eye, back)};
  request.add(0, 0);
  request.add(0, 1);
  request.options.max_share = 0.5;
  const Measured m = measure(builder.scene(), request);
  ASSERT_EQ(m.status, L4D_OK) << m.detail;
  EXPECT_EQ(m.report.views_measured, 1u);
  EXPECT_EQ(m.report.views_visibility_only, 1u);
  EXPECT_EQ(m.report.unseen, 1u);
  EXPECT_GT(m.weights[L4D_WEIGHT_ALPHA_T][0], 0);
  EXPECT_GT(m.weights[L4D_WEIGHT_ALPHA_T][1], 0);
  EXPECT_EQ(m.weights[L4D_WEIGHT_ALPHA_T][2], 0);
  request.options.skip_visibility = 1;
  const Measured skipped = measure(builder.scene(), request);
  EXPECT_EQ(skipped.report.unseen, 2u);
  EXPECT_EQ(skipped.weights[L4D_WEIGHT_ALPHA_T][1], 0);
}

// Cameras at the origin that look outward, each at one of as many balls on a ring around it and at
// no other.
Request outward(uint32_t count, uint32_t side) {
  Request out;
  for (uint32_t c = 0; c < count; ++c) {
    const double angle = 6.283185307179586 * c / count;
    const double eye[3] = {0, 0, 0}, target[3] = {std::cos(angle), 0, std::sin(angle)};
    out.cameras.push_back(call_on(side, side, 12 * side, eye, target));
  }
  return out;
}
size_t add_outer_ball(SceneBuilder* builder, uint32_t at, uint32_t of, double opacity) {
  const double angle = 6.283185307179586 * at / of, white[3] = {0.9, 0.9, 0.9};
  return builder->add_ball(5 * std::cos(angle), 0, 5 * std::sin(angle), 0.0065, opacity, white);
}

// However views are spread over cameras and instants, each half sees the whole scene.
TEST(Measure, HalvesShareCamerasAndInstants) {
  const io::Scene scene = synth(2000);
  // One camera, many instants.
  Request one;
  one.cameras = {ring_camera(64, 44, 0.3)};
  for (int k = 0; k < 16; ++k) one.add(1 + 0.01 * k, 0);
  const Measured a = measure(scene, one);
  ASSERT_EQ(a.status, L4D_OK);
  EXPECT_EQ(a.report.agreed, 1u);
  for (const double agreement : a.report.agreement) EXPECT_GE(agreement, 0.95);
  // One instant, many cameras.
  Request instant = ring(32, {1});
  for (l4d_camera& c : instant.cameras) c = ring_camera(64, 44, 0.3);
  const Measured b = measure(scene, instant);
  ASSERT_EQ(b.status, L4D_OK);
  EXPECT_EQ(b.report.agreed, 1u);
  for (const double agreement : b.report.agreement) EXPECT_GE(agreement, 0.95);
}

// Two cameras that show different Gaussians, and two spans of time that do: a half that had one of
// them alone would rank what the other has not seen at all above the rest.
TEST(Measure, NeitherHalfSeesAPartAlone) {
  SceneBuilder builder;
  test::Random random(5);
  const double grey[3] = {0.6, 0.5, 0.4};
  for (int i = 0; i < 400; ++i) {
    const size_t at =
        builder.add_ball(random.uniform(-1, 1), random.uniform(-1, 1), i % 2 == 0 ? 5 : -5,
                         0.02 + 0.1 * random.uniform(), random.uniform(0.1, 0.9), grey);
    // Every other pair lives in the first half of the sequence or in the second.
    builder.scene().mean_t[at] = i % 4 < 2 ? 0.5f : 1.5f;
    builder.scene().log_scale[4 * at + 3] = static_cast<float>(std::log(0.12));
  }
  const double eye[3] = {0, 0, 0}, front[3] = {0, 0, 1}, back[3] = {0, 0, -1};
  Request request;
  request.cameras = {call_on(48, 48, 80, eye, front), call_on(48, 48, 80, eye, back)};
  for (int k = 0; k < 32; ++k) {
    for (uint32_t c = 0; c < 2; ++c) request.add(0.25 + 0.5 * k / 32 + (k % 2), c);
  }
  request.options.agreement = 1;  // looks at every round, and ends with the last view
  const Measured m = measure(builder.scene(), request);
  ASSERT_EQ(m.status, L4D_OK);
  EXPECT_EQ(m.report.views_measured, 64u);
  for (const double agreement : m.report.agreement) EXPECT_GE(agreement, 0.8);
}

// A round of asking that shows something new is followed by another, up to the last view.
TEST(Measure, VisibilityPassLastsAsLongAsThereIsNews) {
  constexpr uint32_t kViews = 48;
  SceneBuilder builder;
  for (uint32_t i = 0; i < kViews; ++i) add_outer_ball(&builder, i, kViews, 0.8);
  Request request = outward(kViews, 32);
  for (uint32_t c = 0; c < kViews; ++c) request.add(1, c);
  request.options.max_share = 1.0 / kViews;
  const Measured m = measure(builder.scene(), request);
  ASSERT_EQ(m.status, L4D_OK);
  EXPECT_EQ(m.report.views_measured, 1u);
  EXPECT_EQ(m.report.views_visibility_only, kViews - 1);
  EXPECT_EQ(m.report.unseen, 0u);
}

// What is new in a round counts as nothing below 1e-4 of the light that its images could hold, and
// asking ends there.
TEST(Measure, NewsBelowOneInTenThousandIsNone) {
  constexpr uint32_t kViews = 48, kSide = 96;
  Request request = outward(kViews, kSide);
  for (uint32_t c = 0; c < kViews; ++c) request.add(1, c);
  request.options.max_share = 1.0 / kViews;
  const double pixels = double{kSide} * kSide;
  bool ended = false, went_on = false;
  for (double opacity = 0.02; opacity < 0.2; opacity *= 1.15) {
    SceneBuilder builder;
    for (uint32_t i = 0; i < kViews; ++i) add_outer_ball(&builder, i, kViews, opacity);
    RendererHandle r = make_renderer(L4D_BACKEND_CPU);
    r.set_gaussians(builder.scene().view(), builder.scene().timeline);
    r.set_time(1);
    double light = 0;
    for (const float a : render_both(r, request.cameras[3]).alpha) light += static_cast<double>(a);
    const double news = light / pixels;
    const Measured m = measure(builder.scene(), r, request);
    ASSERT_EQ(m.status, L4D_OK);
    SCOPED_TRACE("opacity " + std::to_string(opacity) + ", news " + std::to_string(news));
    if (news < 0.9e-4) {
      EXPECT_EQ(m.report.views_visibility_only, 3u);  // a sixteenth of the cameras
      ended = true;
    } else if (news > 1.1e-4) {
      EXPECT_EQ(m.report.views_visibility_only, kViews - 1);
      went_on = true;
    }
  }
  EXPECT_TRUE(ended);
  EXPECT_TRUE(went_on);
}

struct Calls {
  uint64_t last = 0, total = 0;
  int count = 0, cancel_at = 1 << 30;
  std::vector<std::string> stages;
};
int note(void* user, uint64_t done, uint64_t total, const char* stage) {
  Calls& calls = *static_cast<Calls*>(user);
  EXPECT_EQ(done, calls.last + 1);
  calls.last = done;
  calls.total = total;
  if (calls.stages.empty() || calls.stages.back() != stage) calls.stages.push_back(stage);
  return ++calls.count >= calls.cancel_at ? 1 : 0;
}

TEST(Measure, ProgressAndCancelling) {
  const io::Scene scene = synth(1000);
  Request request = ring(6, {0.5, 1.5});
  request.options.max_share = 0.5;
  request.options.agreement = 2;
  request.options.visibility_all = 1;
  Calls calls;
  request.options.progress = note;
  request.options.progress_user = &calls;
  ASSERT_EQ(measure(scene, request).status, L4D_OK);
  EXPECT_EQ(calls.count, 12);
  EXPECT_EQ(calls.total, 12u);
  EXPECT_EQ(calls.stages.size(), 2u);
  for (const int at : {1, 3, 9}) {
    calls = Calls();
    calls.cancel_at = at;
    EXPECT_EQ(measure(scene, request).status, L4D_ERR_CANCELLED);
    EXPECT_EQ(calls.count, at);
  }
}

TEST(Measure, Refusals) {
  const io::Scene scene = synth(1000);
  const auto refused = [&](const Request& request) { return measure(scene, request).status; };
  const Request good = ring(3, {0.5});
  ASSERT_EQ(refused(good), L4D_OK);
  Request bad = good;
  bad.views[1].camera = 3;
  EXPECT_EQ(refused(bad), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_NE(measure(scene, bad).detail.find("camera"), std::string::npos);
  for (const double time : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    bad = good;
    bad.views[2].time = time;
    EXPECT_EQ(refused(bad), L4D_ERR_INVALID_ARGUMENT);
    EXPECT_NE(measure(scene, bad).detail.find("time"), std::string::npos);
  }
  bad = good;
  bad.cameras[0].fx = 0;
  EXPECT_EQ(refused(bad), L4D_ERR_INVALID_ARGUMENT);
  bad = good;
  bad.options.max_share = -0.5;
  EXPECT_EQ(refused(bad), L4D_ERR_INVALID_ARGUMENT);
  bad.options.max_share = std::nan("");
  EXPECT_EQ(refused(bad), L4D_ERR_INVALID_ARGUMENT);
  bad = good;
  bad.options.agreement = std::nan("");
  EXPECT_EQ(refused(bad), L4D_ERR_INVALID_ARGUMENT);
  bad = good;
  bad.options.metric = 7;
  EXPECT_EQ(refused(bad), L4D_ERR_INVALID_ARGUMENT);

  RendererHandle r = make_renderer(L4D_BACKEND_CPU);
  EXPECT_EQ(measure(scene, r, good).status, L4D_ERR_INVALID_STATE);
  r.set_gaussians(scene.view(), scene.timeline);
  const float grey[3] = {0.5f, 0.5f, 0.5f};
  r.check(l4d_renderer_set_background(r.get(), grey));
  EXPECT_EQ(measure(scene, r, good).status, L4D_ERR_INVALID_STATE);
  // No views, and what is NULL.
  const float black[3] = {0, 0, 0};
  r.check(l4d_renderer_set_background(r.get(), black));
  std::vector<float> alpha_t(scene.count());
  float* weights[L4D_WEIGHT_COUNT] = {};
  weights[L4D_WEIGHT_ALPHA_T] = alpha_t.data();
  const auto call = [&](const l4d_camera* cameras, const l4d_view* views, uint64_t n,
                        float* const* to, uint64_t count) {
    return l4d_measure_importance(r.get(), cameras, 3, views, n, nullptr, to, count, nullptr);
  };
  const l4d_camera* cameras = good.cameras.data();
  const l4d_view* views = good.views.data();
  EXPECT_EQ(call(cameras, views, 0, weights, 1000), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(call(nullptr, views, 3, weights, 1000), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(call(cameras, nullptr, 3, weights, 1000), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(call(cameras, views, 3, nullptr, 1000), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(call(cameras, views, 3, weights, 999), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(alpha_t, std::vector<float>(1000, 0.0f));
  // One kind of weights alone.
  EXPECT_EQ(call(cameras, views, 3, weights, 1000), L4D_OK);
  EXPECT_NE(alpha_t, std::vector<float>(1000, 0.0f));
}

}  // namespace
}  // namespace l4d::render
