// SPDX-License-Identifier: Apache-2.0
#include "encoder/prepare/settings.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "l4d/experimental/parameters.h"
#include "l4d/l4d.hpp"

namespace l4d {
namespace {

constexpr l4d_status kInvalid = L4D_ERR_INVALID_ARGUMENT;

std::vector<l4d_parameter_info> all_parameters() {
  std::vector<l4d_parameter_info> all;
  l4d_parameter_info info = L4D_INIT(l4d_parameter_info);
  while (l4d_encoder_parameter_info(static_cast<uint32_t>(all.size()), &info) == L4D_OK) {
    all.push_back(info);
  }
  return all;
}

TEST(Settings, EveryParameterIsDescribed) {
  std::set<std::string> names;
  const std::vector<l4d_parameter_info> all = all_parameters();
  EXPECT_EQ(all.size(), kNumNumbers + 2);
  bool stable = true;
  for (const l4d_parameter_info& info : all) {
    ASSERT_NE(info.name, nullptr);
    ASSERT_NE(info.description, nullptr);
    ASSERT_NE(info.unit, nullptr);
    EXPECT_TRUE(names.insert(info.name).second) << info.name << " twice";
    EXPECT_GT(std::string(info.description).size(), 10u);
    EXPECT_LT(info.min, info.max) << info.name;
    EXPECT_GE(info.initial, info.min) << info.name;
    EXPECT_LE(info.initial, info.max) << info.name;
    const bool is_list = info.max_values > 1;
    EXPECT_TRUE(stable || is_list || info.stable == 0) << info.name << " is not with the stable";
    stable = info.stable != 0;
  }
  // The macros of the headers are names of the table.
  for (const char* name : {L4D_ENC_LOSSLESS,
                           L4D_ENC_QUALITY,
                           L4D_ENC_EFFORT,
                           L4D_ENC_MAX_POSITION_ERROR,
                           L4D_ENC_MAX_COVARIANCE_FACTOR,
                           L4D_ENC_MAX_OPACITY_ERROR,
                           L4D_ENC_MAX_VISIBLE_ERROR,
                           L4D_ENC_MAX_BASE_COLOR_ERROR,
                           L4D_ENC_MAX_DIRECTIONAL_COLOR_ERROR,
                           L4D_ENC_DROP_INVALID,
                           L4D_ENC_PRUNE_WEIGHT,
                           L4D_ENC_PRUNE_COST,
                           L4D_ENC_PAGE_SIZE,
                           L4D_ENC_PROFILE,
                           L4D_ENC_LEVEL,
                           L4D_ENC_TIERS,
                           L4D_ENC_CODING,
                           L4D_ENC_QUALITY_OFFSET,
                           L4D_ENC_POSITION_OFFSET,
                           L4D_ENC_FIXED_POSITIONS,
                           L4D_ENC_MEAN_T_SHIFT,
                           L4D_ENC_OPACITY_BITS,
                           L4D_ENC_SCALE_FACTOR_BITS,
                           L4D_ENC_RANS,
                           L4D_ENC_ZSTD_LEVEL,
                           L4D_ENC_CLOSED_LOOP,
                           L4D_ENC_GAUGE,
                           L4D_ENC_MERGE_FRACTION,
                           L4D_ENC_MERGE_COUNT,
                           L4D_ENC_CODEBOOK_SIZE,
                           L4D_ENC_ESCAPE_THRESHOLD,
                           L4D_ENC_RCQ,
                           L4D_ENC_RCQ_SIZE,
                           L4D_ENC_CODEBOOKS_BY_COST,
                           L4D_ENC_REFINE,
                           L4D_ENC_KMEANS_ITERATIONS,
                           L4D_ENC_KMEANS_SAMPLE,
                           L4D_ENC_STAGES}) {
    EXPECT_EQ(names.erase(name), 1u) << name;
  }
  EXPECT_TRUE(names.empty()) << *names.begin() << " has no macro";
  l4d_parameter_info info = L4D_INIT(l4d_parameter_info);
  EXPECT_EQ(l4d_encoder_parameter_info(UINT32_MAX, &info), kInvalid);
  EXPECT_EQ(l4d_encoder_parameter_info(0, nullptr), kInvalid);
}

TEST(Settings, RangesAreThoseOfTheHeader) {
  const auto range = [](const std::string& name) {
    for (const l4d_parameter_info& i : all_parameters()) {
      if (i.name == name) return std::pair<double, double>(i.min, i.max);
    }
    return std::pair<double, double>(0, 0);
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
  EXPECT_EQ(range(L4D_ENC_SCALE_FACTOR_BITS), R(1, 16));
  EXPECT_EQ(range(L4D_ENC_KMEANS_ITERATIONS), R(0, 1000));
  EXPECT_EQ(range(L4D_ENC_KMEANS_SAMPLE), R(1, 1000000));
  EXPECT_EQ(range(L4D_ENC_ZSTD_LEVEL), R(1, 22));
  for (const char* name : {L4D_ENC_LOSSLESS, L4D_ENC_CLOSED_LOOP, L4D_ENC_DROP_INVALID}) {
    EXPECT_EQ(range(name), R(0, 1));
  }
}

TEST(Settings, ValuesAreSetWithinTheirRangesOnly) {
  const EncoderHandle e;
  for (const l4d_parameter_info& info : all_parameters()) {
    if (info.max_values > 1) continue;
    SCOPED_TRACE(info.name);
    const std::string name = info.name;
    const auto set = [&](double v) { return l4d_encoder_set(e.get(), info.name, v); };
    const auto get = [&](const std::string& of) {
      double v = -99;
      EXPECT_EQ(l4d_encoder_get(e.get(), of.c_str(), &v), L4D_OK);
      return v;
    };
    EXPECT_EQ(get(name), info.initial);
    for (const double v : {info.min, info.max}) {
      EXPECT_EQ(set(v), L4D_OK);
      EXPECT_EQ(get(name), v);
      if (info.per_component == 0) continue;
      for (const char* c : {".sh", ".scale", ".rotor-spatial", ".rotor-temporal"}) {
        EXPECT_EQ(get(name + c), v);
      }
    }
    const double kept = get(name);
    const double inf = std::numeric_limits<double>::infinity();
    for (const double v : {std::nextafter(info.min, -inf), std::nextafter(info.max, inf), -inf, inf,
                           std::numeric_limits<double>::quiet_NaN()}) {
      EXPECT_EQ(set(v), kInvalid) << v;
      EXPECT_NE(std::string(l4d_last_error_message()).find(info.name), std::string::npos);
      EXPECT_EQ(get(name), kept);
    }
    EXPECT_EQ(set(0.5 * (info.min + info.min + 1)),
              info.integer != 0 || info.min + 0.5 > info.max ? kInvalid : L4D_OK);
    // One component alone, where there are components.
    EXPECT_EQ(set(info.min), L4D_OK);
    const l4d_status one = l4d_encoder_set(e.get(), (name + ".scale").c_str(), info.max);
    EXPECT_EQ(one, info.per_component != 0 ? L4D_OK : kInvalid);
    EXPECT_EQ(get(name), info.min);
    if (info.per_component != 0) {
      EXPECT_EQ(get(name + ".scale"), info.max);
    }
    // A later parameter may set an earlier one.
    EXPECT_EQ(l4d_encoder_set_preset(e.get(), "default"), L4D_OK);
  }
  double v = 0;
  for (const char* name : {"", ".", ".sh", "rcq.sh", "rcq.", "codebook-size.", "codebook-size.SH",
                           "codebook-size.sh.sh", "Quality", "quality ", "tiers", "stages.sh"}) {
    EXPECT_EQ(l4d_encoder_set(e.get(), name, 1), kInvalid) << name;
    EXPECT_EQ(l4d_encoder_get(e.get(), name, &v), kInvalid) << name;
  }
  EXPECT_EQ(l4d_encoder_set(e.get(), nullptr, 1), kInvalid);
  EXPECT_EQ(l4d_encoder_get(e.get(), nullptr, &v), kInvalid);
  EXPECT_EQ(l4d_encoder_get(e.get(), L4D_ENC_RCQ, nullptr), kInvalid);
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
  EXPECT_TRUE(s.get_bool(Parameter::kLossless));
  ASSERT_TRUE(s.set(Parameter::kPageSize, kAllComponents, 64).ok());
  ASSERT_TRUE(s.set_preset("indexed-high").ok());
  EXPECT_FALSE(s.get_bool(Parameter::kLossless));
  EXPECT_EQ(s.get(Parameter::kPageSize), EncoderSettings().get(Parameter::kPageSize));
  double indexed_quality = 0;
  for (const char* name : {"indexed-small", "indexed", "indexed-high"}) {
    ASSERT_TRUE(s.set_preset(name).ok());
    for (int c = 0; c < L4D_COMPONENT_COUNT; ++c) EXPECT_EQ(s.get(Parameter::kCoding, c), 0);
    EXPECT_TRUE(s.get_bool(Parameter::kCodebooksByCost));
    EXPECT_TRUE(s.codes_fixed_positions());
    // Players of indices take binary16.
    ASSERT_TRUE(s.set(Parameter::kProfile, kAllComponents, L4D_PROFILE_INDEXED).ok());
    EXPECT_FALSE(s.codes_fixed_positions());
    EXPECT_TRUE(s.check_profile().ok());
    EXPECT_GT(s.get(Parameter::kQuality), indexed_quality) << name;
    indexed_quality = s.get(Parameter::kQuality);
  }
  // Who says how many stages there are leaves the choice to no one.
  ASSERT_TRUE(s.set_stages(L4D_COMPONENT_SH, {1.0f, 0.5f}).ok());
  EXPECT_FALSE(s.get_bool(Parameter::kCodebooksByCost));
  ASSERT_TRUE(s.set_preset("indexed").ok());
  ASSERT_TRUE(s.set(Parameter::kEscapeThreshold, L4D_COMPONENT_SCALE, 1e-6).ok());
  EXPECT_FALSE(s.get_bool(Parameter::kCodebooksByCost));
  ASSERT_TRUE(s.set_preset("default").ok());
  for (size_t id = 0; id < kNumNumbers; ++id) {
    EXPECT_EQ(s.get(static_cast<Parameter>(id)),
              describe_parameter(static_cast<Parameter>(id)).initial);
  }
  double quality = 0;
  for (const char* name : {"tiny", "small", "large", "archive"}) {
    ASSERT_TRUE(s.set_preset(name).ok());
    EXPECT_EQ(s.get(Parameter::kCoding), 1);
    EXPECT_GT(s.get(Parameter::kQuality), quality) << name;
    quality = s.get(Parameter::kQuality);
  }
  // The paper's settings, appendix "Compression".
  ASSERT_TRUE(s.set_preset("paper-large").ok());
  EXPECT_EQ(s.get(Parameter::kCodebookSize, L4D_COMPONENT_SH), 8192);
  EXPECT_EQ(s.get(Parameter::kEscapeThreshold, L4D_COMPONENT_SH), 1e-7);
  EXPECT_EQ(s.get(Parameter::kRcqSize), 512);
  EXPECT_EQ(s.get(Parameter::kPruneWeight), 0);
  ASSERT_TRUE(s.set_preset("paper-small").ok());
  EXPECT_EQ(s.get(Parameter::kCodebookSize, L4D_COMPONENT_SH), 4096);
  EXPECT_EQ(s.get(Parameter::kEscapeThreshold, L4D_COMPONENT_SH), 6e-7);
  EXPECT_EQ(s.get(Parameter::kEscapeThreshold, L4D_COMPONENT_SCALE), 2e-7);
  EXPECT_EQ(s.get(Parameter::kEscapeThreshold, L4D_COMPONENT_ROTOR_SPATIAL), 1e-6);
  EXPECT_EQ(s.get(Parameter::kEscapeThreshold, L4D_COMPONENT_ROTOR_TEMPORAL), 8e-6);

  // Effort sets how hard k-means and zstd try, and each step tries no less hard than the one
  // before.
  ASSERT_TRUE(s.set_preset("indexed").ok());
  for (int effort = 2; effort <= 9; ++effort) {
    EncoderSettings less;
    ASSERT_TRUE(less.set(Parameter::kEffort, kAllComponents, effort - 1).ok());
    ASSERT_TRUE(s.set(Parameter::kEffort, kAllComponents, effort).ok());
    for (const Parameter id :
         {Parameter::kKmeansIterations, Parameter::kKmeansSample, Parameter::kZstdLevel}) {
      EXPECT_GE(s.get(id), less.get(id)) << "effort " << effort;
    }
  }
  ASSERT_TRUE(
      s.set(Parameter::kEffort, kAllComponents, describe_parameter(Parameter::kEffort).initial)
          .ok());
  for (const Parameter id :
       {Parameter::kKmeansIterations, Parameter::kKmeansSample, Parameter::kZstdLevel}) {
    EXPECT_EQ(s.get(id), describe_parameter(id).initial);
  }
  const Status unknown = s.set_preset("fastest");
  EXPECT_EQ(unknown.code(), L4D_ERR_INVALID_ARGUMENT);
  EXPECT_NE(unknown.message().find("fastest"), std::string::npos);
}

TEST(Settings, StagesAreChecked) {
  const EncoderHandle e;
  const auto set = [&](const char* name, const std::vector<double>& f) {
    return l4d_encoder_set_list(e.get(), name, f.data(), static_cast<uint32_t>(f.size()));
  };
  EXPECT_EQ(set(L4D_ENC_STAGES, {1}), L4D_OK);
  EXPECT_EQ(set(L4D_ENC_STAGES ".sh", {1, 1, 0.5, 0.5, 0.1, 0, 0, 0}), L4D_OK);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<double> kWrong[] = {
      {}, {0.5}, {1, 0.2, 0.3}, {1, -0.1}, {1, 1.5}, {1, nan}, {nan}, {1, 1, 1, 1, 1, 1, 1, 1, 1}};
  for (const auto& wrong : kWrong) EXPECT_EQ(set(L4D_ENC_STAGES ".sh", wrong), kInvalid);
  EXPECT_EQ(set(L4D_ENC_STAGES ".colour", {1}), kInvalid);
  EXPECT_EQ(set(L4D_ENC_TIERS ".sh", {0.5}), kInvalid);
  EXPECT_EQ(set(L4D_ENC_QUALITY, {40}), kInvalid);
  EXPECT_EQ(l4d_encoder_set_list(e.get(), L4D_ENC_STAGES, nullptr, 1), kInvalid);
}

// A file of few bytes keeps no fine colours.
TEST(Settings, BoundsOfColoursFollowAQualityBelowThePreset) {
  EncoderSettings s;
  ASSERT_TRUE(s.set_preset("default").ok());
  EXPECT_EQ(s.color_bound(Parameter::kMaxBaseColorError), 0.05);
  ASSERT_TRUE(s.set(Parameter::kQuality, kAllComponents, 50).ok());
  EXPECT_EQ(s.color_bound(Parameter::kMaxBaseColorError), 0.05);
  ASSERT_TRUE(s.set(Parameter::kQuality, kAllComponents, 24).ok());
  EXPECT_NEAR(s.color_bound(Parameter::kMaxBaseColorError), 0.5, 1e-12);
  EXPECT_NEAR(s.color_bound(Parameter::kMaxDirectionalColorError), 5, 1e-12);
  ASSERT_TRUE(s.set(Parameter::kMaxBaseColorError, kAllComponents, 0.02).ok());
  EXPECT_EQ(s.color_bound(Parameter::kMaxBaseColorError), 0.02);
}

}  // namespace
}  // namespace l4d
