// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/scene_header.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "tests/common/flat.h"
#include "tests/common/headers.h"
#include "tests/common/random.h"

namespace l4d {
namespace {

using test::example_header;

void expect_equal(const ChunkRef& a, const ChunkRef& b) {
  EXPECT_EQ(a.offset, b.offset);
  EXPECT_EQ(a.hash, b.hash);
  EXPECT_EQ(a.stored_bytes, b.stored_bytes);
  EXPECT_EQ(a.raw_bytes, b.raw_bytes);
  EXPECT_EQ(a.codec, b.codec);
}

void expect_equal(const StageCoding& a, const StageCoding& b) {
  EXPECT_EQ(a.num_entries, b.num_entries);
  EXPECT_EQ(a.element, b.element);
  EXPECT_EQ(a.step, b.step);
  expect_equal(a.codebook, b.codebook);
}

void expect_equal(const ComponentCoding& a, const ComponentCoding& b) {
  EXPECT_EQ(a.coding, b.coding);
  EXPECT_EQ(a.escapes, b.escapes);
  EXPECT_EQ(a.has_rcq, b.has_rcq);
  if (a.has_rcq) expect_equal(a.rcq, b.rcq);
  ASSERT_EQ(a.stages.size(), b.stages.size());
  for (size_t s = 0; s < a.stages.size(); ++s) expect_equal(a.stages[s], b.stages[s]);
}

void expect_equal(const ScalarCoding& a, const ScalarCoding& b) {
  EXPECT_EQ(a.coding, b.coding);
  EXPECT_EQ(a.bits, b.bits);
  EXPECT_EQ(a.offset, b.offset);
  EXPECT_EQ(a.step, b.step);
}

// From (2, 2, 2) to the origin.
void look(SceneHeader& h) {
  l4d_presentation& p = h.presentation;
  p.has_camera = 1;
  std::fill_n(p.camera_position, 3, 2.0);
  p.camera_up[1] = 1;
  p.camera_fov = 1;
}

ErrorStatement example_errors() {
  return {true, 0.5f,  1.5f, 0.1f, 2e9f,  0.05f, 0.75f, 1.25f, 0.2f,
          3,    1e-3f, true, true, 0.03f, 0.2f,  0.04f, 0.3f};
}

TEST(SceneHeader, ErrorsComeBack) {
  SceneHeader a = example_header(), b;
  ASSERT_TRUE(parse_scene_header(serialize_scene_header(a), 0, &b).ok());
  EXPECT_FALSE(b.errors.stated);
  a.errors = example_errors();
  ASSERT_TRUE(parse_scene_header(serialize_scene_header(a), 0, &b).ok());
  const ErrorStatement &x = a.errors, &y = b.errors;
  EXPECT_TRUE(y.stated && y.own_min_sizes);
  EXPECT_EQ(x.position, y.position);
  EXPECT_EQ(x.covariance, y.covariance);
  EXPECT_EQ(x.opacity, y.opacity);
  EXPECT_EQ(x.visible, y.visible);
  EXPECT_EQ(x.mean_t, y.mean_t);
  EXPECT_EQ(x.position_bound, y.position_bound);
  EXPECT_EQ(x.covariance_bound, y.covariance_bound);
  EXPECT_EQ(x.opacity_bound, y.opacity_bound);
  EXPECT_EQ(x.visible_bound, y.visible_bound);
  EXPECT_EQ(x.min_size, y.min_size);
  EXPECT_TRUE(y.colors);
  EXPECT_EQ(x.base_color, y.base_color);
  EXPECT_EQ(x.directional_color, y.directional_color);
  EXPECT_EQ(x.base_color_bound, y.base_color_bound);
  EXPECT_EQ(x.directional_color_bound, y.directional_color_bound);
}

TEST(SceneHeader, RoundTrip) {
  const SceneHeader a = example_header();
  SceneHeader b;
  const Status s = parse_scene_header(serialize_scene_header(a), 0, &b);
  ASSERT_TRUE(s.ok()) << s.detail();
  EXPECT_EQ(a.num_gaussians, b.num_gaussians);
  EXPECT_EQ(a.timeline.time_begin, b.timeline.time_begin);
  EXPECT_EQ(a.timeline.num_frames, b.timeline.num_frames);
  EXPECT_EQ(a.timeline.fps_num, b.timeline.fps_num);
  EXPECT_EQ(a.timeline.fps_den, b.timeline.fps_den);
  EXPECT_EQ(a.gate, b.gate);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(a.placement.origin[i], b.placement.origin[i]);
    EXPECT_EQ(a.position_center[i], b.position_center[i]);
  }
  EXPECT_EQ(a.placement.scale, b.placement.scale);
  EXPECT_EQ(a.placement.coordinate_system, b.placement.coordinate_system);
  EXPECT_EQ(a.placement.color_space, b.placement.color_space);
  EXPECT_EQ(a.position_at_mean_time, b.position_at_mean_time);
  EXPECT_EQ(a.opacity_logit, b.opacity_logit);
  EXPECT_EQ(a.position, b.position);
  EXPECT_EQ(a.position_scale, b.position_scale);
  expect_equal(a.opacity, b.opacity);
  EXPECT_EQ(a.sh_degree, b.sh_degree);
  expect_equal(a.sh, b.sh);
  EXPECT_EQ(a.payload_offset, b.payload_offset);
  EXPECT_EQ(a.metadata, b.metadata);
  ASSERT_EQ(a.layers.size(), b.layers.size());
  for (size_t i = 0; i < a.layers.size(); ++i) {
    const LayerHeader& x = a.layers[i];
    const LayerHeader& y = b.layers[i];
    EXPECT_EQ(x.level, y.level);
    EXPECT_EQ(x.permanent, y.permanent);
    EXPECT_EQ(x.num_gaussians, y.num_gaussians);
    EXPECT_EQ(x.mean_t, y.mean_t);
    EXPECT_EQ(x.log_scale_t, y.log_scale_t);
    expect_equal(x.scale_factor, y.scale_factor);
    for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
      expect_equal(x.component[c], y.component[c]);
    }
    EXPECT_EQ(x.directory_bits, y.directory_bits);
    EXPECT_EQ(x.page_table_offset, y.page_table_offset);
  }
}

TEST(SceneHeader, FlagsRoundTrip) {
  for (const bool at_mean : {false, true}) {
    for (const bool logit : {false, true}) {
      SceneHeader a = example_header();
      a.position = CoordinateCodingId::kRaw32;
      a.position_at_mean_time = at_mean;
      a.opacity_logit = logit;
      SceneHeader b;
      ASSERT_TRUE(parse_scene_header(serialize_scene_header(a), 0, &b).ok());
      EXPECT_EQ(b.position_at_mean_time, at_mean);
      EXPECT_EQ(b.opacity_logit, logit);
      EXPECT_EQ(b.position, CoordinateCodingId::kRaw32);
    }
  }
}

TEST(SceneHeader, SerializationIsDeterministic) {
  EXPECT_EQ(serialize_scene_header(example_header()), serialize_scene_header(example_header()));
}

TEST(SceneHeader, SizeDoesNotDependOnOffsets) {
  SceneHeader a = example_header();
  const size_t size = serialize_scene_header(a).size();
  a.payload_offset = ~uint64_t{0} >> 1;
  a.layers[1].page_table_offset = uint64_t{1} << 60;
  a.sh.stages[0].codebook.offset = 40;
  EXPECT_EQ(serialize_scene_header(a).size(), size);
}

struct Rule {
  const char* clause;
  const char* what;
  std::function<void(SceneHeader&)> change;
  l4d_status status = L4D_ERR_CORRUPT;
};

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

std::vector<Rule> rules() {
  using H = SceneHeader;
  using E = ErrorStatement;
  const auto unsupported = L4D_ERR_FEATURE_UNSUPPORTED;
  const auto stated = [](void (*change)(E&)) {
    return [=](H& h) {
      h.errors = example_errors();
      change(h.errors);
    };
  };
  const auto spatial = [](H& h) -> ComponentCoding& {
    return h.layers[1].component[L4D_COMPONENT_ROTOR_SPATIAL];
  };
  std::vector<Rule> r = {
      {"HEAD-2", "no frames", [](H& h) { h.timeline.num_frames = 0; }},
      {"HEAD-2", "too many frames", [](H& h) { h.timeline.num_frames = kMaxFrames + 1; }},
      {"HEAD-2", "rate 0", [](H& h) { h.timeline.fps_num = 0; }},
      {"HEAD-2", "rate 1/0", [](H& h) { h.timeline.fps_den = 0; }},
      {"HEAD-3", "origin NaN", [](H& h) { h.placement.origin[1] = static_cast<double>(kNan); }},
      {"HEAD-3", "origin infinite",
       [](H& h) { h.placement.origin[2] = static_cast<double>(kInf); }},
      {"HEAD-3", "world scale NaN", [](H& h) { h.placement.scale = static_cast<double>(kNan); }},
      {"HEAD-3", "position scale 0", [](H& h) { h.position_scale = 0; }},
      {"HEAD-3", "position scale negative", [](H& h) { h.position_scale = -1; }},
      {"HEAD-4", "SH degree 4", [](H& h) { h.sh_degree = 4; }},
      {"HEAD-5", "one Gaussian more than the scene", [](H& h) { h.layers[2].num_gaussians += 1; }},
      {"HEAD-5", "one Gaussian less than the scene", [](H& h) { h.layers[2].num_gaussians -= 1; }},
      {"HEAD-5", "counts that overflow",
       [](H& h) {
         h.layers[0].num_gaussians = ~uint64_t{0};
         h.layers[1].num_gaussians = 501;
         h.layers[2].num_gaussians = 100;
       }},
      {"HEAD-6", "level above the finest", [](H& h) { h.layers[2].level = 7; }},
      {"HEAD-6", "no layer",
       [](H& h) {
         h.layers.clear();
         h.num_gaussians = 0;
       }},
      {"HEAD-6", "levels descend",
       [](H& h) {
         h.layers.push_back(h.layers[2]);
         h.layers[3].num_gaussians = 0;
         h.layers[3].level = 2;
       }},
      {"HEAD-6", "more layers than four per level, and two",
       [](H& h) {
         while (h.layers.size() <= 30) {
           h.layers.push_back(h.layers[2]);
           h.layers.back().num_gaussians = 0;
         }
       }},
      {"HEAD-16", "position coding none", [](H& h) { h.position = CoordinateCodingId::kNone; }},
      {"HEAD-16", "position coding raw64", [](H& h) { h.position = CoordinateCodingId::kRaw64; }},
      {"HEAD-16", "position coding window", [](H& h) { h.position = CoordinateCodingId::kWindow; }},
      {"WIND-1", "begins of 25 bits",
       [](H& h) {
         h.layers[1].mean_t = CoordinateCodingId::kWindow;
         h.layers[1].window_begin_bits = 25;
       }},
      {"WIND-1", "lengths of 25 bits",
       [](H& h) {
         h.layers[2].mean_t = CoordinateCodingId::kWindow;
         h.layers[2].window_length_bits = 25;
       }},
      {"WIND-1", "windows longer than any sequence",
       [](H& h) {
         h.layers[1].mean_t = CoordinateCodingId::kWindow;
         h.layers[1].window_length = (1u << 24) + 1;
       }},
      {"WIND-2", "windows far from time 0",
       [](H& h) {
         h.layers[1].mean_t = CoordinateCodingId::kWindow;
         h.timeline.time_begin = -0x1p36;
       }},
      {"HEAD-10", "a permanent layer with windows",
       [](H& h) { h.layers[0].mean_t = CoordinateCodingId::kWindow; }},
      {"HEAD-7", "position coding 6", [](H& h) { h.position = CoordinateCodingId{6}; },
       unsupported},
      {"HEAD-7", "mean times 6", [](H& h) { h.layers[1].mean_t = CoordinateCodingId{6}; },
       unsupported},
      {"HEAD-17", "a key that is not UTF-8", [](H& h) { h.metadata.emplace_back("\xff", "a"); }},
      {"HEAD-17", "a value that ends within a character",
       [](H& h) { h.metadata.emplace_back("a", "b\xe2\x82"); }},
      {"HEAD-18", "a position error below 0", stated([](E& e) { e.position = -0x1p-149f; })},
      {"HEAD-18", "a position error that is no number", stated([](E& e) { e.position = kNan; })},
      {"HEAD-18", "an opacity error below 0", stated([](E& e) { e.opacity = -1; })},
      {"HEAD-18", "an infinite distance", stated([](E& e) { e.visible = kInf; })},
      {"HEAD-18", "a colour off by less than 0", stated([](E& e) { e.base_color = -1; })},
      {"HEAD-18", "an infinite colour", stated([](E& e) { e.directional_color = kInf; })},
      {"HEAD-18", "a bound of colours below 0", stated([](E& e) { e.base_color_bound = -1; })},
      {"HEAD-18", "a bound of colours that is no number",
       stated([](E& e) { e.directional_color_bound = kNan; })},
      {"HEAD-18", "an infinite error of mean times", stated([](E& e) { e.mean_t = kInf; })},
      {"HEAD-18", "a factor below 1",
       stated([](E& e) { e.covariance = std::nextafter(1.0f, 0.0f); })},
      {"HEAD-18", "an infinite factor", stated([](E& e) { e.covariance = kInf; })},
      {"HEAD-18", "a factor that is no number", stated([](E& e) { e.covariance = kNan; })},
      {"HEAD-18", "a position bound below 0", stated([](E& e) { e.position_bound = -1; })},
      {"HEAD-18", "a covariance bound below 0", stated([](E& e) { e.covariance_bound = -1; })},
      {"HEAD-18", "an infinite opacity bound", stated([](E& e) { e.opacity_bound = kInf; })},
      {"HEAD-18", "a distance bound below 0", stated([](E& e) { e.visible_bound = -1; })},
      {"HEAD-18", "a minimum size that is no number", stated([](E& e) { e.min_size = kNan; })},
      {"HEAD-19", "a dilation below 0", [](H& h) { h.rendering.dilation = -0x1p-149f; }},
      {"HEAD-19", "a dilation above 16",
       [](H& h) { h.rendering.dilation = std::nextafter(16.0f, 17.0f); }},
      {"HEAD-19", "a dilation that is no number", [](H& h) { h.rendering.dilation = kNan; }},
      {"HEAD-19", "a cut-off within a standard deviation",
       [](H& h) { h.rendering.cutoff = std::nextafter(1.0f, 0.0f); }},
      {"HEAD-19", "a cut-off that is no number", [](H& h) { h.rendering.cutoff = kNan; }},
      {"HEAD-19", "a least alpha below 1/255",
       [](H& h) { h.rendering.min_alpha = std::nextafter(1.0f / 255, 0.0f); }},
      {"HEAD-19", "a least alpha above 1/4", [](H& h) { h.rendering.min_alpha = 0.251f; }},
      {"HEAD-19", "a greatest alpha below 1/2", [](H& h) { h.rendering.max_alpha = 0.499f; }},
      {"HEAD-19", "a greatest alpha above 0.999",
       [](H& h) { h.rendering.max_alpha = std::nextafter(0.999f, 1.0f); }},
      {"HEAD-20", "metres below 0", [](H& h) { h.presentation.metres_per_unit = -0x1p-1000; }},
      {"HEAD-20", "bounds inside out",
       [](H& h) {
         h.presentation.has_bounds = 1;
         h.presentation.bounds_min[1] = 0x1p-1000;
       }},
      {"HEAD-20", "infinite bounds",
       [](H& h) {
         h.presentation.has_bounds = 1;
         h.presentation.bounds_max[2] = static_cast<double>(kInf);
       }},
      {"HEAD-20", "a camera that looks nowhere",
       [](H& h) {
         look(h);
         for (double& v : h.presentation.camera_target) v = 2;
       }},
      {"HEAD-20", "a camera that looks upwards",
       [](H& h) {
         look(h);
         for (double& v : h.presentation.camera_up) v = -3;
       }},
      {"HEAD-20", "a field of view of 0",
       [](H& h) {
         look(h);
         h.presentation.camera_fov = 0;
       }},
      {"HEAD-20", "a field of view of 3",
       [](H& h) {
         look(h);
         h.presentation.camera_fov = 3;
       }},
      {"HEAD-7", "opacity coding 3", [](H& h) { h.opacity.coding = ScalarCodingId{3}; },
       unsupported},
      {"HEAD-7", "scale factor coding 200",
       [](H& h) { h.layers[2].scale_factor.coding = ScalarCodingId{200}; }, unsupported},
      {"HEAD-7", "SH coding 4", [](H& h) { h.sh.coding = ComponentCodingId{4}; }, unsupported},
      {"HEAD-7", "rotor coding 9", [=](H& h) { spatial(h).coding = ComponentCodingId{9}; },
       unsupported},
      {"HEAD-7", "element type 2", [=](H& h) { spatial(h).stages[1].element = ElementType{2}; },
       unsupported},
      {"HEAD-7", "residual element type 1",
       [](H& h) { h.layers[2].component[L4D_COMPONENT_SCALE].rcq.element = ElementType{2}; },
       unsupported},
      {"HEAD-9", "gate 0", [](H& h) { h.gate = 0; }},
      {"HEAD-9", "gate negative", [](H& h) { h.gate = -1; }},
      {"HEAD-9", "gate above 16", [](H& h) { h.gate = std::nextafter(16.0f, 17.0f); }},
      {"HEAD-9", "gate NaN", [](H& h) { h.gate = kNan; }},
      {"HEAD-10", "permanent with mean times",
       [](H& h) { h.layers[0].mean_t = CoordinateCodingId::kF16; }},
      {"HEAD-10", "temporal without mean times",
       [](H& h) { h.layers[1].mean_t = CoordinateCodingId::kNone; }},
      {"HEAD-10", "permanent at level 3",
       [](H& h) {
         h.layers[2].permanent = true;
         h.layers[2].mean_t = CoordinateCodingId::kNone;
         h.layers[2].component[L4D_COMPONENT_SCALE].has_rcq = false;
       }},
      {"HEAD-11", "raw temporal rotor beside a coded spatial one",
       [](H& h) {
         h.layers[1].component[L4D_COMPONENT_ROTOR_TEMPORAL] = ComponentCoding();
         h.layers[1].component[L4D_COMPONENT_ROTOR_TEMPORAL].coding = ComponentCodingId::kRaw32;
       }},
      {"HEAD-12", "directory pages of 2^17 buckets", [](H& h) { h.layers[2].directory_bits = 17; }},
      {"HEAD-12", "a page table of 2^21 entries",
       [](H& h) {
         h.timeline.num_frames = kMaxFrames;
         h.layers[2].level = 24;
         h.layers[2].directory_bits = 4;
       }},
      {"HEAD-14", "raw scale factor beside a coded scale",
       [](H& h) { h.layers[1].scale_factor.coding = ScalarCodingId::kRaw32; }},
      {"CODE-1", "opacity of 0 bits", [](H& h) { h.opacity.bits = 0; }},
      {"CODE-1", "scale factor of 17 bits", [](H& h) { h.layers[0].scale_factor.bits = 17; }},
      {"CODE-2", "codebook of 0 entries", [](H& h) { h.sh.stages[1].num_entries = 0; }},
      {"CODE-2", "codebook of 65537 entries",
       [=](H& h) { spatial(h).stages[0].num_entries = 65537; }},
      {"CODE-2", "residual codebook of 0 entries",
       [](H& h) { h.layers[2].component[L4D_COMPONENT_SCALE].rcq.num_entries = 0; }},
      {"CODE-2", "residual codebook of 4097 entries",
       [](H& h) { h.layers[2].component[L4D_COMPONENT_SCALE].rcq.num_entries = 4097; }},
      {"CODE-3", "no stage", [](H& h) { h.sh.stages.clear(); }},
      {"CODE-3", "nine stages", [](H& h) { h.sh.stages.resize(9, h.sh.stages[0]); }},
      {"RCQ-2", "RCQ on SH",
       [](H& h) {
         h.sh.has_rcq = true;
         h.sh.rcq = h.layers[2].component[L4D_COMPONENT_SCALE].rcq;
       }},
      {"RCQ-2", "RCQ in level 0",
       [=](H& h) {
         spatial(h).has_rcq = true;
         spatial(h).rcq = h.layers[2].component[L4D_COMPONENT_SCALE].rcq;
       }},
  };
  // Numbers of the decoding arithmetic: zero or a sound magnitude.
  const std::pair<const char*, std::function<void(H&, float)>> kNumbers[] = {
      {"time_begin", [](H& h, float v) { h.timeline.time_begin = static_cast<double>(v); }},
      {"position_center", [](H& h, float v) { h.position_center[2] = v; }},
      {"position_scale", [](H& h, float v) { h.position_scale = v; }},
      {"opacity offset", [](H& h, float v) { h.opacity.offset = v; }},
      {"opacity step", [](H& h, float v) { h.opacity.step = v; }},
      {"scale factor offset", [](H& h, float v) { h.layers[2].scale_factor.offset = v; }},
      {"scale factor step", [](H& h, float v) { h.layers[2].scale_factor.step = v; }},
      {"log_scale_t", [](H& h, float v) { h.layers[0].log_scale_t = v; }}};
  for (const auto& [name, change] : kNumbers) {
    for (const float v : {kNan, kInf, -kInf, 0x1p-61f, -0x1p-61f, 1e-45f, 0x1.000002p60f}) {
      r.push_back({"HEAD-3", name, [change = change, v](H& h) { change(h, v); }});
    }
  }
  return r;
}

TEST(SceneHeader, RenderingAndPresentationComeBack) {
  SceneHeader a = example_header(), b;
  const size_t plain = serialize_scene_header(a).size();
  ASSERT_TRUE(parse_scene_header(serialize_scene_header(a), 0, &b).ok());
  EXPECT_EQ(b.rendering.stated, 0u);
  EXPECT_TRUE(is_default(b.rendering) && is_default(b.presentation));
  // What is at its default costs nothing.
  a.rendering.stated = 1;
  EXPECT_EQ(serialize_scene_header(a).size(), plain);
  a.rendering = {sizeof(l4d_rendering), 0.1f, 3, 0.25f, 0.5f, 1, 0};
  look(a);
  a.presentation.playback = 200;
  a.presentation.has_bounds = 1;
  for (int k = 0; k < 3; ++k)
    a.presentation.bounds_min[k] = -(a.presentation.bounds_max[k] = k + 1);
  a.presentation.metres_per_unit = 0.01;
  ASSERT_TRUE(parse_scene_header(serialize_scene_header(a), 0, &b).ok());
  EXPECT_EQ(b.rendering.stated, 1u);
  EXPECT_EQ(b.rendering.dilation, 0.1f);
  EXPECT_EQ(b.rendering.cutoff, 3);
  EXPECT_EQ(b.rendering.min_alpha, 0.25f);
  EXPECT_EQ(b.rendering.max_alpha, 0.5f);
  EXPECT_EQ(b.rendering.compensation, 1u);
  const l4d_presentation &x = a.presentation, &y = b.presentation;
  EXPECT_EQ(y.playback, 200u);
  EXPECT_EQ(y.metres_per_unit, 0.01);
  EXPECT_EQ(y.camera_fov, 1);
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(x.bounds_min[k], y.bounds_min[k]);
    EXPECT_EQ(x.bounds_max[k], y.bounds_max[k]);
    EXPECT_EQ(x.camera_position[k], y.camera_position[k]);
    EXPECT_EQ(x.camera_target[k], y.camera_target[k]);
    EXPECT_EQ(x.camera_up[k], y.camera_up[k]);
  }
}

// spec: HEAD-2, HEAD-3, HEAD-4, HEAD-5, HEAD-6, HEAD-7, HEAD-9, HEAD-10, HEAD-11, HEAD-12
// spec: HEAD-16, HEAD-17, HEAD-18, HEAD-19, HEAD-20
// spec: HEAD-14
// spec: CODE-1, CODE-2, CODE-3, RCQ-2
TEST(SceneHeader, EveryRuleIsChecked) {
  for (const Rule& rule : rules()) {
    SceneHeader h = example_header();
    rule.change(h);
    SceneHeader parsed;
    const Status s = parse_scene_header(serialize_scene_header(h), 40, &parsed);
    EXPECT_EQ(s.code(), rule.status) << rule.clause << " " << rule.what << ": " << s.detail();
    EXPECT_STREQ(s.clause(), rule.clause) << rule.what << ": " << s.detail();
    EXPECT_EQ(s.offset(), 40u);
  }
}

TEST(SceneHeader, ExtremesAreAccepted) {
  const std::vector<std::function<void(SceneHeader&)>> kChanges = {
      [](SceneHeader& h) { h.timeline.num_frames = kMaxFrames; },
      [](SceneHeader& h) { h.timeline.time_begin = -0x1p60; },
      [](SceneHeader& h) { h.timeline.time_begin = 0x1p-60; },
      [](SceneHeader& h) { h.position_center[0] = 0x1p60f; },
      [](SceneHeader& h) { h.position_scale = 0x1p-60f; },
      [](SceneHeader& h) { h.opacity.bits = 16; },
      [](SceneHeader& h) { h.opacity = ScalarCoding(); },
      [](SceneHeader& h) { h.gate = 16; },
      [](SceneHeader& h) { h.gate = 1e-6f; },
      [](SceneHeader& h) { h.sh.stages.resize(8, h.sh.stages[0]); },
      [](SceneHeader& h) { h.sh.stages[0].num_entries = 65536; },
      [](SceneHeader& h) { h.sh = ComponentCoding(); },
      [](SceneHeader& h) { h.layers[2].level = 6; },
      [](SceneHeader& h) { h.layers[2].directory_bits = 16; },
      [](SceneHeader& h) { h.layers[2].component[L4D_COMPONENT_SCALE].rcq.num_entries = 4096; }};
  for (size_t i = 0; i < kChanges.size(); ++i) {
    SceneHeader h = example_header();
    kChanges[i](h);
    SceneHeader parsed;
    const Status s = parse_scene_header(serialize_scene_header(h), 0, &parsed);
    EXPECT_TRUE(s.ok()) << i << ": " << s.detail();
  }
}

// spec: HEAD-1
TEST(SceneHeader, TruncatedAtEveryLength) {
  const Bytes bytes = serialize_scene_header(example_header());
  for (size_t n = 0; n < bytes.size(); ++n) {
    const Bytes cut(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(n));
    SceneHeader h;
    const Status s = parse_scene_header(cut, 0, &h);
    // Padding at the end may be cut without harm.
    if (n + 8 < bytes.size()) {
      ASSERT_EQ(s.code(), L4D_ERR_CORRUPT) << n;
      ASSERT_STREQ(s.clause(), "HEAD-1") << n;
    }
  }
}

// spec: HEAD-1
TEST(SceneHeader, OtherIdentifierIsRefused) {
  Bytes bytes = serialize_scene_header(example_header());
  bytes[7] = 'D';
  SceneHeader h;
  EXPECT_STREQ(parse_scene_header(bytes, 0, &h).clause(), "HEAD-1");
}

// Entries of the metadata may share their bytes; what they spell out may not exceed the header.
// spec: HEAD-13
TEST(SceneHeader, SharedMetadataDoesNotMultiply) {
  SceneHeader h = example_header();
  h.metadata = {{"text", std::string(3000, 'x')}, {"a", "b"}, {"c", "d"}};
  Bytes bytes = serialize_scene_header(h);
  SceneHeader parsed;
  ASSERT_TRUE(parse_scene_header(bytes, 0, &parsed).ok());
  test::share_metadata(bytes);
  const Status s = parse_scene_header(bytes, 0, &parsed);
  EXPECT_EQ(s.code(), L4D_ERR_CORRUPT);
  EXPECT_STREQ(s.clause(), "HEAD-13") << s.detail();
}

TEST(SceneHeader, DamagedBytesAreRefusedOrParsedSafely) {
  const Bytes bytes = serialize_scene_header(example_header());
  test::Random random(4);
  int refused = 0;
  for (int round = 0; round < 20000; ++round) {
    Bytes damaged = bytes;
    for (uint32_t k = random.below(4); k < 4; ++k) {
      damaged[random.below(static_cast<uint32_t>(damaged.size()))] =
          static_cast<unsigned char>(random.bits());
    }
    SceneHeader h;
    const Status s = parse_scene_header(damaged, 0, &h);
    if (s.ok()) {
      ASSERT_LE(h.layers.size(), 50u);
      ASSERT_LE(h.sh.stages.size(), 8u);
    } else {
      ++refused;
      ASSERT_TRUE(s.code() == L4D_ERR_CORRUPT || s.code() == L4D_ERR_FEATURE_UNSUPPORTED);
      ASSERT_STRNE(s.clause(), "");
    }
  }
  EXPECT_GT(refused, 1000);
}

}  // namespace
}  // namespace l4d
