// SPDX-License-Identifier: Apache-2.0
#include "training/density/gradient.h"

#include <algorithm>
#include <cmath>

#include "training/density/relocate_row.h"

namespace l4d::train {
namespace {

constexpr double kThreshold = 2e-4;       // of the mean screen gradient of views
constexpr float kSplitLogScale = 0.47f;   // log 1.6: what halves are smaller by
constexpr float kResetLogit = -4.59512f;  // of opacity 0.01

DensityArrays arrays_of(ModelState* model) {
  DensityArrays a{};  // no statistics of time, which this rule does not use
  a.value = rows_of<float>(model->value);
  a.m = rows_of<float>(model->m);
  a.v = rows_of<float>(model->v);
  a.updates = model->updates.data();
  a.prepared = model->prepared.data();
  a.born = model->born.data();
  a.id = model->id.data();
  a.last_shown = model->last_shown.data();
  a.coverage = model->coverage.data();
  a.motion = model->motion.empty() ? nullptr : model->motion.data();
  a.error = model->error.data();
  return a;
}

bool is_treated(const GradientStep& s, const ModelState& model, size_t i) {
  return model.id[i] % s.cycle == s.turn;
}

double mean_gradient(const GradientStep& s, const ModelState& model, size_t i) {
  const uint32_t views = model.screen_views[i];
  return views == 0 ? 0 : s.views * static_cast<double>(model.screen_gradient[i]) / views;
}

uint64_t remove_dead(const GradientStep& s, const DensityStep& row, ModelState* model) {
  const uint64_t before = model->count;
  std::vector<uint8_t> mask(static_cast<size_t>(before), 1);
  const DensityArrays a = arrays_of(model);
  for (size_t i = 0; i < mask.size(); ++i) {
    mask[i] = is_treated(s, *model, i) && is_dead(row, a, i) ? 0 : 1;
  }
  // A model is never left without rows.
  if (std::any_of(mask.begin(), mask.end(), [](uint8_t kept) { return kept != 0; })) {
    if (std::find(mask.begin(), mask.end(), 0) != mask.end()) model->keep(mask);
  }
  return before - model->count;
}

// The rows that images pull, those that they pull most first, as many as the budget allows.
std::vector<size_t> pulled_rows(const GradientStep& s, const ModelState& model) {
  std::vector<std::pair<double, size_t>> found;
  for (size_t i = 0; i < model.count; ++i) {
    const double gradient = is_treated(s, model, i) ? mean_gradient(s, model, i) : 0;
    if (gradient > kThreshold) found.emplace_back(gradient, i);
  }
  std::sort(found.begin(), found.end(), [](const auto& x, const auto& y) {
    return x.first != y.first ? x.first > y.first : x.second < y.second;
  });
  const uint64_t budget = std::min(s.budget, model.capacity());
  found.resize(
      std::min<size_t>(found.size(), static_cast<size_t>(budget - std::min(budget, model.count))));
  std::vector<size_t> rows;
  for (const auto& pulled : found) rows.push_back(pulled.second);
  return rows;
}

}  // namespace

DensityChange change_density_by_gradient(const GradientStep& s, ModelState* model) {
  DensityStep row;
  row.seed = s.seed;
  row.step = s.step;
  row.sh_degree = model->sh_degree();
  row.time_begin = s.time_begin;
  row.time_end = s.time_end;
  DensityChange change;
  change.relocated = remove_dead(s, row, model);
  const DensityArrays a = arrays_of(model);
  for (const size_t i : pulled_rows(s, *model)) {
    const size_t child = static_cast<size_t>(model->count++);
    a.id[child] = model->next_id++;
    const float* scale = a.value.log_scale + 4 * i;
    const float largest = std::max({scale[0], scale[1], scale[2]});
    if (std::exp(static_cast<double>(largest)) <= s.split_above) {
      copy_row(row, a, i, child);
      reset_row(row, a, child);
    } else {
      place_child(row, a, i, child);
      for (const size_t half : {i, child}) {
        for (size_t k = 4 * half; k < 4 * half + 3; ++k) a.value.log_scale[k] -= kSplitLogScale;
      }
      reset_row(row, a, i);
    }
    ++change.born;
  }
  for (size_t i = 0; i < model->count; ++i) {
    if (s.reset) {
      a.value.opacity[i] = std::min(a.value.opacity[i], kResetLogit);
      a.m.opacity[i] = a.v.opacity[i] = 0;
    }
    if (!is_treated(s, *model, i)) continue;
    model->screen_gradient[i] = 0;
    model->screen_views[i] = 0;
  }
  return change;
}

double screen_gradient(const l4d_camera& camera, const double mean[3], const float by_mean[3]) {
  const double* w = camera.world_to_camera;  // [3, 4]
  const auto row = [&](int r, const auto* v) {
    return w[4 * r] * static_cast<double>(v[0]) + w[4 * r + 1] * static_cast<double>(v[1]) +
           w[4 * r + 2] * static_cast<double>(v[2]);
  };
  const double depth = row(2, mean) + w[11];
  const double by_x = row(0, by_mean) * depth / camera.fx;
  const double by_y = row(1, by_mean) * depth / camera.fy;
  return 0.5 * std::hypot(by_x * camera.width, by_y * camera.height);
}

}  // namespace l4d::train
