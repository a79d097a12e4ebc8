// SPDX-License-Identifier: Apache-2.0
// Evaluations as another program than the tool calls them.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "eval/pair/comparison.h"
#include "eval/target/encoding.h"
#include "eval/target/target.h"
#include "io/synth/synth.h"

namespace l4d::eval {
namespace {

io::Scene scene_of(uint64_t gaussians) {
  io::SynthOptions options;
  options.gaussians = gaussians;
  options.seconds = 1;
  return io::synthesize(options);
}

// The scene in reverse, as a coder would reorder it.
DecodedScene reversed(const io::Scene& scene) {
  DecodedScene out;
  out.scene = scene;
  const auto turn = [&](std::vector<float>& rows) {
    const size_t width = rows.size() / scene.count();
    std::vector<float> turned;
    for (size_t i = scene.count(); i-- > 0;) {
      const auto row = rows.begin() + static_cast<std::ptrdiff_t>(i * width);
      turned.insert(turned.end(), row, row + static_cast<std::ptrdiff_t>(width));
    }
    rows = std::move(turned);
  };
  for (auto* rows : {&out.scene.position, &out.scene.mean_t, &out.scene.log_scale, &out.scene.rotor,
                     &out.scene.opacity, &out.scene.sh}) {
    turn(*rows);
  }
  std::reverse(out.scene.mean_t_double.begin(), out.scene.mean_t_double.end());
  return out;
}

EncoderHandle encoder_of(const io::Scene& scene) {
  EncoderHandle encoder;
  const l4d_gaussians view = scene.view();
  encoder.check(l4d_encoder_set_scene(encoder.get(), &view, &scene.timeline, &scene.placement));
  return encoder;
}

TEST(Pairing, FindsEqualRowsInAnyOrder) {
  const io::Scene a = scene_of(500);
  const DecodedScene b = reversed(a);
  const Comparison c = compare_scenes(a, b, pair_by_content(a, b, 2), 2);
  EXPECT_TRUE(c.identical());
  EXPECT_EQ(c.pairing.match, "exact");
  for (const std::string& name : error_names()) {
    EXPECT_EQ(c.max_error(name), name == "covariance_factor" ? 1 : 0) << name;
  }
  EXPECT_THROW(c.max_error("weight"), io::Error);
}

// A coding of the scene, as its stream decodes.
DecodedScene coded(const io::Scene& scene, const char* preset, std::vector<uint32_t>* order) {
  const EncoderHandle encoder = encoder_of(scene);
  encoder.check(l4d_encoder_set_preset(encoder.get(), preset));
  Observer observer;
  const Encoding encoding = encode_scene(observer, encoder, "", true);
  *order = encoding.order;
  DecoderHandle decoder;
  decoder.open_memory(encoding.stream.data(), encoding.stream.size());
  return decode_scene(decoder);
}

TEST(Pairing, FindsPairsThatKeepWhatAStreamStates) {
  const io::Scene a = scene_of(3000);
  for (const char* preset : {"tiny", "default", "archive", "indexed"}) {
    std::vector<uint32_t> order;
    const DecodedScene b = coded(a, preset, &order);
    const Pairing pairing = pair_by_content(a, b, 2);
    ASSERT_EQ(pairing.match, "stated") << preset;
    EXPECT_EQ(pairing.matched, b.scene.count());
    EXPECT_EQ(pairing.a_of_b, pair_by_content(a, b, 1).a_of_b) << "threads";
    std::vector<uint32_t> used = pairing.a_of_b;
    std::sort(used.begin(), used.end());
    EXPECT_EQ(std::unique(used.begin(), used.end()), used.end());
    const Comparison found = compare_scenes(a, b, pairing, 2);
    const Comparison told = compare_scenes(a, b, pair_by_order(a, b.scene, order), 2);
    EXPECT_LE(found.max_error("position_sizes"), b.stated.position * 1.0001) << preset;
    EXPECT_LE(found.max_error("covariance_factor"), b.stated.covariance * 1.0001) << preset;
    EXPECT_LE(found.max_error("seen_opacity"), b.stated.opacity * 1.0001) << preset;
    EXPECT_LE(found.max_error("base_color"), b.stated.base_color * 1.0001) << preset;
    EXPECT_NEAR(found.visible.rmse, told.visible.rmse, 0.02 * told.visible.rmse) << preset;
  }
}

// In a row that has moved, each is nearest to the place of its neighbour, and the last has no
// place.
TEST(Pairing, ChangesPairsWhereNearestOnesAreNotPossible) {
  io::Scene a = scene_of(40);
  for (size_t i = 1; i < a.count(); ++i) {
    for (auto* rows : {&a.mean_t, &a.log_scale, &a.rotor, &a.opacity, &a.sh}) {
      const size_t width = rows->size() / a.count();
      std::copy_n(rows->begin(), width, rows->begin() + static_cast<std::ptrdiff_t>(width * i));
    }
  }
  std::fill(a.rotor.begin(), a.rotor.end(), 0.0f);
  for (size_t i = 0; i < a.count(); ++i) {
    a.rotor[8 * i] = 1;
    for (size_t k = 0; k < 4; ++k) a.log_scale[4 * i + k] = k < 3 ? 0.0f : 3.0f;
    for (size_t k = 0; k < 3; ++k) a.position[3 * i + k] = k == 0 ? static_cast<float>(i) : 0.0f;
  }
  DecodedScene b;
  b.scene = a;
  b.stated.stated = 1;
  b.stated.position = 0.61;
  b.stated.covariance = 1;
  b.stated.visible = 10;
  // 0.6 to the right: each is nearest to what its neighbour was, but for the last, which no other
  // may be.
  for (size_t i = 0; i < a.count(); ++i) b.scene.position[3 * i] += 0.6f;
  const Pairing pairing = pair_by_content(a, b, 1);
  ASSERT_EQ(pairing.match, "stated");
  for (uint32_t i = 0; i < a.count(); ++i) EXPECT_EQ(pairing.a_of_b[i], i);
  b.stated.position = 0.59;
  EXPECT_EQ(pair_by_content(a, b, 1).match, "unknown");
  EXPECT_TRUE(compare_scenes(a, b, pair_by_content(a, b, 1), 1).seen.empty());
}

TEST(Pairing, FindsNoneWithAnotherScene) {
  std::vector<uint32_t> order;
  io::SynthOptions options;
  options.gaussians = 500;
  options.seconds = 1;
  options.seed = 77;
  const DecodedScene b = coded(io::synthesize(options), "default", &order);
  EXPECT_EQ(pair_by_content(scene_of(500), b, 2).match, "unknown");
  EXPECT_EQ(pair_by_content(scene_of(499), b, 2).match, "unknown");
}

TEST(Pairing, AnOrderThatDoesNotFitIsRefused) {
  const io::Scene a = scene_of(100);
  std::vector<uint32_t> order(a.count());
  std::iota(order.begin(), order.end(), 0u);
  EXPECT_EQ(pair_by_order(a, a, order).matched, a.count());
  order[7] = order[8];
  EXPECT_THROW(pair_by_order(a, a, order), io::Error);
  order.pop_back();
  EXPECT_THROW(pair_by_order(a, a, order), io::Error);
}

TEST(Comparison, TellsTheErrorThatWasMade) {
  const io::Scene a = scene_of(300);
  DecodedScene b;
  b.scene = a;
  b.scene.position[3 * 42] += 0.5f;
  std::vector<uint32_t> order(a.count());
  std::iota(order.begin(), order.end(), 0u);
  const Comparison one = compare_scenes(a, b, pair_by_order(a, b.scene, order), 1);
  EXPECT_NEAR(one.max_error("position"), 0.5, 1e-6);
  EXPECT_NEAR(one.max_error("visible_position"), 0.5, 1e-6);
  EXPECT_EQ(one.max_error("opacity"), 0);
  EXPECT_EQ(one.seen[0].worst, 42u);
  const Comparison three = compare_scenes(a, b, pair_by_order(a, b.scene, order), 3);
  EXPECT_EQ(three.attributes[0].rmse, one.attributes[0].rmse);
}

// Counts its calls, and ends the evaluation after some.
class Stopping : public Observer {
 public:
  explicit Stopping(int calls) : left_(calls) {}
  void update(uint64_t, uint64_t, const char*) override { --left_; }
  bool cancelled() const override { return left_ < 0; }

 private:
  int left_;
};

TEST(Encoding, AnObserverCanEndIt) {
  const io::Scene scene = scene_of(500);
  const EncoderHandle encoder = encoder_of(scene);
  Stopping stopping(1);
  try {
    encode_scene(stopping, encoder, "", false);
    ADD_FAILURE() << "not cancelled";
  } catch (const Error& error) {
    EXPECT_EQ(error.status(), L4D_ERR_CANCELLED);
  }
}

TEST(Encoding, StreamsInMemoryAreCounted) {
  const io::Scene scene = scene_of(500);
  const EncoderHandle encoder = encoder_of(scene);
  Observer observer;
  const io::MemoryBudget budget("the limit", uint64_t{1} << 20);
  {
    const Encoding encoding = encode_scene(observer, encoder, "", false, budget.holder());
    EXPECT_GT(encoding.stream.size(), 0u);
    EXPECT_EQ(budget.held(), encoding.stream.size());
  }
  EXPECT_EQ(budget.held(), 0u);
  // A search for a target holds the best stream and the last one.
  uint64_t most = 0, largest = 0;
  TargetCalls calls;
  calls.begin = [&](size_t, double) -> Observer& { return observer; };
  calls.measure = [&](const Encoding& encoding, Observer&) {
    most = std::max(most, budget.held());
    largest = std::max<uint64_t>(largest, encoding.stream.size());
    return static_cast<double>(encoding.stream.size());
  };
  calls.holder = budget.holder();
  Encoding encoding;
  encode_to_target({Target::Kind::kSize, 40000, ""}, encoder, calls, &encoding);
  EXPECT_GE(most, largest);
  EXPECT_LE(most, 2 * largest);
  const io::MemoryBudget small("the limit", 1000);
  try {
    encode_scene(observer, encoder, "", false, small.holder());
    ADD_FAILURE() << "not refused";
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), L4D_ERR_LIMIT_EXCEEDED);
  }
}

TEST(Target, BytesAndLargestErrorsAreReached) {
  const io::Scene scene = scene_of(1500);
  const EncoderHandle encoder = encoder_of(scene);
  Observer observer;
  for (Target target : {Target{Target::Kind::kSize, 40000, ""},
                        Target{Target::Kind::kMaxError, 0.02, "position"}}) {
    size_t trials = 0;
    TargetCalls calls;
    calls.begin = [&](size_t trial, double) -> Observer& {
      EXPECT_LE(trial, trials++);
      return observer;
    };
    calls.measure = [&](const Encoding& encoding, Observer& heard) {
      return measure_target(target, Decoding(), heard, scene, encoding);
    };
    Encoding encoding;
    const TargetResult result = encode_to_target(target, encoder, calls, &encoding);
    EXPECT_TRUE(result.search.result().met);
    EXPECT_EQ(measure_target(target, Decoding(), observer, scene, encoding),
              result.search.result().figure);
    EXPECT_LE(result.search.result().figure, target.requested);
    EXPECT_GE(trials, 1u);
  }
}

TEST(Target, ViewsAreNotMeasuredWithoutViews) {
  Observer observer;
  EXPECT_THROW(measure_target({Target::Kind::kFidelity, 40, ""}, Decoding(), observer, scene_of(10),
                              Encoding()),
               io::Error);
}

}  // namespace
}  // namespace l4d::eval
