// SPDX-License-Identifier: Apache-2.0
#include "encoder/prepare/settings.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <string>

#include "l4d/l4d.hpp"

namespace l4d {
namespace {

l4d_encoder_parameter parameter(int id) { return static_cast<l4d_encoder_parameter>(id); }

l4d_parameter_info describe(int id) {
  l4d_parameter_info info;
  l4d_parameter_info_init(&info);
  EXPECT_EQ(l4d_encoder_parameter_info(parameter(id), &info), L4D_OK);
  return info;
}

TEST(Settings, EveryParameterIsDescribed) {
  std::set<std::string> names;
  for (int id = 0; id < L4D_ENC_PARAMETER_COUNT; ++id) {
    const l4d_parameter_info info = describe(id);
    ASSERT_NE(info.name, nullptr);
    ASSERT_NE(info.description, nullptr);
    EXPECT_TRUE(names.insert(info.name).second) << info.name << " twice";
    EXPECT_GT(std::string(info.description).size(), 10u);
    EXPECT_LT(info.min, info.max) << info.name;
  }
  l4d_parameter_info info;
  l4d_parameter_info_init(&info);
  EXPECT_EQ(l4d_encoder_parameter_info(parameter(63), &info), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_parameter_info(L4D_ENC_PARAMETER_COUNT, &info), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_parameter_info(L4D_ENC_RCQ, nullptr), L4D_ERR_INVALID_ARGUMENT);
}

TEST(Settings, RangesAreThoseOfTheHeader) {
  const auto range = [](int id) {
    const l4d_parameter_info i = describe(id);
    return std::pair<double, double>(i.min, i.max);
  };
  using R = std::pair<double, double>;
  EXPECT_EQ(range(L4D_ENC_CODEBOOK_SIZE), R(1, 65536));
  EXPECT_EQ(range(L4D_ENC_RCQ), R(0, 2));
  EXPECT_EQ(range(L4D_ENC_RCQ_SIZE), R(1, 4096));
  EXPECT_EQ(range(L4D_ENC_MERGE_FRACTION), R(0, 1));
  EXPECT_EQ(range(L4D_ENC_PAGE_SIZE), R(64, 65536));
  EXPECT_EQ(range(L4D_ENC_GAUGE), R(0, 3));
  EXPECT_EQ(range(L4D_ENC_OPACITY_BITS), R(0, 16));
  EXPECT_EQ(range(L4D_ENC_CODING), R(0, 2));
  EXPECT_EQ(range(L4D_ENC_QUALITY), R(20, 90));
  EXPECT_EQ(range(L4D_ENC_CODEBOOKS_BY_COST), R(0, 1));
  EXPECT_EQ(range(L4D_ENC_REFINE), R(0, 20));
  EXPECT_EQ(range(L4D_ENC_QUALITY_OFFSET), R(-30, 30));
  EXPECT_EQ(range(L4D_ENC_MEAN_T_SHIFT), R(-1, 10));
  EXPECT_EQ(range(L4D_ENC_PRUNE_COST), R(0, 10));
  EXPECT_EQ(range(L4D_ENC_WEIGHT_VIEWS), R(0, 2));
  EXPECT_EQ(range(L4D_ENC_SCALE_FACTOR_BITS), R(1, 16));
  EXPECT_EQ(range(L4D_ENC_KMEANS_ITERATIONS), R(0, 1000));
  EXPECT_EQ(range(L4D_ENC_KMEANS_SAMPLE), R(1, 1000000));
  EXPECT_EQ(range(L4D_ENC_ZSTD_LEVEL), R(1, 22));
  for (const int id : {L4D_ENC_LOSSLESS, L4D_ENC_CLOSED_LOOP, L4D_ENC_DROP_INVALID}) {
    EXPECT_EQ(range(id), R(0, 1));
  }
}

TEST(Settings, ValuesAreSetWithinTheirRangesOnly) {
  const EncoderHandle e;
  for (int id = 0; id < L4D_ENC_PARAMETER_COUNT; ++id) {
    const l4d_parameter_info info = describe(id);
    SCOPED_TRACE(info.name);
    const auto set = [&](double v) {
      return l4d_encoder_set(e.get(), parameter(id), L4D_ALL_COMPONENTS, v);
    };
    const auto get = [&](int32_t component) {
      double v = -99;
      EXPECT_EQ(l4d_encoder_get(e.get(), parameter(id), component, &v), L4D_OK);
      return v;
    };
    for (const double v : {info.min, info.max}) {
      EXPECT_EQ(set(v), L4D_OK);
      for (int32_t c = L4D_ALL_COMPONENTS; c < L4D_COMPONENT_COUNT; ++c) EXPECT_EQ(get(c), v);
    }
    const double kept = get(0);
    const double inf = std::numeric_limits<double>::infinity();
    for (const double v : {std::nextafter(info.min, -inf), std::nextafter(info.max, inf), -inf, inf,
                           std::numeric_limits<double>::quiet_NaN()}) {
      EXPECT_EQ(set(v), L4D_ERR_INVALID_ARGUMENT) << v;
      EXPECT_NE(std::string(l4d_encoder_error_message(e.get())).find(info.name), std::string::npos);
      EXPECT_EQ(get(0), kept);
    }
    EXPECT_EQ(set(0.5 * (info.min + info.min + 1)),
              info.integer != 0 || info.min + 0.5 > info.max ? L4D_ERR_INVALID_ARGUMENT : L4D_OK);
    // One component alone, where there are components.
    EXPECT_EQ(set(info.min), L4D_OK);
    const l4d_status one = l4d_encoder_set(e.get(), parameter(id), L4D_COMPONENT_SCALE, info.max);
    EXPECT_EQ(one, info.per_component != 0 ? L4D_OK : L4D_ERR_INVALID_ARGUMENT);
    EXPECT_EQ(get(L4D_COMPONENT_SH), info.min);
    EXPECT_EQ(get(L4D_COMPONENT_SCALE), info.per_component != 0 ? info.max : info.min);
  }
  double v = 0;
  EXPECT_EQ(l4d_encoder_set(e.get(), parameter(63), -1, 0), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_set(e.get(), L4D_ENC_PARAMETER_COUNT, -1, 0), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_set(e.get(), L4D_ENC_CODEBOOK_SIZE, 4, 8), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_set(e.get(), L4D_ENC_CODEBOOK_SIZE, -2, 8), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_get(e.get(), L4D_ENC_PARAMETER_COUNT, 0, &v), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_get(e.get(), L4D_ENC_RCQ, 4, &v), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_get(e.get(), L4D_ENC_RCQ, 0, nullptr), L4D_ERR_INVALID_ARGUMENT);
}

TEST(Settings, PresetsReplaceEverything) {
  std::set<std::string> names;
  for (uint32_t i = 0; l4d_encoder_preset_name(i) != nullptr; ++i) {
    names.insert(l4d_encoder_preset_name(i));
    EXPECT_NE(l4d_encoder_preset_description(i), nullptr);
    const EncoderHandle e;
    EXPECT_EQ(l4d_encoder_set_preset(e.get(), l4d_encoder_preset_name(i)), L4D_OK);
  }
  EXPECT_EQ(names, (std::set<std::string>{"default", "tiny", "small", "large", "archive", "indexed",
                                          "indexed-small", "indexed-high", "paper-small",
                                          "paper-large", "lossless"}));
  EXPECT_EQ(l4d_encoder_preset_description(11), nullptr);

  EncoderSettings s;
  ASSERT_TRUE(s.set_preset("lossless").ok());
  EXPECT_TRUE(s.get_bool(L4D_ENC_LOSSLESS));
  ASSERT_TRUE(s.set(L4D_ENC_PAGE_SIZE, L4D_ALL_COMPONENTS, 64).ok());
  ASSERT_TRUE(s.set_preset("indexed-high").ok());
  EXPECT_FALSE(s.get_bool(L4D_ENC_LOSSLESS));
  EXPECT_EQ(s.get(L4D_ENC_PAGE_SIZE), EncoderSettings().get(L4D_ENC_PAGE_SIZE));
  double indexed_quality = 0;
  for (const char* name : {"indexed-small", "indexed", "indexed-high"}) {
    ASSERT_TRUE(s.set_preset(name).ok());
    for (int c = 0; c < L4D_COMPONENT_COUNT; ++c) EXPECT_EQ(s.get(L4D_ENC_CODING, c), 0);
    EXPECT_TRUE(s.get_bool(L4D_ENC_CODEBOOKS_BY_COST));
    EXPECT_TRUE(s.codes_fixed_positions());
    // Players of indices take binary16.
    ASSERT_TRUE(s.set(L4D_ENC_PROFILE, L4D_ALL_COMPONENTS, L4D_PROFILE_INDEXED).ok());
    EXPECT_FALSE(s.codes_fixed_positions());
    EXPECT_TRUE(s.check_profile().ok());
    EXPECT_GT(s.get(L4D_ENC_QUALITY), indexed_quality) << name;
    indexed_quality = s.get(L4D_ENC_QUALITY);
  }
  // Who says how many stages there are leaves the choice to no one.
  ASSERT_TRUE(s.set_stages(L4D_COMPONENT_SH, {1.0f, 0.5f}).ok());
  EXPECT_FALSE(s.get_bool(L4D_ENC_CODEBOOKS_BY_COST));
  ASSERT_TRUE(s.set_preset("indexed").ok());
  ASSERT_TRUE(s.set(L4D_ENC_ESCAPE_THRESHOLD, L4D_COMPONENT_SCALE, 1e-6).ok());
  EXPECT_FALSE(s.get_bool(L4D_ENC_CODEBOOKS_BY_COST));
  ASSERT_TRUE(s.set_preset("default").ok());
  for (int id = 0; id < L4D_ENC_PARAMETER_COUNT; ++id) {
    EXPECT_EQ(s.get(parameter(id)), describe_parameter(parameter(id)).initial);
  }
  double quality = 0;
  for (const char* name : {"tiny", "small", "large", "archive"}) {
    ASSERT_TRUE(s.set_preset(name).ok());
    EXPECT_EQ(s.get(L4D_ENC_CODING), 1);
    EXPECT_GT(s.get(L4D_ENC_QUALITY), quality) << name;
    quality = s.get(L4D_ENC_QUALITY);
  }
  // The paper's settings, appendix "Compression".
  ASSERT_TRUE(s.set_preset("paper-large").ok());
  EXPECT_EQ(s.get(L4D_ENC_CODEBOOK_SIZE, L4D_COMPONENT_SH), 8192);
  EXPECT_EQ(s.get(L4D_ENC_ESCAPE_THRESHOLD, L4D_COMPONENT_SH), 1e-7);
  EXPECT_EQ(s.get(L4D_ENC_RCQ_SIZE), 512);
  EXPECT_EQ(s.get(L4D_ENC_PRUNE_WEIGHT), 0);
  ASSERT_TRUE(s.set_preset("paper-small").ok());
  EXPECT_EQ(s.get(L4D_ENC_CODEBOOK_SIZE, L4D_COMPONENT_SH), 4096);
  EXPECT_EQ(s.get(L4D_ENC_ESCAPE_THRESHOLD, L4D_COMPONENT_SH), 6e-7);
  EXPECT_EQ(s.get(L4D_ENC_ESCAPE_THRESHOLD, L4D_COMPONENT_SCALE), 2e-7);
  EXPECT_EQ(s.get(L4D_ENC_ESCAPE_THRESHOLD, L4D_COMPONENT_ROTOR_SPATIAL), 1e-6);
  EXPECT_EQ(s.get(L4D_ENC_ESCAPE_THRESHOLD, L4D_COMPONENT_ROTOR_TEMPORAL), 8e-6);

  // Effort sets how hard k-means and zstd try, and each step tries no less hard than the one
  // before.
  ASSERT_TRUE(s.set_preset("indexed").ok());
  for (int effort = 2; effort <= 9; ++effort) {
    EncoderSettings less;
    ASSERT_TRUE(less.set(L4D_ENC_EFFORT, L4D_ALL_COMPONENTS, effort - 1).ok());
    ASSERT_TRUE(s.set(L4D_ENC_EFFORT, L4D_ALL_COMPONENTS, effort).ok());
    for (const int id : {L4D_ENC_KMEANS_ITERATIONS, L4D_ENC_KMEANS_SAMPLE, L4D_ENC_ZSTD_LEVEL}) {
      EXPECT_GE(s.get(parameter(id)), less.get(parameter(id))) << "effort " << effort;
    }
  }
  ASSERT_TRUE(
      s.set(L4D_ENC_EFFORT, L4D_ALL_COMPONENTS, describe_parameter(L4D_ENC_EFFORT).initial).ok());
  for (const int id : {L4D_ENC_KMEANS_ITERATIONS, L4D_ENC_KMEANS_SAMPLE, L4D_ENC_ZSTD_LEVEL}) {
    EXPECT_EQ(s.get(parameter(id)), describe_parameter(parameter(id)).initial);
  }
  const Status unknown = s.set_preset("fastest");
  EXPECT_EQ(unknown.code(), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_NE(unknown.message().find("fastest"), std::string::npos);
}

TEST(Settings, StagesAreChecked) {
  const EncoderHandle e;
  const auto set = [&](int32_t component, const std::vector<float>& f) {
    return l4d_encoder_set_stages(e.get(), component, static_cast<uint32_t>(f.size()), f.data());
  };
  EXPECT_EQ(set(L4D_ALL_COMPONENTS, {1}), L4D_OK);
  EXPECT_EQ(set(L4D_COMPONENT_SH, {1, 1, 0.5f, 0.5f, 0.1f, 0, 0, 0}), L4D_OK);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<float> kWrong[] = {
      {},        {0.5f},   {1, 0.2f, 0.3f}, {1, -0.1f},
      {1, 1.5f}, {1, nan}, {nan},           {1, 1, 1, 1, 1, 1, 1, 1, 1}};
  for (const auto& wrong : kWrong) EXPECT_EQ(set(0, wrong), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(set(4, {1}), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(set(-2, {1}), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_EQ(l4d_encoder_set_stages(e.get(), 0, 1, nullptr), L4D_ERR_INVALID_ARGUMENT);
}

// A file of few bytes keeps no fine colours.
TEST(Settings, BoundsOfColoursFollowAQualityBelowThePreset) {
  EncoderSettings s;
  ASSERT_TRUE(s.set_preset("default").ok());
  EXPECT_EQ(s.color_bound(L4D_ENC_MAX_BASE_COLOR_ERROR), 0.05);
  ASSERT_TRUE(s.set(L4D_ENC_QUALITY, L4D_ALL_COMPONENTS, 50).ok());
  EXPECT_EQ(s.color_bound(L4D_ENC_MAX_BASE_COLOR_ERROR), 0.05);
  ASSERT_TRUE(s.set(L4D_ENC_QUALITY, L4D_ALL_COMPONENTS, 24).ok());
  EXPECT_NEAR(s.color_bound(L4D_ENC_MAX_BASE_COLOR_ERROR), 0.5, 1e-12);
  EXPECT_NEAR(s.color_bound(L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR), 5, 1e-12);
  ASSERT_TRUE(s.set(L4D_ENC_MAX_BASE_COLOR_ERROR, L4D_ALL_COMPONENTS, 0.02).ok());
  EXPECT_EQ(s.color_bound(L4D_ENC_MAX_BASE_COLOR_ERROR), 0.02);
}

}  // namespace
}  // namespace l4d
