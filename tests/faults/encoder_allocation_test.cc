// SPDX-License-Identifier: Apache-2.0
// Memory that runs out at any allocation of an encoder.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <functional>
#include <iterator>

#include "tests/common/codec.h"
#include "tests/faults/failing_new.h"

namespace l4d {
namespace {

using namespace test;

// A writer that compares, and so allocates nothing.
struct Comparison {
  const Bytes* want;
  size_t at = 0;
  bool equal = true;
  l4d_writer writer() {
    l4d_writer w = L4D_INIT(l4d_writer);
    w.user = this;
    w.write = [](void* user, const void* src, size_t n) -> int {
      Comparison& self = *static_cast<Comparison*>(user);
      self.equal = self.equal && n <= self.want->size() - self.at &&
                   std::equal(static_cast<const unsigned char*>(src),
                              static_cast<const unsigned char*>(src) + n,
                              self.want->begin() + static_cast<std::ptrdiff_t>(self.at));
      self.at += n;
      return 0;
    };
    return w;
  }
  bool done() const { return equal && at == want->size(); }
};

struct Case {
  const char* name;
  const char* preset;
  uint64_t count;
  uint32_t threads;
};

class EncoderAllocations : public testing::TestWithParam<Case> {};

TEST_P(EncoderAllocations, EncodingSurvivesEachFailure) {
  const Case& c = GetParam();
  SceneOptions s;
  s.count = c.count;
  s.sh_degree = 0;
  s.num_frames = 4;
  const TestScene scene = make_scene(s);
  EncodeOptions options = small_options();
  options.preset = c.preset;
  if (std::string(c.preset) == "lossless") {
    options.settings = {{L4D_ENC_MERGE_COUNT, 3}, {L4D_ENC_ZSTD_LEVEL, 1}};
  } else {
    options.settings.push_back({L4D_ENC_CODEBOOK_SIZE, 2});
    options.settings.push_back({L4D_ENC_MERGE_COUNT, 3});
    options.settings.push_back({L4D_ENC_ZSTD_LEVEL, 1});
    options.settings.push_back({L4D_ENC_RCQ, 2});
    options.settings.push_back({L4D_ENC_RCQ_SIZE, 2});
    options.stages = {{L4D_ENC_STAGES, {1.0f, 0.5f}}};
  }
  options.threads = c.threads;
  const Bytes want = encode(scene, options).bytes;

  l4d_encoder_options o = L4D_INIT(l4d_encoder_options);
  o.threads = c.threads;
  const EncoderHandle e(&o);
  prepare_encoder(scene, options, e);
  uint64_t allocations = 0;
  for (int run = 0; run < 2; ++run) {
    Comparison comparison{&want};
    const l4d_writer writer = comparison.writer();
    AllocationFaults count;
    ASSERT_EQ(l4d_encoder_encode(e.get(), &writer), L4D_OK);
    count.stop();
    ASSERT_TRUE(comparison.done());
    allocations = count.count();
  }
  const int64_t live = live_allocations();
  uint64_t tried = 0, refused = 0;
  const uint64_t stride = allocations <= 20000 ? 1 : 97;
  for (uint64_t k = 1; k <= allocations; k += k <= 2000 ? 1 : stride) {
    Comparison comparison{&want};
    l4d_writer writer = comparison.writer();
    ++tried;
    AllocationFaults faults(k, k);
    const l4d_status status = l4d_encoder_encode(e.get(), &writer);
    faults.stop();
    ASSERT_TRUE(faults.failed() == 1 || c.threads > 1) << "allocation " << k;
    if (status == L4D_OK) {
      ASSERT_TRUE(comparison.done()) << "allocation " << k;
    } else {
      ASSERT_EQ(status, L4D_ERR_OUT_OF_MEMORY) << "allocation " << k;
      ++refused;
      ASSERT_STRNE(l4d_last_error_message(), "");
    }
    // Every now and then: that the handle still works. Each is one encode more.
    if (k % 16 == 0) {
      Comparison again{&want};
      writer = again.writer();
      ASSERT_EQ(l4d_encoder_encode(e.get(), &writer), L4D_OK) << "allocation " << k;
      ASSERT_TRUE(again.done()) << "allocation " << k;
      // An error message and its text may stay; a report is as large as the one before.
      ASSERT_EQ(live_allocations(), live) << "allocation " << k;
    }
  }
  std::printf("%s: %llu allocations in an encode, %llu of them failed, %llu encodes refused\n",
              c.name, static_cast<unsigned long long>(allocations),
              static_cast<unsigned long long>(tried), static_cast<unsigned long long>(refused));
  EXPECT_GT(refused, 0u);
  Comparison again{&want};
  const l4d_writer writer = again.writer();
  ASSERT_EQ(l4d_encoder_encode(e.get(), &writer), L4D_OK);
  EXPECT_TRUE(again.done());
}

INSTANTIATE_TEST_SUITE_P(Presets, EncoderAllocations,
                         testing::Values(Case{"lossy", "default", 12, 1},
                                         Case{"lossless", "lossless", 12, 1},
                                         Case{"threads", "default", 40, 3}),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(EncoderAllocation, CreatingAndDestroyingLeaksNothing) {
  for (uint64_t k = 1;; ++k) {
    const int64_t live = live_allocations();
    l4d_encoder* e = nullptr;
    AllocationFaults faults(k, k);
    const l4d_status status = l4d_encoder_create(nullptr, &e);
    faults.stop();
    l4d_encoder_destroy(e);
    EXPECT_EQ(live_allocations(), live);
    if (faults.failed() == 0) {
      EXPECT_EQ(status, L4D_OK);
      return;
    }
    EXPECT_EQ(status, L4D_ERR_OUT_OF_MEMORY);
    EXPECT_EQ(e, nullptr);
  }
}

// Setting parameters, scene and metadata: a failed call changes nothing.
TEST(EncoderAllocation, SettingFailsCleanly) {
  SceneOptions s;
  s.count = 12;
  s.sh_degree = 0;
  const TestScene scene = make_scene(s);
  const l4d_gaussians view = scene.view();
  const double fractions[] = {1, 0.5, 0.25};
  const std::string long_text(200, 'x');
  const std::function<l4d_status(l4d_encoder*)> steps[] = {
      [](l4d_encoder* e) { return l4d_encoder_set_preset(e, "default"); },
      [](l4d_encoder* e) { return l4d_encoder_set(e, L4D_ENC_CODEBOOK_SIZE, 2); },
      [&](l4d_encoder* e) {
        return l4d_encoder_set_list(e, L4D_ENC_STAGES ".scale", fractions, 3);
      },
      [&](l4d_encoder* e) { return l4d_encoder_set_scene(e, &view, &scene.timeline, nullptr); },
      [&](l4d_encoder* e) {
        l4d_importance importance = L4D_INIT(l4d_importance);
        importance.count = scene.count();
        importance.weights[L4D_WEIGHT_ALPHA_T] = scene.opacity.data();
        return l4d_encoder_set_importance(e, &importance);
      },
      [&](l4d_encoder* e) {
        return l4d_encoder_add_metadata(e, long_text.c_str(), long_text.c_str());
      }};
  const auto encoded = [&](const EncoderHandle& e) { return e.encode(); };
  Bytes want;
  {
    const EncoderHandle e;
    for (const auto& step : steps) ASSERT_EQ(step(e.get()), L4D_OK);
    want = encoded(e);
  }
  uint64_t failures = 0;
  for (size_t step = 0; step < std::size(steps); ++step) {
    for (uint64_t k = 1;; ++k) {
      const int64_t live = live_allocations();
      uint64_t failed = 0;
      {
        const EncoderHandle e;
        for (size_t i = 0; i < step; ++i) ASSERT_EQ(steps[i](e.get()), L4D_OK);
        {
          AllocationFaults faults(k, k);
          const l4d_status status = steps[step](e.get());
          faults.stop();
          failed = faults.failed();
          ASSERT_EQ(status, failed > 0 ? L4D_ERR_OUT_OF_MEMORY : L4D_OK)
              << "step " << step << ", allocation " << k;
        }
        ASSERT_TRUE(failed == 0 || steps[step](e.get()) == L4D_OK);
        for (size_t i = step + 1; i < std::size(steps); ++i) ASSERT_EQ(steps[i](e.get()), L4D_OK);
        ASSERT_EQ(encoded(e), want) << "step " << step << ", allocation " << k;
      }
      ASSERT_EQ(live_allocations(), live) << "step " << step << ", allocation " << k;
      if (failed == 0) break;
      ++failures;
    }
  }
  EXPECT_GT(failures, 3u);
}

}  // namespace
}  // namespace l4d
