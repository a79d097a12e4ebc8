// SPDX-License-Identifier: Apache-2.0
// Whole encodes: what the report says, what the decoder gets, and what happens to odd scenes.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <string>

#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"
#include "libl4dcodec/scene/layers.h"
#include "libl4dcodec/scene/slice.h"
#include "tests/common/codec.h"
#include "tests/common/random.h"

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

// ---- determinism -------------------------------------------------------------------------------

TEST(Determinism, AnyNumberOfThreadsAndAnyRun) {
  EncodeOptions plain = small_options();
  EncodeOptions staged = small_options();
  staged.stages = {{L4D_ENC_STAGES, {1, 0.5f, 0.2f}}};
  EncodeOptions rcq = small_options();
  rcq.settings.push_back({L4D_ENC_RCQ, 2});
  EncodeOptions lossless;
  lossless.preset = "lossless";
  lossless.settings = {{L4D_ENC_ZSTD_LEVEL, 3}};
  const TestScene scene = scene_of(3000);
  for (EncodeOptions o : {plain, staged, rcq, lossless}) {
    o.threads = 1;
    const Encoded want = encode(scene, o);
    for (const uint32_t threads : {1u, 2u, 7u}) {
      o.threads = threads;
      const Encoded got = encode(scene, o);
      EXPECT_TRUE(got.bytes == want.bytes) << threads << " threads";
      EXPECT_EQ(got.order, want.order);
    }
  }
}

TEST(Determinism, AHandleCanEncodeAgain) {
  const EncoderHandle e;
  const TestScene scene = scene_of(500);
  prepare_encoder(scene, small_options(), e);
  const Bytes first = e.encode();
  EXPECT_TRUE(first == e.encode());
  const TestScene other = scene_of(400, 9);
  prepare_encoder(other, small_options(), e);
  EXPECT_TRUE(e.encode() == encode(other, small_options()).bytes);
}

TEST(Determinism, SeedsAreUsed) {
  EncodeOptions a = small_options();
  EncodeOptions b = a;
  b.seed = 12345;
  const TestScene scene = scene_of(3000);
  const Encoded x = encode(scene, a), y = encode(scene, b);
  EXPECT_FALSE(x.bytes == y.bytes);
  expect_valid(y.bytes);
}

// ---- reports -----------------------------------------------------------------------------------

// spec: VER-3
TEST(Report, CountsAndSteps) {
  const TestScene scene = scene_of(1500);
  const EncoderHandle e;
  l4d_encode_report r = L4D_INIT(l4d_encode_report);
  EXPECT_EQ(l4d_encoder_get_report(e.get(), &r), L4D_ERR_INVALID_STATE);
  prepare_encoder(scene, small_options(), e);
  EXPECT_EQ(l4d_encoder_get_report(e.get(), &r), L4D_ERR_INVALID_STATE);
  const Bytes bytes = e.encode();
  e.check(l4d_encoder_get_report(e.get(), &r));
  EXPECT_EQ(r.input_gaussians, 1500u);
  EXPECT_EQ(r.coded_gaussians, 1500u);
  EXPECT_EQ(r.invalid_dropped, 0u);
  EXPECT_EQ(r.pruned, 0u);
  EXPECT_EQ(r.file_bytes, bytes.size());
  EXPECT_EQ(r.raw_bytes, 4u * (17 + 12) * 1500);
  EXPECT_GT(r.total_seconds, 0);
  DecoderHandle d;
  d.open_memory(bytes.data(), bytes.size());
  EXPECT_EQ(r.num_layers, d.info().num_layers);
  EXPECT_EQ(d.info().development, 1u);
  EXPECT_EQ(d.info().format_major, uint32_t{L4D_BITSTREAM_MAJOR});
  double sum = 0;
  ASSERT_GT(r.num_steps, 3u);
  for (uint32_t i = 0; i < r.num_steps; ++i) {
    EXPECT_NE(std::string(r.steps[i].name), "");
    EXPECT_GE(r.steps[i].seconds, 0);
    sum += r.steps[i].seconds;
  }
  EXPECT_LE(sum, r.total_seconds * 1.01 + 1e-3);
  std::vector<uint32_t> order(1500);
  EXPECT_EQ(l4d_encoder_get_order(e.get(), order.data(), 1499), L4D_ERR_BUFFER_TOO_SMALL);
  EXPECT_EQ(l4d_encoder_get_order(e.get(), order.data(), 1500), L4D_OK);
  std::sort(order.begin(), order.end());
  for (uint32_t i = 0; i < 1500; ++i) EXPECT_EQ(order[i], i);
}

// The order relates decoded Gaussians to the input: each is near the one it is said to come from.
TEST(Report, OrderNamesTheSource) {
  const TestScene scene = scene_of(1000);
  EncodeOptions o = small_options();
  o.settings.push_back({L4D_ENC_CLOSED_LOOP, 0});
  const Encoded e = encode(scene, o);
  const GaussianArrays a = decode(e.bytes, all_query());
  ASSERT_EQ(a.count(), e.order.size());
  for (size_t i = 0; i < a.count(); ++i) {
    const size_t from = e.order[i];
    for (size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(a.position[3 * i + k], scene.position[3 * from + k], 0.02);
    }
    EXPECT_NEAR(a.opacity[i], scene.opacity[from], 0.004);
  }
}

TEST(Report, MetadataIsStored) {
  const EncoderHandle e;
  const TestScene scene = scene_of(50);
  prepare_encoder(scene, small_options(), e);
  const size_t before = e.encode().size();
  const std::string value(1000, 'x');
  e.check(l4d_encoder_add_metadata(e.get(), "note", value.c_str()));
  const Bytes bytes = e.encode();
  EXPECT_GT(bytes.size(), before + 1000);
  e.check(l4d_encoder_add_metadata(e.get(), "note", "\xc3\xa4"));
  e.check(l4d_encoder_add_metadata(e.get(), "", ""));
  const Bytes more = e.encode();
  expect_valid(more);
  DecoderHandle d;
  d.open_memory(more.data(), more.size());
  using Pairs = std::vector<std::pair<std::string, std::string>>;
  EXPECT_EQ(d.metadata(), (Pairs{{"note", value}, {"note", "\xc3\xa4"}, {"", ""}}));
  d.open_memory(dynamic_file().data(), dynamic_file().size());
  EXPECT_EQ(d.metadata(), Pairs());
  const char *key = "", *text = "";
  d.check(l4d_decoder_get_metadata(d.get(), UINT32_MAX, &key, &text));
  EXPECT_EQ(key, nullptr);
  EXPECT_EQ(text, nullptr);
}

// ---- refusing and dropping ---------------------------------------------------------------------

struct BadValue {
  const char* attribute;
  std::vector<float> TestScene::*array;
  size_t dim;
  float value;
};

std::vector<BadValue> bad_values() {
  std::vector<BadValue> all;
  for (const float v : {kNan, kInf, -kInf}) {
    all.push_back({"position", &TestScene::position, 3, v});
    all.push_back({"mean_t", &TestScene::mean_t, 1, v});
    all.push_back({"log_scale", &TestScene::log_scale, 4, v});
    all.push_back({"rotor", &TestScene::rotor, 8, v});
    all.push_back({"opacity", &TestScene::opacity, 1, v});
    all.push_back({"sh", &TestScene::sh, 12, v});
  }
  all.push_back({"log_scale", &TestScene::log_scale, 4, 17.01f});
  all.push_back({"log_scale", &TestScene::log_scale, 4, -17.01f});
  all.push_back({"opacity", &TestScene::opacity, 1, -0.001f});
  all.push_back({"opacity", &TestScene::opacity, 1, 1.001f});
  all.push_back({"sh", &TestScene::sh, 12, 70000.0f});
  return all;
}

TEST(InvalidInput, IsRefusedByName) {
  for (const BadValue& bad : bad_values()) {
    for (const char* preset : {"default", "indexed", "lossless"}) {
      TestScene scene = scene_of(100);
      (scene.*bad.array)[bad.dim * 57 + bad.dim - 1] = bad.value;
      EncodeOptions o = small_options();
      o.preset = preset;
      try {
        encode(scene, o);
        ADD_FAILURE() << bad.attribute << " " << bad.value << " was accepted";
      } catch (const Error& e) {
        EXPECT_EQ(e.status(), L4D_ERR_INVALID_SCENE);
        const std::string what = e.what();
        EXPECT_NE(what.find("Gaussian 57"), std::string::npos) << what;
        EXPECT_NE(what.find(bad.attribute), std::string::npos) << what;
      }
    }
  }
}

TEST(InvalidInput, IsDroppedOnDemand) {
  for (const BadValue& bad : bad_values()) {
    TestScene scene = scene_of(100);
    (scene.*bad.array)[bad.dim * 57] = bad.value;
    (scene.*bad.array)[bad.dim * 99 + bad.dim - 1] = bad.value;
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_DROP_INVALID, 1});
    const Encoded e = encode(scene, o);
    EXPECT_EQ(e.report.input_gaussians, 100u);
    EXPECT_EQ(e.report.coded_gaussians, 98u);
    EXPECT_EQ(e.report.invalid_dropped, 2u);
    for (const uint32_t i : e.order) EXPECT_TRUE(i != 57 && i != 99);
    EXPECT_EQ(decode(e.bytes, all_query()).count(), 98u);
  }
}

TEST(InvalidInput, NothingLeftIsAnError) {
  TestScene scene = scene_of(3);
  for (float& v : scene.mean_t) v = kNan;
  EncodeOptions o = small_options();
  o.settings.push_back({L4D_ENC_DROP_INVALID, 1});
  try {
    encode(scene, o);
    ADD_FAILURE();
  } catch (const Error& e) {
    EXPECT_EQ(e.status(), L4D_ERR_INVALID_SCENE);
  }
}

TEST(InvalidInput, ScenesAndTimelines) {
  const EncoderHandle e;
  const TestScene scene = scene_of(10);
  const auto set = [&](const std::function<void(l4d_gaussians&, l4d_timeline&)>& change) {
    l4d_gaussians g = scene.view();
    l4d_timeline t = scene.timeline;
    change(g, t);
    return l4d_encoder_set_scene(e.get(), &g, &t, nullptr);
  };
  using G = l4d_gaussians;
  using T = l4d_timeline;
  const std::function<void(G&, T&)> kWrong[] = {
      [](G& g, T&) { g.count = uint64_t{1} << 31; },
      [](G& g, T&) { g.sh_degree = 4; },
      [](G& g, T&) { g.position = nullptr; },
      [](G& g, T&) { g.mean_t = nullptr; },
      [](G& g, T&) { g.log_scale = nullptr; },
      [](G& g, T&) { g.rotor = nullptr; },
      [](G& g, T&) { g.opacity = nullptr; },
      [](G& g, T&) { g.sh = nullptr; },
      [](G&, T& t) { t.num_frames = 0; },
      [](G&, T& t) { t.num_frames = (1u << 24) + 1; },
      [](G&, T& t) { t.fps_num = 0; },
      [](G&, T& t) { t.fps_den = 0; },
      [](G&, T& t) { t.time_begin = static_cast<double>(kNan); },
      [](G&, T& t) { t.time_begin = 1e30; },
      [](G&, T& t) { t.time_begin = 1e-30; }};
  for (const auto& wrong : kWrong) EXPECT_EQ(set(wrong), L4D_ERR_INVALID_ARGUMENT);
  // No wrong call, but no scene to code: as where no Gaussian of it is left.
  EXPECT_EQ(set([](G& g, T&) { g.count = 0; }), L4D_ERR_INVALID_SCENE);
  EXPECT_EQ(set([](G&, T&) {}), L4D_OK);
}

// Nothing that encode accepts may make a file that the decoder refuses.
TEST(InvalidInput, PlacementsAreRefusedOrReadBack) {
  const TestScene scene = scene_of(20);
  const double nan = static_cast<double>(kNan), inf = static_cast<double>(kInf);
  const l4d_placement kPlacements[] = {
      {{1e9, -2.5, 0}, 0.01, L4D_COORDINATES_RIGHT_UP_BACK, L4D_COLOR_LINEAR_SRGB},
      {{nan, 0, 0}, 1, 0, 0},
      {{0, inf, 0}, 1, 0, 0},
      {{0, 0, 0}, nan, 0, 0},
      {{0, 0, 0}, -inf, 0, 0},
      {{0, 0, 0}, 1, 300, 0},
      {{0, 0, 0}, 1, 0, 257}};
  for (const l4d_placement& p : kPlacements) {
    const EncoderHandle e;
    const l4d_gaussians g = scene.view();
    Bytes bytes;
    try {
      e.check(l4d_encoder_set_scene(e.get(), &g, &scene.timeline, &p));
      bytes = e.encode();
    } catch (const Error& error) {
      EXPECT_TRUE(error.status() == L4D_ERR_INVALID_ARGUMENT ||
                  error.status() == L4D_ERR_INVALID_SCENE);
      continue;
    }
    DecoderHandle d;
    const l4d_status opened = l4d_decoder_open_memory(d.get(), bytes.data(), bytes.size());
    EXPECT_EQ(opened, L4D_OK) << "the encoder wrote what the decoder refuses: "
                              << l4d_last_error_message();
    if (opened != L4D_OK) continue;
    const l4d_placement got = d.info().placement;
    for (int k = 0; k < 3; ++k) EXPECT_EQ(got.origin[k], p.origin[k]);
    EXPECT_EQ(got.scale, p.scale);
    EXPECT_EQ(got.coordinate_system, p.coordinate_system);
    EXPECT_EQ(got.color_space, p.color_space);
  }
}

// ---- odd scenes --------------------------------------------------------------------------------

TEST(OddScenes, FewGaussiansInEveryDegreeAndPreset) {
  for (const char* preset : {"default", "indexed", "indexed-high", "lossless"}) {
    for (uint32_t degree = 0; degree <= 3; ++degree) {
      for (uint64_t count = 1; count <= 3; ++count) {
        SceneOptions s;
        s.count = count;
        s.sh_degree = degree;
        s.seed = 50 + count;
        const TestScene scene = make_scene(s);
        EncodeOptions o;
        o.preset = preset;
        const Encoded e = encode(scene, o);
        expect_valid(e.bytes);
        const GaussianArrays a = decode(e.bytes, all_query());
        ASSERT_EQ(a.count(), count);
        EXPECT_EQ(a.sh.size(), count * scene.sh_dim());
        for (size_t i = 0; i < count; ++i) {
          const size_t from = e.order[i];
          for (size_t k = 0; k < 3; ++k) {
            const float want = scene.position[3 * from + k];
            EXPECT_NEAR(a.position[3 * i + k], want, 0.2 + 0.01 * std::fabs(want));
          }
        }
      }
    }
  }
}

TEST(OddScenes, AllEqual) {
  const TestScene one = scene_of(1);
  TestScene scene = scene_of(300);
  const auto repeat = [](const std::vector<float>& from, std::vector<float>* to) {
    for (size_t i = 0; i < to->size(); ++i) (*to)[i] = from[i % from.size()];
  };
  repeat(one.position, &scene.position);
  repeat(one.mean_t, &scene.mean_t);
  repeat(one.log_scale, &scene.log_scale);
  repeat(one.rotor, &scene.rotor);
  repeat(one.opacity, &scene.opacity);
  repeat(one.sh, &scene.sh);
  EncodeOptions o = small_options();
  o.stages = {{L4D_ENC_STAGES, {1, 1, 1}}};
  const Encoded e = encode(scene, o);
  expect_valid(e.bytes);
  EXPECT_LT(e.bytes.size(), 6000u);
  const GaussianArrays a = decode(e.bytes, all_query());
  ASSERT_EQ(a.count(), 300u);
  for (size_t i = 3; i < a.position.size(); ++i) EXPECT_EQ(a.position[i], a.position[i % 3]);
}

TEST(OddScenes, ExtremeValues) {
  TestScene scene = scene_of(60);
  for (size_t i = 0; i < 60; ++i) {
    const float sign = i % 2 == 0 ? 1.0f : -1.0f;
    if (i % 5 == 0) scene.position[3 * i] = sign * 1e18f;
    if (i % 5 == 1) scene.mean_t[i] = sign * 1e18f;
    if (i % 5 == 2)
      std::fill_n(scene.log_scale.begin() + static_cast<std::ptrdiff_t>(4 * i), 4, sign * 16);
    if (i % 5 == 3) scene.sh[12 * i] = sign * 65504;
    if (i % 5 == 4) scene.opacity[i] = i % 2 == 0 ? 0.0f : 1.0f;
    if (i % 7 == 0) std::fill_n(scene.rotor.begin() + static_cast<std::ptrdiff_t>(8 * i), 8, 0.0f);
  }
  for (const char* preset : {"default", "indexed", "indexed-high", "lossless"}) {
    EncodeOptions o;
    o.preset = preset;
    o.settings = {{L4D_ENC_MERGE_COUNT, 0}, {L4D_ENC_MERGE_FRACTION, 0}};
    const Encoded e = encode(scene, o);
    expect_valid(e.bytes);
    const GaussianArrays a = decode(e.bytes, all_query());
    for (const float v : a.position) EXPECT_TRUE(std::isfinite(v));
    for (const float v : a.rotor) EXPECT_TRUE(std::isfinite(v));
    for (const float v : a.sh) EXPECT_TRUE(std::isfinite(v));
    for (const float v : a.mean_t) EXPECT_TRUE(std::isfinite(v));
    // What comes out goes in again, though coding may have pushed it past the borders.
    TestScene again = scene;
    again.position = a.position;
    again.mean_t = a.mean_t;
    again.log_scale = a.log_scale;
    again.rotor = a.rotor;
    again.opacity = a.opacity;
    again.sh = a.sh;
    again.flags = a.flags;
    const GaussianArrays b = decode(encode(again, o).bytes, all_query());
    ASSERT_EQ(b.count(), a.count());
    for (const float v : b.log_scale) EXPECT_LE(std::fabs(v), 17.0f);
  }
}

// A static scene pays for no time.
TEST(OddScenes, StaticScenesCostNothingTemporal) {
  SceneOptions s;
  s.count = 1000;
  s.permanent = 1;
  const TestScene scene = make_scene(s);
  const Encoded e = encode(scene, small_options());
  expect_valid(e.bytes);
  DecoderHandle d;
  d.open_memory(e.bytes.data(), e.bytes.size());
  EXPECT_EQ(d.info().tools & (L4D_TOOL_MOTION | L4D_TOOL_TEMPORAL_OPACITY), 0u);
  EXPECT_EQ(d.info().num_layers, 1u);
  uint64_t sections[L4D_SECTION_COUNT];
  d.check(l4d_decoder_get_sections(d.get(), sections, L4D_SECTION_COUNT, nullptr, nullptr, 0));
  EXPECT_EQ(sections[L4D_SECTION_MEAN_T], 0u);
  EXPECT_EQ(sections[L4D_SECTION_ROTOR_TEMPORAL], 0u);
  l4d_codebook codebook = L4D_INIT(l4d_codebook);
  d.check(l4d_decoder_get_codebook(d.get(), 0, L4D_COMPONENT_SCALE, 0, L4D_NO_BLOCK, &codebook));
  EXPECT_EQ(codebook.dim, 3u);
  const GaussianArrays a = d.decode(all_query());
  for (size_t i = 0; i < a.count(); ++i) {
    for (size_t k = 4; k < 8; ++k) EXPECT_EQ(a.rotor[8 * i + k], 0.0f);
  }
  for (const double t : {0.0, 1.0, 2.0}) EXPECT_EQ(d.slice(t).count(), 1000u);
}

TEST(OddScenes, NoMotionNoTemporalRotor) {
  SceneOptions s;
  s.permanent = 0;
  s.moving = false;
  const Encoded e = encode(make_scene(s), small_options());
  DecoderHandle d;
  d.open_memory(e.bytes.data(), e.bytes.size());
  EXPECT_EQ(d.info().tools & L4D_TOOL_MOTION, 0u);
  EXPECT_NE(d.info().tools & L4D_TOOL_TEMPORAL_OPACITY, 0u);
  uint64_t sections[L4D_SECTION_COUNT];
  d.check(l4d_decoder_get_sections(d.get(), sections, L4D_SECTION_COUNT, nullptr, nullptr, 0));
  EXPECT_EQ(sections[L4D_SECTION_ROTOR_TEMPORAL], 0u);
}

// The temporal scale of a permanent layer is a number of the header, where tiny ones are forbidden.
TEST(OddScenes, TinyTemporalLogScaleOfAPermanentLayer) {
  SceneOptions s;
  s.count = 20;
  s.num_frames = 1;
  s.permanent = 1;
  TestScene scene = make_scene(s);
  for (size_t i = 0; i < scene.count(); ++i) {
    scene.log_scale[4 * i + 3] = -1e-30f;
    scene.mean_t[i] = 0;
  }
  const Encoded e = encode(scene, small_options());
  expect_valid(e.bytes);
}

TEST(OddScenes, LongSequences) {
  SceneOptions s;
  s.count = 500;
  s.num_frames = 1u << 24;
  s.fps_num = 60;
  const TestScene scene = make_scene(s);
  EncodeOptions o = small_options();
  o.settings.push_back({L4D_ENC_MERGE_COUNT, 0});
  o.settings.push_back({L4D_ENC_MERGE_FRACTION, 0});
  const Encoded e = encode(scene, o);
  expect_valid(e.bytes);
  DecoderHandle d;
  d.open_memory(e.bytes.data(), e.bytes.size());
  EXPECT_GE(d.info().num_layers, 15u);
  EXPECT_EQ(d.decode(all_query()).count(), 500u);
  const l4d_selection now = d.select(time_query(scene.duration() / 3));
  EXPECT_LT(now.num_gaussians, 450u);
}

TEST(OddScenes, LogitOpacitiesAndPositionsAtTheMean) {
  TestScene plain = scene_of(800);
  TestScene other = plain;
  other.flags = L4D_OPACITY_LOGIT | L4D_POSITION_AT_MEAN_TIME;
  for (size_t i = 0; i < plain.count(); ++i) {
    const double o = std::min(static_cast<double>(plain.opacity[i]), 0.999999);
    other.opacity[i] = static_cast<float>(std::log(o / (1 - o)));
    double rotor[8], scale[4];
    for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(plain.rotor[8 * i + k]);
    for (size_t k = 0; k < 4; ++k)
      scale[k] = std::exp(static_cast<double>(plain.log_scale[4 * i + k]));
    const auto slice = slice_gaussian(normalized_halves(rotor), scale);
    const double mean = static_cast<double>(plain.mean_t[i]);
    const double dt = mean - reference_time(plain.timeline, mean);
    for (size_t k = 0; k < 3; ++k) {
      other.position[3 * i + k] += static_cast<float>(slice.velocity[k] * dt);
    }
  }
  const Encoded a = encode(plain, small_options()), b = encode(other, small_options());
  const GaussianArrays x = decode(a.bytes, all_query()), y = decode(b.bytes, all_query());
  EXPECT_EQ(y.flags, 0u);  // lossy streams have one meaning
  ASSERT_EQ(x.count(), y.count());
  // Order may differ where positions round differently: compare by source.
  std::vector<size_t> of_source(plain.count());
  for (size_t i = 0; i < y.count(); ++i) of_source[b.order[i]] = i;
  for (size_t i = 0; i < x.count(); ++i) {
    const size_t j = of_source[a.order[i]];
    EXPECT_NEAR(x.opacity[i], y.opacity[j], 0.01);
    for (size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(x.position[3 * i + k], y.position[3 * j + k], 0.05);
    }
  }
}

// ---- geometry ----------------------------------------------------------------------------------

// Layers are chosen from the input, but a decoder sees quantised extents: those that no longer fit
// move to a coarser layer.
// spec: ENC-2
TEST(Demoted, MoveToCoarserLayers) {
  EncodeOptions o = small_options();
  o.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 2});
  o.settings.push_back({L4D_ENC_SCALE_FACTOR_BITS, 2});
  for (const int rcq : {0, 2}) {
    o.settings.push_back({L4D_ENC_RCQ, static_cast<double>(rcq)});
    const TestScene scene = scene_of(3000);
    const Encoded e = encode(scene, o);
    EXPECT_GT(e.report.moved_to_coarser, 20u);
    EXPECT_EQ(decode(e.bytes, all_query()).count(), 3000u);
    for (const Violation& v : validate(e.bytes)) EXPECT_NE(v.clause, "LAYR-1") << v.message;
  }
}

// Gaussians that fly from far away to the centre of the coded frame: the box must allow for the
// rounding of the large coordinate, though it ends at a small one.
// spec: ENC-2
TEST(Bounds, HoldForFastGaussians) {
  for (uint64_t seed = 70; seed < 73; ++seed) {
    SceneOptions s;
    s.count = 2000;
    s.permanent = 0;
    s.speed = 0.5;
    s.seed = seed;
    TestScene scene = make_scene(s);
    for (size_t i = 0; i < scene.count(); ++i) {
      double rotor[8], scale[4];
      for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(scene.rotor[8 * i + k]);
      for (size_t k = 0; k < 4; ++k) {
        scale[k] = std::exp(static_cast<double>(scene.log_scale[4 * i + k]));
      }
      const auto slice = slice_gaussian(normalized_halves(rotor), scale);
      // At the end of its visible time it is at the origin.
      const double mean = static_cast<double>(scene.mean_t[i]);
      const double end = std::min(scene.duration(), mean + 4 / std::sqrt(slice.lambda));
      for (size_t k = 0; k < 3; ++k) {
        scene.position[3 * i + k] =
            static_cast<float>(slice.velocity[k] * (reference_time(scene.timeline, mean) - end));
      }
    }
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_PAGE_SIZE, 64});
    o.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 256});
    const auto found = validate(encode(scene, o).bytes);
    for (size_t i = 0; i < found.size() && i < 3; ++i) {
      ADD_FAILURE() << found[i].clause << ": " << found[i].message;
    }
  }
}

// How far decoded Gaussians are from where they were and how they were seen.
struct SeenErrors {
  double place =
      0;  // length of the mean displacement over the times at which both are seen; mean of all
  double fade = 0;      // RMS difference of opacities over the sequence
  double min_fade = 0;  // the same, had each decoded Gaussian the opacity that suits it best
};

SeenErrors seen_errors(const TestScene& scene, const Encoded& e) {
  DecoderHandle d;
  d.open_memory(e.bytes.data(), e.bytes.size());
  const GaussianArrays a = d.decode(all_query());
  const auto slice_of = [](const float* rotor, const float* log_scale) {
    double r[8], s[4];
    for (size_t k = 0; k < 8; ++k) r[k] = static_cast<double>(rotor[k]);
    for (size_t k = 0; k < 4; ++k) s[k] = std::exp(static_cast<double>(log_scale[k]));
    return slice_gaussian(normalized_halves(r), s);
  };
  constexpr int kTimes = 1000;
  SeenErrors errors;
  for (size_t i = 0; i < a.count(); ++i) {
    const size_t from = e.order[i];
    const auto was = slice_of(scene.rotor.data() + 8 * from, scene.log_scale.data() + 4 * from);
    const auto is = slice_of(a.rotor.data() + 8 * i, a.log_scale.data() + 4 * i);
    const double mean = static_cast<double>(scene.mean_t[from]);
    const double decoded_mean = static_cast<double>(a.mean_t[i]);
    const double reference = reference_time(scene.timeline, mean);
    const double decoded_reference = reference_time(scene.timeline, decoded_mean);
    double weight = 0, shift[3] = {0, 0, 0};
    double theirs = 0, both = 0, own = 0;  // sums of squares and products of opacities
    for (int k = 0; k < kTimes; ++k) {
      const double t = scene.duration() * (k + 0.5) / kTimes;
      const double f = std::exp(-0.5 * was.lambda * (t - mean) * (t - mean));
      const double g = std::exp(-0.5 * is.lambda * (t - decoded_mean) * (t - decoded_mean));
      const double difference =
          static_cast<double>(scene.opacity[from]) * f - static_cast<double>(a.opacity[i]) * g;
      errors.fade += difference * difference;
      const double opacity = static_cast<double>(scene.opacity[from]) * f;
      theirs += opacity * opacity;
      both += opacity * g;
      own += g * g;
      weight += f * g;
      for (size_t axis = 0; axis < 3; ++axis) {
        shift[axis] +=
            f * g *
            (static_cast<double>(scene.position[3 * from + axis]) +
             was.velocity[axis] * (t - reference) - static_cast<double>(a.position[3 * i + axis]) -
             is.velocity[axis] * (t - decoded_reference));
      }
    }
    const double best = own > 0 ? std::min(both / own, 1.0) : 0;
    errors.min_fade += theirs - 2 * best * both + best * best * own;
    if (weight > 0) {
      errors.place += std::hypot(shift[0], shift[1], shift[2]) / weight;
    }
  }
  errors.place /= static_cast<double>(a.count());
  errors.fade = std::sqrt(errors.fade / kTimes / static_cast<double>(a.count()));
  errors.min_fade = std::sqrt(errors.min_fade / kTimes / static_cast<double>(a.count()));
  return errors;
}

TEST(ClosedLoop, PutsGaussiansInPlaceWhereAndWhenTheyAreSeen) {
  SceneOptions s;
  s.permanent = 0;
  s.outside = 0.5;
  const TestScene scene = make_scene(s);
  EncodeOptions o = small_options();
  o.settings.push_back({L4D_ENC_CLOSED_LOOP, 0});
  const SeenErrors open = seen_errors(scene, encode(scene, o));
  o.settings.push_back({L4D_ENC_CLOSED_LOOP, 1});
  const SeenErrors closed = seen_errors(scene, encode(scene, o));
  std::printf("open: place %g fade %g (%g); closed: place %g fade %g (%g)\n", open.place, open.fade,
              open.min_fade, closed.place, closed.fade, closed.min_fade);
  EXPECT_LT(closed.place, 0.2 * open.place);
  EXPECT_LT(closed.place, 0.01);
  EXPECT_LT(closed.fade, 0.9 * open.fade);
  // Of all opacities, those that suit the decoded mean times and scales.
  EXPECT_LT(closed.fade, 1.03 * closed.min_fade);
  EXPECT_GT(open.fade, 1.1 * open.min_fade);
}

TEST(Gauge, ChangesParametersButNotTheShape) {
  const TestScene scene = scene_of(500);
  for (int gauge = 0; gauge < 4; ++gauge) {
    SCOPED_TRACE("gauge " + std::to_string(gauge));
    EncodeOptions o = small_options();
    o.settings.push_back({L4D_ENC_GAUGE, static_cast<double>(gauge)});
    o.stages = {{L4D_ENC_STAGES, {1, 1, 1, 1}}};
    const Encoded e = encode(scene, o);
    const GaussianArrays a = decode(e.bytes, all_query());
    double volume_error = 0;
    size_t negative = 0, unsorted = 0;
    for (size_t i = 0; i < a.count(); ++i) {
      const float* l = a.log_scale.data() + 4 * i;
      const float* m = scene.log_scale.data() + 4 * size_t{e.order[i]};
      volume_error += std::fabs(static_cast<double>((l[0] + l[1] + l[2]) - (m[0] + m[1] + m[2])));
      negative += a.rotor[8 * i] < -0.05f;
      unsorted += l[0] + 0.3f < l[1] || l[1] + 0.3f < l[2];
    }
    EXPECT_LT(volume_error / 500, 0.2);
    if (gauge == 0) {
      EXPECT_GT(negative, 100u);  // as given
    } else {
      EXPECT_LT(negative, 25u);
    }
    if (gauge == 3) {
      EXPECT_LT(unsorted, 25u);
    } else {
      EXPECT_GT(unsorted, 100u);
    }
  }
}

TEST(Quality, MoreStagesAndCodewordsGiveLessError) {
  const TestScene scene = scene_of(3000);
  const auto sh_error = [&](const EncodeOptions& o) {
    const Encoded e = encode(scene, o);
    const GaussianArrays a = decode(e.bytes, all_query());
    double sum = 0;
    for (size_t i = 0; i < a.count(); ++i) {
      for (size_t k = 0; k < 12; ++k) {
        const double d = static_cast<double>(a.sh[12 * i + k]) -
                         static_cast<double>(scene.sh[12 * size_t{e.order[i]} + k]);
        sum += d * d;
      }
    }
    return sum;
  };
  EncodeOptions small = small_options();
  EncodeOptions codebooks = small_options();
  codebooks.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 256});
  EncodeOptions stages = small_options();
  stages.stages = {{L4D_ENC_STAGES, {1, 1, 1}}};
  const double base = sh_error(small);
  EXPECT_LT(sh_error(codebooks), 0.9 * base);
  EXPECT_LT(sh_error(stages), 0.8 * base);
}

// A scene whose shapes repeat is one for codebooks, one whose shapes do not is one for transforms.
TEST(Coding, IsWhicheverCostsLess) {
  for (const bool repeats : {false, true}) {
    SCOPED_TRACE(repeats ? "shapes repeat" : "shapes differ");
    TestScene scene = scene_of(4000);
    for (size_t i = 0; repeats && i < scene.count(); ++i) {
      const size_t like = i % 7;
      std::copy_n(scene.log_scale.data() + 4 * like, 3, scene.log_scale.data() + 4 * i);
      std::copy_n(scene.rotor.data() + 8 * like, 8, scene.rotor.data() + 8 * i);
      std::copy_n(scene.sh.data() + 12 * like, 12, scene.sh.data() + 12 * i);
    }
    const auto encoded = [&](int coding) {
      EncodeOptions o;
      o.rans = true;
      o.settings = {{L4D_ENC_CODING, static_cast<double>(coding)},
                    {L4D_ENC_CODEBOOKS_BY_COST, 1},
                    {L4D_ENC_QUALITY, 44},
                    {L4D_ENC_PRUNE_COST, 0},
                    {L4D_ENC_MAX_POSITION_ERROR, 0},
                    {L4D_ENC_MAX_COVARIANCE_FACTOR, 0},
                    {L4D_ENC_MAX_OPACITY_ERROR, 0}};
      return encode(scene, o).bytes;
    };
    const Bytes cheaper = encoded(2);
    DecoderHandle d;
    d.open_memory(cheaper.data(), cheaper.size());
    for (uint32_t l = 0; l < d.info().num_layers; ++l) {
      const l4d_layer_info layer = d.layer_info(l);
      // Scales have a number that does not repeat.
      for (const int c : {L4D_COMPONENT_SH, L4D_COMPONENT_ROTOR_SPATIAL}) {
        EXPECT_EQ(layer.codebook_size[c] > 0, repeats) << "layer " << l << " component " << c;
        EXPECT_EQ(layer.coding[c], repeats ? L4D_CODING_CODEBOOKS : L4D_CODING_TRANSFORM) << l;
        EXPECT_EQ(layer.num_coefficients[c] > 0, !repeats) << l;
      }
    }
    const size_t codebooks = encoded(0).size(), transforms = encoded(1).size();
    EXPECT_EQ(codebooks < transforms, repeats);
    EXPECT_LT(static_cast<double>(cheaper.size()),
              1.01 * static_cast<double>(std::min(codebooks, transforms)));
  }
}

// The seconds of the scene have shapes of their own.
TestScene scene_whose_times_differ() {
  SceneOptions s;
  s.count = 40000;
  s.sh_degree = 0;
  s.permanent = 0;
  s.outside = 0;
  s.num_frames = 8;
  TestScene scene = make_scene(s);
  for (size_t i = 0; i < scene.count(); ++i) {
    scene.log_scale[4 * i + 3] = static_cast<float>(std::log(scene.duration() / 40));
    // In each quarter 60 shapes that occur in no other.
    const double quarter = std::floor(4 * static_cast<double>(scene.mean_t[i]) / scene.duration());
    Random shape(static_cast<uint64_t>(quarter) * 1000 + i % 60);
    for (size_t k = 0; k < 3; ++k) {
      scene.log_scale[4 * i + k] = shape.uniformf(-7, -2) + 0.001f * static_cast<float>(i % 10);
    }
  }
  return scene;
}

// RCQ in a whole file, where it pays.
TEST(RcqFile, PaysInASceneWhoseTimesDiffer) {
  const TestScene scene = scene_whose_times_differ();
  EncodeOptions o;
  o.settings = {{L4D_ENC_CODEBOOK_SIZE, 64},
                {L4D_ENC_KMEANS_ITERATIONS, 4},
                {L4D_ENC_MERGE_COUNT, 100},
                {L4D_ENC_ZSTD_LEVEL, 1},
                {L4D_ENC_RCQ, 1},
                {L4D_ENC_RCQ_SIZE, 64}};
  const Encoded e = encode(scene, o);
  expect_valid(e.bytes);
  DecoderHandle d;
  d.open_memory(e.bytes.data(), e.bytes.size());
  EXPECT_NE(d.info().tools & L4D_TOOL_RCQ, 0u);
  EXPECT_TRUE(same_bits(decode(e.bytes, all_query(), L4D_BACKEND_REFERENCE),
                        decode(e.bytes, all_query(), L4D_BACKEND_CPU, 2)));
}

// The paper's own mode, on its own scheme: escapes above thresholds, blocks for the rest.
TEST(RcqFile, MeetsTheEscapesOfThePaper) {
  const TestScene scene = scene_whose_times_differ();
  std::vector<float> weights(scene.count());
  for (size_t i = 0; i < weights.size(); ++i) weights[i] = i % 16 == 0 ? 1e-5f : 1e-8f;
  EncodeOptions o;
  o.preset = "paper-small";
  o.settings = {{L4D_ENC_CODEBOOK_SIZE, 64},
                {L4D_ENC_KMEANS_ITERATIONS, 2},
                {L4D_ENC_MERGE_COUNT, 100},
                {L4D_ENC_PRUNE_WEIGHT, -1},
                {L4D_ENC_ZSTD_LEVEL, 1}};
  for (uint32_t w = L4D_WEIGHT_SH; w <= L4D_WEIGHT_ROTOR_TEMPORAL; ++w) {
    o.weights.emplace_back(w, &weights);
  }
  const Encoded e = encode(scene, o);
  expect_valid(e.bytes);
  DecoderHandle d;
  d.open_memory(e.bytes.data(), e.bytes.size());
  EXPECT_NE(d.info().tools & L4D_TOOL_RCQ, 0u);
  EXPECT_NE(d.info().tools & L4D_TOOL_ESCAPES, 0u);
  EXPECT_TRUE(same_bits(decode(e.bytes, all_query(), L4D_BACKEND_REFERENCE),
                        decode(e.bytes, all_query(), L4D_BACKEND_CPU, 2)));
}

}  // namespace
}  // namespace l4d
