// SPDX-License-Identifier: Apache-2.0
// The encoder finds what is wrong with its own streams before anyone gets a byte of them.
#include "encoder/file/written_check.h"

#include <gtest/gtest.h>

#include <cmath>

#include "encoder/component/codebook_coder.h"
#include "encoder/file/choose_header.h"
#include "encoder/file/file_builder.h"
#include "encoder/layer/color_bounds.h"
#include "encoder/layer/layer_coder.h"
#include "encoder/layer/sh_coder.h"
#include "encoder/plan/positions.h"
#include "encoder/prepare/quality.h"
#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

// What holds for good streams is found out in bad ones, wherever their pieces lie.
TEST(WrittenCheck, RefusesWhatADecoderRefuses) {
  const Bytes& good = transform_file();
  const auto cut = [](const Bytes& bytes) {
    std::vector<Bytes> pieces;
    for (size_t at = 0; at < bytes.size(); at += 1000) {
      pieces.emplace_back(
          bytes.begin() + static_cast<std::ptrdiff_t>(at),
          bytes.begin() + static_cast<std::ptrdiff_t>(std::min(at + 1000, bytes.size())));
    }
    return pieces;
  };
  const auto check = [](const std::vector<Bytes>& pieces) {
    return check_written(pieces, nullptr, 2);
  };
  EXPECT_TRUE(check(cut(good)).ok());
  EXPECT_TRUE(check({good}).ok());
  Bytes bad = good;
  bad[44] ^= 1;  // in the scene header
  const Status status = check(cut(bad));
  EXPECT_EQ(status.code(), L4D_ERR_INTERNAL);
  EXPECT_STREQ(status.clause(), "FILE-6");
  bad = good;
  bad.resize(bad.size() / 2);
  EXPECT_FALSE(check(cut(bad)).ok());
}

// A moving scene that is stored as it is, coded step by step.
struct Written {
  TestScene input;
  EncoderSettings settings;
  EncoderInput in;
  EncoderScene scene;
  CodedScene coded;
  SceneHeader header;

  Written() {
    SceneOptions s;
    s.count = 300;
    s.permanent = 0;
    s.outside = 0;
    input = make_scene(s);
    EXPECT_TRUE(settings.set_preset("default").ok());
    in.gaussians = input.view();
    in.timeline = input.timeline;
    in.placement.scale = 1;
    EXPECT_TRUE(prepare_scene(in, settings, 1, &scene).ok());
    CoderOptions options;
    options.settings = &settings;
    options.threads = 1;
    options.step = [](const char*) {};
    options.bounds = declared_bounds(scene, settings);
    const PositionPlan plan =
        plan_positions(scene, settings, Quality(settings, scene.count, 0), &options.bounds);
    coded.sh = code_sh(scene, options);
    std::vector<uint32_t> all(scene.count);
    for (uint32_t i = 0; i < all.size(); ++i) all[i] = i;
    coded.layers.push_back(code_escapes(scene, 0, false, all));
    CodedLayer& layer = coded.layers[0];
    layer.component[L4D_COMPONENT_SH] = codes_of(coded.sh, layer.gaussians, 1);
    GaussianErrors worst, stated;
    const ColorErrors colors = largest_color_errors(scene, coded.sh, 1);
    header = choose_header({in, scene, {}, plan, options.bounds, colors, false, 1}, coded, &worst,
                           &stated);
  }

  // What the check says if the encoder takes the layer for another one than it writes.
  Status check(const std::function<void(CodedLayer*)>& taken_for,
               const std::function<void(CodedLayer*)>& built_of) const {
    CodedScene built = coded, taken = coded;
    built_of(&built.layers[0]);
    taken_for(&taken.layers[0]);
    FileParts parts;
    EXPECT_TRUE(build_file(scene, settings, header, built, 1, &parts).ok());
    const ExpectedStream expected = {scene,          taken,         header,
                                     header.opacity, header.errors, parts.order};
    return check_written(parts.chunks, &expected, 2);
  }
};

// spec: ENC-2, DIR-10
TEST(WrittenCheck, RefusesBoxesThatGaussiansLeave) {
  const Written written;
  const auto nothing = [](CodedLayer*) {};
  EXPECT_TRUE(written.check(nothing, nothing).ok());
  EXPECT_STREQ(written
                   .check(nothing,
                          [](CodedLayer* layer) {
                            for (double& v : layer->decoded_velocity) v = 0;
                          })
                   .clause(),
               "DIR-10");
}

TEST(WrittenCheck, RefusesColoursFurtherOffThanIsStated) {
  const Written written;
  const Status status = written.check([](CodedLayer*) {},
                                      [&](CodedLayer* layer) {
                                        std::vector<uint32_t> others = layer->gaussians;
                                        std::reverse(others.begin(), others.end());
                                        layer->component[L4D_COMPONENT_SH] =
                                            codes_of(written.coded.sh, others, 1);
                                      });
  EXPECT_EQ(status.code(), L4D_ERR_INTERNAL);
  EXPECT_NE(status.message().find("a colour further off than is stated"), std::string::npos);
}

TEST(WrittenCheck, RefusesOtherNumbersThanErrorsAreStatedOf) {
  const Written written;
  const auto nothing = [](CodedLayer*) {};
  const std::function<void(CodedLayer*)> changes[] = {
      [](CodedLayer* layer) { layer->position[100] += 1; },
      [](CodedLayer* layer) { layer->decoded_mean_t[50] += 0.01; },
      [](CodedLayer* layer) { layer->opacity[7] = 1 - layer->opacity[7]; }};
  for (const auto& change : changes) {
    const Status status = written.check(change, nothing);
    EXPECT_EQ(status.code(), L4D_ERR_INTERNAL);
    EXPECT_NE(status.message().find("decodes to other numbers"), std::string::npos);
  }
}

TEST(WrittenCheck, RefusesLosslessStreamsOfOtherNumbersThanTheScenes) {
  SceneOptions s;
  s.count = 200;
  TestScene input = make_scene(s);
  const l4d_gaussians gaussians = input.view();
  const EncoderHandle e;
  e.check(l4d_encoder_set_preset(e.get(), "lossless"));
  e.check(l4d_encoder_set_scene(e.get(), &gaussians, &input.timeline, nullptr));
  const Bytes stream = e.encode();
  std::vector<uint32_t> order(s.count);
  e.check(l4d_encoder_get_order(e.get(), order.data(), order.size()));
  EncoderSettings settings;
  ASSERT_TRUE(settings.set_preset("lossless").ok());
  EncoderInput in;
  in.gaussians = gaussians;
  in.timeline = input.timeline;
  in.placement.scale = 1;
  EncoderScene scene;
  ASSERT_TRUE(prepare_scene(in, settings, 1, &scene).ok());
  const CodedScene none;
  const SceneHeader header;
  const ExpectedStream expected = {scene, none, header, header.opacity, header.errors, order, true};
  EXPECT_TRUE(check_written({stream}, &expected, 2).ok());
  for (std::vector<float>* values : {&input.position, &input.mean_t, &input.log_scale, &input.rotor,
                                     &input.opacity, &input.sh}) {
    float& value = values->at(values->size() / 2);
    const float before = value;
    value = std::nextafter(value, 9.0f);
    const Status status = check_written({stream}, &expected, 2);
    EXPECT_EQ(status.code(), L4D_ERR_INTERNAL);
    EXPECT_NE(status.message().find("decodes to other numbers"), std::string::npos);
    value = before;
  }
}

}  // namespace
}  // namespace l4d
