// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "training/density/gradient.h"
#include "training/density/motion.h"
#include "training/density/relocate_row.h"
#include "training/density/temporal_split.h"
#include "training/init/start.h"
#include "training/model/neighbours.h"
#include "training/model/state.h"
#include "training/step/adam_row.h"
#include "training/step/schedule.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

ModelState make_model(uint64_t count, uint64_t capacity) {
  ModelState model;
  model.allocate(capacity, 1);
  model.count = count;
  for (size_t i = 0; i < count; ++i) {
    const Random4 r = philox(1, 0, i, Use::kStart);
    for (size_t c = 0; c < 3; ++c) model.value.position[3 * i + c] = uniform(r.v[c]);
    model.value.mean_t[i] = uniform(r.v[3]);
    for (size_t k = 0; k < 4; ++k)
      model.value.log_scale[4 * i + k] = -3 + 0.3f * static_cast<float>(k);
    for (size_t k = 0; k < 8; ++k)
      model.value.rotor[8 * i + k] = k == 0 ? 1.0f : 0.1f * uniform(r.v[k % 4]);
    model.value.opacity[i] = 0.3f;
    model.id[i] = static_cast<uint32_t>(i);
  }
  model.next_id = static_cast<uint32_t>(count);
  return model;
}

struct Step {
  explicit Step(ModelState* model) : gradient(model->value), shown(model->capacity(), 1) {
    for_each_attribute(
        [](const AttributeInfo&, std::vector<float>& v) { std::fill(v.begin(), v.end(), 0.0f); },
        gradient);
    arrays.value = rows_of<float>(model->value);
    arrays.m = rows_of<float>(model->m);
    arrays.v = rows_of<float>(model->v);
    arrays.gradient = rows_of<float>(gradient);
    arrays.shown = shown.data();
    arrays.updates = model->updates.data();
    arrays.prepared = model->prepared.data();
    arrays.born = model->born.data();
    arrays.id = model->id.data();
  }
  AttributeArrays gradient;
  std::vector<uint8_t> shown;
  AdamArrays arrays;
};

ScheduleOptions options() {
  ScheduleOptions o;
  o.radius = 2;
  o.duration = 4;
  o.fps = 10;
  o.sh_degree = 1;
  return o;
}

// What the regularisers of `s` add to the loss of the one row of a model, in double.
double regularisers(const ModelState& model, const AdamStep& s, const float* motion) {
  const double o = 1 / (1 + std::exp(-static_cast<double>(model.value.opacity[0])));
  const Slice4D<double> slice =
      slice_attributes<double>(model.value.rotor.data(), model.value.log_scale.data());
  double apart = 0;
  for (size_t c = 0; c < 3; ++c)
    apart += std::abs(slice.velocity[c] - static_cast<double>(motion[c]));
  return static_cast<double>(s.entropy_weight) * -o * std::log(o) +
         static_cast<double>(s.consistency_weight) * apart;
}

// By central differences in double: rotors of any length, and opacities of either slope.
TEST(Adam, RegularisersAreDerivatives) {
  AdamStep s;
  s.count = 1;
  s.entropy_weight = 0.3f;
  s.consistency_weight = 0.2f;
  const float motion[3] = {0.05f, -0.3f, 0.2f};
  for (const float logit : {-3.0f, -0.4f, 2.0f}) {
    ModelState model = make_model(1, 1);
    model.value.opacity[0] = logit;
    for (size_t k = 0; k < 8; ++k) {
      model.value.rotor[k] = 0.7f - 0.21f * static_cast<float>(k);
      model.value.log_scale[k % 4] = -0.3f * static_cast<float>(k % 4);
    }
    Step step(&model);
    step.arrays.motion = motion;
    regularise_row(s, step.arrays, 0, RowUpdate{1, 1, 1, 1});
    const auto expect_derivative = [&](float* number, float derivative) {
      const float kept = *number, h = 1e-3f;
      *number = kept + h;
      const double above = regularisers(model, s, motion), far = static_cast<double>(*number);
      *number = kept - h;
      const double slope =
          (above - regularisers(model, s, motion)) / (far - static_cast<double>(*number));
      *number = kept;
      EXPECT_NEAR(static_cast<double>(derivative), slope, 2e-6 + 1e-5 * std::abs(slope));
    };
    expect_derivative(&model.value.opacity[0], step.gradient.opacity[0]);
    for (size_t k = 0; k < 4; ++k) {
      expect_derivative(&model.value.log_scale[k], step.gradient.log_scale[k]);
    }
    for (size_t k = 0; k < 8; ++k) {
      expect_derivative(&model.value.rotor[k], step.gradient.rotor[k]);
    }
  }
}

// A row has the mean velocity of the 8 nearest in space and time, until rows are removed.
TEST(Motion, IsThatOfNeighbours) {
  ModelState model = make_model(20, 24);
  std::vector<Slice4D<float>> slices;
  for (size_t i = 0; i < 20; ++i) {
    // Ever farther apart, so that no two are as near.
    model.value.position[3 * i] = static_cast<float>(i) + 0.01f * static_cast<float>(i * i);
    model.value.position[3 * i + 1] = model.value.position[3 * i + 2] = 0;
    model.value.mean_t[i] = 0;
    model.value.rotor[8 * i + 4] = 0.01f * static_cast<float>(i);
    slices.push_back(
        slice_attributes<float>(&model.value.rotor[8 * i], &model.value.log_scale[4 * i]));
  }
  model.value.mean_t[4] = 100;  // far away in time
  const std::vector<float> motion = neighbour_motion(model, 1);
  ASSERT_EQ(motion.size(), 60U);
  for (size_t c = 0; c < 3; ++c) {
    float sum = 0;
    for (const size_t i : {5U, 7U, 8U, 3U, 9U, 2U, 10U, 1U}) sum += slices[i].velocity[c];
    EXPECT_EQ(motion[18 + c], sum / 8);
  }
  const std::unique_ptr<Backend> backend = make_cpu_backend(1);
  backend->load(model, l4d_timeline{0, 40, 10, 1, 0});
  backend->set_motion(motion);
  std::vector<float> kept = backend->save().motion;
  ASSERT_EQ(kept.size(), 72U);
  kept.resize(60);
  EXPECT_EQ(kept, motion);
  backend->keep(std::vector<uint8_t>(20, 1));
  EXPECT_TRUE(backend->save().motion.empty());
}

// Adam in double, as its authors write it.
TEST(Adam, IsThatOfItsAuthors) {
  ModelState model = make_model(1, 1);
  Step step(&model);
  double x = static_cast<double>(model.value.position[0]), m = 0, v = 0;
  for (uint64_t k = 1; k <= 50; ++k) {
    const double g = std::sin(static_cast<double>(k)) + 0.3;
    AdamStep s = adam_step_at(options(), 0.2, 1, k, 0);
    s.count = 1;
    s.noise = 0;
    step.gradient.position[0] = static_cast<float>(g);
    EXPECT_EQ(adam_rows(s, step.arrays, 0, 1), 0U);
    EXPECT_EQ(step.gradient.position[0], 0);
    m = 0.9 * m + 0.1 * g;
    v = 0.999 * v + 0.001 * g * g;
    const double n = static_cast<double>(k);
    x -= static_cast<double>(s.rates.position) * (m / (1 - std::pow(0.9, n))) /
         (std::sqrt(v / (1 - std::pow(0.999, n))) + 1e-15);
    EXPECT_NEAR(static_cast<double>(model.value.position[0]), x, 1e-6) << k;
  }
}

TEST(Adam, LeavesRowsWithoutFiniteDerivatives) {
  ModelState model = make_model(3, 3);
  const ModelState before = model;
  Step step(&model);
  step.gradient.rotor[8 + 5] = NAN;
  step.gradient.opacity[0] = 1;
  step.gradient.sh[3 * 4 * 2 + 1] = INFINITY;
  AdamStep s = adam_step_at(options(), 0.5, 1, 1, 0);
  s.count = 3;
  s.noise = 0;
  EXPECT_EQ(adam_rows(s, step.arrays, 0, 3), 2U);
  EXPECT_NE(model.value.opacity[0], before.value.opacity[0]);
  EXPECT_EQ(model.value.opacity[1], before.value.opacity[1]);
  EXPECT_EQ(model.value.rotor, [&] {
    std::vector<float> rotor = before.value.rotor;
    std::copy_n(model.value.rotor.begin(), 8, rotor.begin());
    return rotor;
  }());
  for (const float g : step.gradient.rotor) EXPECT_EQ(g, 0);
}

// The rate of the temporal rotor: bounded by the drift at the ends of the visible span.
TEST(Adam, BoundsTheDriftOfLongLives) {
  const ScheduleOptions o = options();
  const Rates r = rates_at(o, 0.1);
  for (const double sigma : {0.01, 0.1, 0.5, 10.0}) {
    ModelState model = make_model(1, 1);
    for (size_t k = 0; k < 8; ++k) model.value.rotor[k] = k == 0 ? 1.0f : 0.0f;
    model.value.log_scale[3] = static_cast<float>(std::log(sigma));
    Step step(&model);
    step.gradient.rotor[4] = 1;
    AdamStep s = adam_step_at(o, 0.1, 1, 1, 0);
    s.count = 1;
    s.noise = 0;
    adam_rows(s, step.arrays, 0, 1);
    const double span = std::min(8 * sigma, o.duration);
    const double rate = std::clamp(2 * 1.6e-4 * o.radius / span, 1e-6, 1e-3);
    EXPECT_NEAR(-static_cast<double>(model.value.rotor[4]), rate, 1e-3 * rate) << sigma;
  }
  EXPECT_FLOAT_EQ(r.rotor_drift, static_cast<float>(2 * 1.6e-4 * 2));
}

// Sparse Adam moves a row that comes back by the momentum of the steps in between, as the dense one
// does step by step.
TEST(Adam, CatchesUpWithTheDenseOne) {
  ModelState dense = make_model(1, 1), sparse = make_model(1, 1);
  dense.value.mean_t[0] = sparse.value.mean_t[0] = 0;
  Step a(&dense), b(&sparse);
  for (uint64_t k = 1; k <= 200; ++k) {
    const bool shows = k <= 190 || k == 196;
    AdamStep s = adam_step_at(options(), 0.2, 1, k, 0);
    s.count = 1;
    s.noise = s.opacity_weight = s.scale_weight = 0;
    a.gradient.position[0] = b.gradient.position[0] = shows ? 0.7f : 0.0f;
    adam_rows(s, a.arrays, 0, 1);
    s.sparse = true;
    b.shown[0] = shows ? 1 : 0;
    if (shows) catch_up_rows(s, b.arrays, 0, 0, 1);
    adam_rows(s, b.arrays, 0, 1);
    if (k == 195) {
      // Five unseen steps: the sparse row has not moved yet, and is behind.
      EXPECT_GT(std::abs(dense.value.position[0] - sparse.value.position[0]), 1e-4f);
    }
    if (k == 196) {
      const float rate = s.rates.position;
      EXPECT_NEAR(dense.value.position[0], sparse.value.position[0], 0.3f * rate);
    }
  }
}

TEST(Relocation, KeepsOpacityAndTheIntegralOfAlpha) {
  for (int n = 2; n <= 8; ++n) {
    for (const double opacity : {0.05, 0.3, 0.9, 0.99}) {
      const double split = split_opacity(opacity, n);
      EXPECT_NEAR(1 - std::pow(1 - split, n), opacity, 1e-12);
      const double factor = split_scale(opacity, split, n);
      // The integral of 1 - (1 - o' g)^n along a line equals that of o g.
      double one = 0, many = 0;
      const double h = 1e-3;
      for (double x = -12; x < 12; x += h) {
        one += h * opacity * std::exp(-0.5 * x * x);
        const double g = std::exp(-0.5 * x * x / (factor * factor));
        many += h * (1 - std::pow(1 - split * g, n));
      }
      EXPECT_NEAR(many / one, 1, 1e-6) << n << " " << opacity;
    }
  }
}

TEST(Relocation, MovesTheDeadAndGrows) {
  ModelState model = make_model(200, 260);
  for (size_t i = 100; i < 200; ++i) model.value.opacity[i] = -9;
  model.value.position[3 * 150] = NAN;
  accumulate_weights(rows_of<const float>(model.value), model.coverage.data(), model.error.data(),
                     model.count, 1, &model.cumulative);
  DensityArrays a;
  a.value = rows_of<float>(model.value);
  a.m = rows_of<float>(model.m);
  a.v = rows_of<float>(model.v);
  a.updates = model.updates.data();
  a.prepared = model.prepared.data();
  a.born = model.born.data();
  a.id = model.id.data();
  a.last_shown = model.last_shown.data();
  a.coverage = model.coverage.data();
  a.error = model.error.data();
  a.cumulative = model.cumulative.data();
  a.sampled = model.cumulative.size();
  uint64_t moved = 0, born = 0;
  for (uint64_t k = 1; k <= kCycle; ++k) {
    DensityStep s;
    s.seed = 9;
    s.step = k;
    s.turn = static_cast<uint32_t>(k % kCycle);
    s.count = 200 + born;
    s.births = k <= 40 ? 1 : 0;
    s.sh_degree = 1;
    s.next_id = static_cast<uint32_t>(200 + born);
    s.time_end = 4;
    const DensityChange change = change_density(s, a);
    moved += change.relocated;
    born += change.born;
  }
  EXPECT_EQ(moved, 100U);
  EXPECT_EQ(born, 40U);
  double total = 0;
  for (size_t i = 0; i < 240; ++i) {
    const float opacity = sigmoid(model.value.opacity[i]);
    EXPECT_GE(opacity, 0.9f * kDeadOpacity) << i;
    EXPECT_TRUE(std::isfinite(model.value.position[3 * i])) << i;
    total += static_cast<double>(opacity);
  }
  EXPECT_GT(total, 50);
}

// A child of a fast and long-lived parent moves along with it: positions are at reference times.
TEST(Relocation, ChildrenMoveAlong) {
  ModelState model = make_model(2, 2);
  for (const size_t i : {size_t{0}, size_t{1}}) {
    model.value.log_scale[4 * i + 3] = 1;
    model.value.rotor[8 * i + 4] = 0.4f;
  }
  DensityArrays a{};
  a.value = rows_of<float>(model.value);
  a.m = rows_of<float>(model.m);
  a.v = rows_of<float>(model.v);
  a.updates = model.updates.data();
  a.prepared = model.prepared.data();
  a.born = model.born.data();
  a.id = model.id.data();
  a.last_shown = model.last_shown.data();
  a.coverage = model.coverage.data();
  a.error = model.error.data();
  DensityStep s;
  s.sh_degree = 1;
  s.time_end = 4;
  s.halve = 0;
  double mean[3] = {0, 0, 0};
  constexpr int kTries = 4000;
  float p[3][4];
  const Slice4D<double> slice = [&] {
    double q[3][4];
    return slice_attributes<double>(model.value.rotor.data(), model.value.log_scale.data(), q);
  }();
  static_cast<void>(p);
  const auto at = [&](size_t i, size_t c, double time) {
    const double t_ref = reference_time(static_cast<double>(model.value.mean_t[i]), 0.0, 4.0);
    return static_cast<double>(model.value.position[3 * i + c]) +
           slice.velocity[c] * (time - t_ref);
  };
  for (int k = 0; k < kTries; ++k) {
    s.step = static_cast<uint64_t>(k);
    place_child(s, a, 0, 1);
    for (size_t c = 0; c < 3; ++c) mean[c] += (at(1, c, 2.5) - at(0, c, 2.5)) / kTries;
  }
  // The mean of the samples is the parent, at any time; the spread is e^-3, and the lever 100
  // times.
  for (size_t c = 0; c < 3; ++c) EXPECT_NEAR(mean[c], 0, 0.005) << c;
}

// Rows that are pulled to and fro in time, and hard, become two halves of their lives; rows that
// are pulled one way, or weakly, stay.
TEST(TemporalSplit, HalvesTheLivesThatAreTorn) {
  ModelState model = make_model(100, 130);
  for (size_t i = 0; i < 100; ++i) {
    model.value.rotor[8 * i + 4] = 0.3f;
    // Lives that the sequence cuts, and short ones.
    model.value.log_scale[4 * i + 3] = i < 50 ? 2.0f : -2.5f;
    model.time_visits[i] = 120;
    model.time_magnitude[i] = i % 10 == 3 ? 12.0f : 1.2f;
    model.time_gradient[i] = i % 20 == 3 ? 11.0f : -0.5f;
  }
  model.time_visits[53] = 99;
  const ModelState before = model;
  accumulate_weights(rows_of<const float>(model.value), model.coverage.data(), model.error.data(),
                     model.count, 1, &model.cumulative);
  DensityArrays a{};
  a.value = rows_of<float>(model.value);
  a.m = rows_of<float>(model.m);
  a.v = rows_of<float>(model.v);
  a.updates = model.updates.data();
  a.prepared = model.prepared.data();
  a.born = model.born.data();
  a.id = model.id.data();
  a.last_shown = model.last_shown.data();
  a.coverage = model.coverage.data();
  a.error = model.error.data();
  a.time_gradient = model.time_gradient.data();
  a.time_magnitude = model.time_magnitude.data();
  a.time_visits = model.time_visits.data();
  a.cumulative = model.cumulative.data();
  a.sampled = model.cumulative.size();
  DensityStep s;
  s.cycle = 1;
  s.count = 100;
  s.births = 4;
  s.sh_degree = 1;
  s.next_id = 100;
  s.time_end = 4;
  s.split_above = split_threshold(a, 100);
  EXPECT_NEAR(s.split_above, 0.1f, 1e-6f);
  EXPECT_EQ(change_density(s, a).split, 4U);  // rows 13, 33, 73 and 93: 53 was shown too rarely
  const auto at = [&](const ModelState& m, size_t i, size_t c, double time) {
    float p[3][4];
    const Slice4D<float> slice =
        slice_attributes<float>(m.value.rotor.data() + 8 * i, m.value.log_scale.data() + 4 * i, p);
    const double t_ref = reference_time(static_cast<double>(m.value.mean_t[i]), 0.0, 4.0);
    return static_cast<double>(m.value.position[3 * i + c]) +
           static_cast<double>(slice.velocity[c]) * (time - t_ref);
  };
  const auto opacity = [&](const ModelState& m, size_t i, double time) {
    float p[3][4];
    const Slice4D<float> slice =
        slice_attributes<float>(m.value.rotor.data() + 8 * i, m.value.log_scale.data() + 4 * i, p);
    return static_cast<double>(sigmoid(m.value.opacity[i])) *
           visible_falloff(static_cast<double>(slice.lambda),
                           time - static_cast<double>(m.value.mean_t[i]));
  };
  size_t child = 100;
  for (const size_t i : std::initializer_list<size_t>{13, 33, 73, 93}) {
    EXPECT_EQ(model.id[child], child);
    EXPECT_LT(model.value.mean_t[child], model.value.mean_t[i]);
    EXPECT_EQ(model.value.opacity[child], before.value.opacity[i]);
    // Both stay on the way of the row, and together they last as long as it does.
    const double middle =
        static_cast<double>(model.value.mean_t[child] + model.value.mean_t[i]) / 2;
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_NEAR(at(model, child, c, middle), at(before, i, c, middle), 0.05) << i;
      EXPECT_NEAR(at(model, i, c, middle), at(before, i, c, middle), 0.05) << i;
    }
    if (i < 50) {
      for (const double time : {0.2, 1.0, 2.0, 3.0, 3.8}) {
        const double one = opacity(model, child, time), two = opacity(model, i, time);
        EXPECT_NEAR((1 - (1 - one) * (1 - two)) / opacity(before, i, time), 1, 0.35) << time;
      }
    }
    ++child;
  }
  // What is not torn stays, and all that were judged begin anew.
  EXPECT_EQ(model.value.mean_t[3], before.value.mean_t[3]);
  EXPECT_EQ(model.value.mean_t[14], before.value.mean_t[14]);
  EXPECT_EQ(model.time_visits[53], 99U);
  EXPECT_EQ(model.time_visits[14], 0U);
}

// Rows that images pull are cloned or split, the faint go, the budget holds, and what was summed up
// begins anew.
TEST(GradientDensity, ClonesSplitsAndRemoves) {
  ModelState model = make_model(100, 130);
  for (size_t i = 0; i < 100; ++i) {
    model.screen_views[i] = 10;
    // Rows 10 to 49: the later, the more; half of them in views that count for two.
    model.screen_gradient[i] = i >= 10 && i < 50 ? 1e-3f * static_cast<float>(i) : 1e-4f;
    if (i % 2 == 1) model.value.log_scale[4 * i] = model.value.log_scale[4 * i + 1] = -9;
    if (i % 2 == 1) model.value.log_scale[4 * i + 2] = -9;
  }
  for (size_t i = 90; i < 100; ++i) model.value.opacity[i] = -9;
  const ModelState before = model;
  GradientStep s;
  s.step = 5;
  s.budget = 120;
  s.split_above = 0.01;
  s.time_end = 4;
  const DensityChange change = change_density_by_gradient(s, &model);
  EXPECT_EQ(change.relocated, 10U);
  EXPECT_EQ(change.born, 30U);
  EXPECT_EQ(model.count, 120U);
  EXPECT_EQ(model.next_id, before.next_id + 30);
  for (size_t i = 0; i < 90; ++i) {
    const bool is_pulled = i >= 20 && i < 50, is_small = i % 2 == 1;
    const float less = before.value.log_scale[4 * i] - model.value.log_scale[4 * i];
    EXPECT_NEAR(less, is_pulled && !is_small ? std::log(1.6f) : 0, 1e-4f) << i;
  }
  // The first child is that of row 49, which is small: its equal.
  EXPECT_EQ(model.value.position[3 * 90], before.value.position[3 * 49]);
  EXPECT_EQ(model.value.log_scale[4 * 90], before.value.log_scale[4 * 49]);
  EXPECT_NE(model.value.position[3 * 91], before.value.position[3 * 48]);
  for (const float gradient : model.screen_gradient) EXPECT_EQ(gradient, 0);

  s.reset = true;
  change_density_by_gradient(s, &model);
  EXPECT_EQ(model.count, 120U);
  for (size_t i = 0; i < 120; ++i) EXPECT_LE(sigmoid(model.value.opacity[i]), 0.0101f);
}

// Against differences of where a mean is in the image.
TEST(GradientDensity, KnowsTheScreen) {
  l4d_camera camera{};
  camera = L4D_INIT(l4d_camera);
  camera.width = 640;
  camera.height = 480;
  camera.fx = 500;
  camera.fy = 450;
  camera.cx = 320;
  camera.cy = 240;
  camera.near_plane = 0.02;
  const double world_to_camera[12] = {0, 1, 0, 0.3, -0.6, 0, 0.8, -0.2, 0.8, 0, 0.6, 3};
  std::copy_n(world_to_camera, 12, camera.world_to_camera);
  const double mean[3] = {0.4, -0.3, 0.7};
  const auto project = [&](const double* p, double* xy) {
    double c[3];
    for (int r = 0; r < 3; ++r) {
      c[r] = world_to_camera[4 * r + 3];
      for (int k = 0; k < 3; ++k) c[r] += world_to_camera[4 * r + k] * p[k];
    }
    xy[0] = camera.fx * c[0] / c[2];
    xy[1] = camera.fy * c[1] / c[2];
  };
  // A loss with the derivative (3, -2) by pixels.
  float by_mean[3];
  for (int k = 0; k < 3; ++k) {
    double low[3], high[3], a[2], b[2];
    for (int c = 0; c < 3; ++c) low[c] = high[c] = mean[c];
    low[k] -= 1e-4;
    high[k] += 1e-4;
    project(low, a);
    project(high, b);
    by_mean[k] = static_cast<float>((3 * (b[0] - a[0]) - 2 * (b[1] - a[1])) / 2e-4);
  }
  EXPECT_NEAR(screen_gradient(camera, mean, by_mean), std::hypot(3 * 320.0, 2 * 240.0), 1e-2);
}

TEST(Random, IsUniformAndRepeats) {
  double sum = 0, square = 0;
  for (uint64_t i = 0; i < 20000; ++i) {
    float n[4];
    normal4(philox(3, 5, i, Use::kNoise), n);
    sum += static_cast<double>(n[0] + n[3]);
    square += static_cast<double>(n[1] * n[1] + n[2] * n[2]);
  }
  EXPECT_NEAR(sum / 40000, 0, 0.02);
  EXPECT_NEAR(square / 40000, 1, 0.03);
  EXPECT_EQ(philox(3, 5, 7, Use::kNoise).v[2], philox(3, 5, 7, Use::kNoise).v[2]);
  EXPECT_NE(philox(3, 5, 7, Use::kNoise).v[2], philox(3, 5, 7, Use::kChild).v[2]);
}

TEST(Random, PermutationsAreWhole) {
  std::vector<uint32_t> order = permutation(50, 1, 2, 3);
  EXPECT_NE(order, permutation(50, 1, 3, 3));
  std::sort(order.begin(), order.end());
  std::vector<uint32_t> all(50);
  std::iota(all.begin(), all.end(), 0u);
  EXPECT_EQ(order, all);
}

// Few points stay, and copies near them, of their colour and time, make up half of what is wanted;
// many points stay alone, and next to none get random ones.
TEST(Start, FillsUpFewPoints) {
  const Capture capture = read_capture(test::tiny_capture(), {});
  std::vector<Point> points(50);
  for (size_t i = 0; i < points.size(); ++i) {
    points[i].position[0] = static_cast<float>(i * i);
    points[i].rgb[0] = points[i].time = static_cast<float>(i);
  }
  const std::vector<Point> few(points.begin(), points.begin() + 19);
  EXPECT_EQ(fill_up(capture, 2000, 3, &points), 950U);
  ASSERT_EQ(points.size(), 1000U);
  std::vector<int> copies(50);
  for (size_t i = 50; i < points.size(); ++i) {
    const auto from = static_cast<size_t>(points[i].rgb[0]);
    const float* p = points[i].position;
    const float nearest = from == 0 ? 1 : 2 * static_cast<float>(from) - 1;
    EXPECT_LE(std::hypot(p[0] - static_cast<float>(from * from), p[1], p[2]), nearest) << i;
    EXPECT_EQ(points[i].time, static_cast<float>(from));
    ++copies[from];
  }
  EXPECT_GT(*std::min_element(copies.begin(), copies.end()), 0);
  EXPECT_EQ(fill_up(capture, 2000, 3, &points), 0U);
  EXPECT_EQ(points.size(), 1000U);
  points = few;
  EXPECT_EQ(fill_up(capture, 2000, 3, &points), 981U);
  EXPECT_EQ(points.back().position[1], random_points(capture, 981, 3).back().position[1]);
}

TEST(Neighbours, AreTheNearest) {
  std::vector<float> positions;
  for (uint64_t i = 0; i < 300; ++i) {
    const Random4 r = philox(4, 0, i, Use::kStart);
    for (size_t c = 0; c < 3; ++c) positions.push_back(uniform(r.v[c]));
  }
  const std::vector<float> found = neighbour_distance(positions, 3);
  for (size_t i = 0; i < 300; ++i) {
    std::vector<double> squares;
    for (size_t j = 0; j < 300; ++j) {
      if (i == j) continue;
      double square = 0;
      for (size_t c = 0; c < 3; ++c) {
        square += std::pow(static_cast<double>(positions[3 * i + c] - positions[3 * j + c]), 2);
      }
      squares.push_back(square);
    }
    std::sort(squares.begin(), squares.end());
    EXPECT_NEAR(found[i], std::sqrt((squares[0] + squares[1] + squares[2]) / 3), 1e-5) << i;
  }
}

}  // namespace
}  // namespace l4d::train
