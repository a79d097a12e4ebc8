// SPDX-License-Identifier: Apache-2.0
// Which views l4d_measure takes, and what it reports.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "tests/render/scenes.h"

namespace l4d::render {
namespace {

struct Measured {
  l4d_status status = L4D_OK;
  l4d_sensitivity* handle = nullptr;
  l4d_measure_report report;
  std::vector<std::vector<float>> weights;
  std::string detail;
};

struct Request {
  std::vector<l4d_camera> cameras;
  std::vector<l4d_view> views;
  l4d_measure_options options;
  l4d_progress_fn progress = nullptr;
  void* user = nullptr;
  Request() { l4d_measure_options_init(&options); }
  void add(double time, uint32_t camera) { views.push_back({time, camera, 0}); }
};

Measured measure(const io::Scene& scene, const RendererHandle& r, const Request& request) {
  Measured m;
  l4d_measure_report_init(&m.report);
  m.status =
      l4d_measure(r.get(), request.cameras.data(), static_cast<uint32_t>(request.cameras.size()),
                  request.views.data(), request.views.size(), &request.options, request.progress,
                  request.user, &m.report, &m.handle);
  m.detail = l4d_renderer_error_detail(r.get());
  if (m.status != L4D_OK) {
    EXPECT_EQ(m.handle, nullptr);
    return m;
  }
  const SensitivityHandle s(m.handle, scene.count());
  for (uint32_t which = 0; which < L4D_WEIGHT_COUNT; ++which) m.weights.push_back(s.weights(which));
  m.handle = nullptr;
  return m;
}

Measured measure(const io::Scene& scene, const Request& request, uint32_t threads = 2) {
  RendererHandle r = make_renderer(L4D_RENDER_FAST, threads);
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
  EXPECT_EQ(m.report.views_asked, 0u);
  EXPECT_EQ(m.report.agreed, 0u);
  RendererHandle r = make_renderer(L4D_RENDER_FAST);
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
  EXPECT_EQ(m.report.views_asked, 8u);
  for (const double a : m.report.agreement) {
    EXPECT_GE(a, 0.95);
    EXPECT_LE(a, 1);
  }
  request.options.ask_all = 1;
  const Measured all = measure(scene, request);
  EXPECT_EQ(all.report.views_measured + all.report.views_asked, all.report.views);
  EXPECT_EQ(all.report.unseen, m.report.unseen);
  request.options.ask_all = 0;
  request.options.skip_unseen = 1;
  const Measured skipped = measure(scene, request);
  EXPECT_EQ(skipped.report.views_measured, m.report.views_measured);
  EXPECT_EQ(skipped.report.views_asked, 0u);
  // Views from all sides take longer to agree.
  Request sides = ring(32, {1, 1.05, 1.1, 1.15});
  EXPECT_GT(measure(scene, sides).report.views_measured, m.report.views_measured);
}

TEST(Measure, MaxShare) {
  const io::Scene scene = synth(2000);
  Request request = ring(10, {0.5, 1.5});
  request.options.agreement = 2;
  request.options.ask_all = 1;
  for (const double share : {0.01, 0.25, 0.33, 1.0}) {
    request.options.max_share = share;
    const Measured m = measure(scene, request);
    ASSERT_EQ(m.status, L4D_OK);
    EXPECT_EQ(m.report.views_measured, static_cast<uint64_t>(std::max(1.0, std::ceil(share * 20))));
    EXPECT_EQ(m.report.views_measured + m.report.views_asked, 20u);
    EXPECT_EQ(m.report.agreed, 0u);
  }
}

// Gaussians in front, behind, and where nobody looks; the camera that looks back is left out.
TEST(Measure, AskedViewsFindWhatOnlyTheyShow) {
  const double red[3] = {1, 0, 0};
  SceneBuilder builder;
  for (const double z : {4.0, -4.0}) builder.add_ball(0, 0, z, 0.2, 0.8, red);
  builder.add_ball(0, 50, 0, 0.2, 0.8, red);
  Request request;
  const double eye[3] = {0, 0, 0}, back[3] = {0, 0, -1};
  request.cameras = {axis_camera(32, 24, 30), look_at(32, 24, 30, eye, back)};
  request.add(0, 0);
  request.add(0, 1);
  request.options.max_share = 0.5;
  const Measured m = measure(builder.scene(), request);
  ASSERT_EQ(m.status, L4D_OK) << m.detail;
  EXPECT_EQ(m.report.views_measured, 1u);
  EXPECT_EQ(m.report.views_asked, 1u);
  EXPECT_EQ(m.report.unseen, 1u);
  EXPECT_GT(m.weights[L4D_WEIGHT_ALPHA_T][0], 0);
  EXPECT_GT(m.weights[L4D_WEIGHT_ALPHA_T][1], 0);
  EXPECT_EQ(m.weights[L4D_WEIGHT_ALPHA_T][2], 0);
  request.options.skip_unseen = 1;
  const Measured skipped = measure(builder.scene(), request);
  EXPECT_EQ(skipped.report.unseen, 2u);
  EXPECT_EQ(skipped.weights[L4D_WEIGHT_ALPHA_T][1], 0);
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
  request.options.ask_all = 1;
  Calls calls;
  request.progress = note;
  request.user = &calls;
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
  bad.options.max_share = 0;
  EXPECT_EQ(refused(bad), L4D_ERR_INVALID_ARGUMENT);
  bad.options.max_share = std::nan("");
  EXPECT_EQ(refused(bad), L4D_ERR_INVALID_ARGUMENT);
  bad = good;
  bad.options.agreement = std::nan("");
  EXPECT_EQ(refused(bad), L4D_ERR_INVALID_ARGUMENT);
  bad = good;
  bad.options.sensitivity.measure = 7;
  EXPECT_EQ(refused(bad), L4D_ERR_INVALID_ARGUMENT);

  RendererHandle r = make_renderer(L4D_RENDER_FAST);
  EXPECT_EQ(measure(scene, r, good).status, L4D_ERR_INVALID_STATE);
  r.set_gaussians(scene.view(), scene.timeline);
  const float grey[3] = {0.5f, 0.5f, 0.5f};
  r.check(l4d_renderer_set_background(r.get(), grey));
  EXPECT_EQ(measure(scene, r, good).status, L4D_ERR_INVALID_STATE);
  // No views, and what is NULL.
  const float black[3] = {0, 0, 0};
  r.check(l4d_renderer_set_background(r.get(), black));
  l4d_sensitivity* out = nullptr;
  const auto call = [&](const l4d_camera* cameras, const l4d_view* views, uint64_t n,
                        l4d_sensitivity** to) {
    return l4d_measure(r.get(), cameras, 3, views, n, nullptr, nullptr, nullptr, nullptr, to);
  };
  const l4d_camera* cameras = good.cameras.data();
  EXPECT_EQ(call(cameras, good.views.data(), 0, &out), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(call(nullptr, good.views.data(), 3, &out), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(call(cameras, nullptr, 3, &out), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(call(cameras, good.views.data(), 3, nullptr), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(call(cameras, good.views.data(), 3, &out), L4D_OK);
  l4d_sensitivity_destroy(out);
}

}  // namespace
}  // namespace l4d::render
