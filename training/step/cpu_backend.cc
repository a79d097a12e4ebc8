// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <cmath>
#include <set>

#include "l4d/render.hpp"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/scene/sh.h"
#include "libl4dcodec/scene/slice.h"
#include "libl4dcodec/scene/timeline.h"
#include "training/density/temporal_split.h"
#include "training/model/buckets.h"
#include "training/step/phased_backend.h"

namespace l4d::train {

const std::array<const char*, kStages> kStageNames = {"prepare",  "render", "loss",   "backward",
                                                      "exchange", "adam",   "density"};

std::vector<double> times_of(const StepInput& input) {
  std::set<double> times;
  for (const StepView& view : input.views) times.insert(view.time);
  return {times.begin(), times.end()};
}

namespace {

constexpr size_t kRowGrain = 512;
constexpr float kAverage = 0.1f;  // weight of a new observation in moving averages
constexpr float kDcFactor = static_cast<float>(sh_constant::k0);  // of SH of degree 0
using Clock = std::chrono::steady_clock;

// One view of a step: a renderer, and arrays that keep their size from step to step. Views have
// arrays of their own and are added up in order, so that results do not depend on threads.
struct Slot {
  explicit Slot(const l4d_renderer_options& options) : renderer(&options) {}
  RendererHandle renderer;
  AttributeArrays gradient;
  std::vector<float> measured;         // [count, (D+1)^2, 3]
  std::vector<float> screen_gradient;  // [count]
  std::vector<float> image, rgb_gradient, factors;
  LossSums sums;
  std::array<double, 12> exposure_gradient{};
  ViewGradient view_gradient{};
  std::array<float, 12> exposure{};
  std::array<double, kStages> seconds{};
};

class StageClock {
 public:
  explicit StageClock(std::array<double, kStages>* seconds) : seconds_(seconds) {}
  void ends(Stage stage) {
    const Clock::time_point now = Clock::now();
    (*seconds_)[stage] += std::chrono::duration<double>(now - since_).count();
    since_ = now;
  }

 private:
  std::array<double, kStages>* seconds_;
  Clock::time_point since_ = Clock::now();
};

l4d_gradients gradients_of(AttributeArrays* arrays, uint64_t count) {
  l4d_gradients g = L4D_INIT(l4d_gradients);
  g.count = count;
  for_each_attribute(
      [](const AttributeInfo&, std::vector<float>& from, float*& to) { to = from.data(); }, *arrays,
      g);
  return g;
}

class CpuBackend final : public PhasedBackend {
 public:
  CpuBackend(uint32_t threads, uint64_t renderer_memory)
      : threads_(resolve_threads(static_cast<int>(threads))), renderer_memory_(renderer_memory) {}

  void load(ModelState state, const l4d_timeline& timeline) override {
    state_ = std::move(state);
    timeline_ = timeline;
    gradient_ = AttributeArrays();
    gradient_.sh_degree = state_.sh_degree();
    gradient_.resize(static_cast<size_t>(state_.capacity()));
    shown_.assign(static_cast<size_t>(state_.capacity()), 0);
    screen_views_.assign(shown_.size(), 0);
    for (std::vector<float>* v : {&coverage_, &error_, &screen_gradient_}) {
      v->assign(shown_.size(), 0);
    }
    slots_.clear();
  }
  ModelState save() override { return state_; }
  uint64_t count() const override { return state_.count; }
  uint64_t capacity() const override { return state_.capacity(); }

  void render_views(const StepInput& input, ViewRange range) override {
    AdamStep adam = input.adam;
    adam.count = state_.count;
    clock_ = StageClock(&seconds_);
    if (adam.sparse) {
      for (const double time : times_of(input)) {
        for_rows([&](uint64_t begin, uint64_t end) {
          catch_up_rows(adam, adam_arrays(), time, begin, end);
        });
      }
    }
    make_slots(range.count());
    clock_.ends(kAdam);

    // Whole views in parallel, where there are enough of them, else threads within one.
    const int workers = std::min(threads_, static_cast<int>(range.count()));
    parallel_for(workers, range.count(), 1, [&](size_t begin, size_t) {
      run_view(input, range.begin + begin, slots_[begin].get());
    });

    stop_ = 0;
    for (size_t k = 0; k < range.count(); ++k) {
      const Slot& slot = *slots_[k];
      if (!std::isfinite(slot.sums.loss(0.5))) stop_ = 1;
      for (size_t s = 0; s < kStages; ++s) {
        seconds_[s] += slot.seconds[s] / static_cast<double>(workers);
      }
    }
    stop_any_ = stop_;
    clock_ = StageClock(&seconds_);
    if (stop_ == 0) add_views(input, range.count());
    measures_ = input.measure;
    measures_gradients_ = input.measure_gradients;
    clock_.ends(kAdam);
  }

  StepSums sums() override {
    StepSums out;
    out.rows = state_.count;
    for_each_attribute(
        [&](const AttributeInfo& a, std::vector<float>& v) {
          out.arrays.push_back(
              {v.data(), static_cast<uint32_t>(a.numbers(state_.sh_degree())), SumArray::kFloat});
        },
        gradient_);
    out.arrays.push_back({shown_.data(), 1, SumArray::kFlag});
    if (measures_) {
      out.arrays.push_back({coverage_.data(), 1, SumArray::kFloat});
      out.arrays.push_back({error_.data(), 1, SumArray::kFloat});
    }
    if (measures_gradients_) {
      out.arrays.push_back({screen_gradient_.data(), 1, SumArray::kFloat});
      out.arrays.push_back({screen_views_.data(), 1, SumArray::kCount});
    }
    out.stop = &stop_;
    out.stop_any = &stop_any_;
    return out;
  }

  void update(const StepInput& input) override {
    clock_.ends(kExchange);
    skipped_rows_ = 0;
    if (stop_any_ == 0) {
      note_shown(input);
      skipped_rows_ = run_adam(input.adam);
    }
    clock_.ends(kAdam);
  }

  bool finish(const StepInput&, ViewRange range, StepOutput* output) override {
    *output = {};
    for (size_t k = 0; k < range.count(); ++k) {
      output->views.push_back(slots_[k]->sums);
      output->exposure_gradients.push_back(slots_[k]->exposure_gradient);
      output->view_gradients.push_back(slots_[k]->view_gradient);
    }
    output->skipped_rows = skipped_rows_;
    output->finite = stop_any_ == 0;
    return true;
  }

  DensityChange change_density(DensityStep step, uint64_t growth) override {
    StageClock clock(&seconds_);
    step.count = state_.count;
    step.sh_degree = state_.sh_degree();
    step.births = std::min(growth, state_.capacity() - state_.count);
    step.next_id = state_.next_id;
    DensityArrays a{};
    a.value = rows_of<float>(state_.value);
    a.m = rows_of<float>(state_.m);
    a.v = rows_of<float>(state_.v);
    a.updates = state_.updates.data();
    a.prepared = state_.prepared.data();
    a.born = state_.born.data();
    a.id = state_.id.data();
    a.last_shown = state_.last_shown.data();
    a.coverage = state_.coverage.data();
    a.error = state_.error.data();
    a.cumulative = state_.cumulative.data();
    a.sampled = state_.cumulative.size();
    a.motion = state_.motion.empty() ? nullptr : state_.motion.data();
    add_time_statistics(&a);
    step.split_above = state_.split_above;
    const DensityChange change = train::change_density(step, a);
    state_.count += change.born;
    state_.next_id += static_cast<uint32_t>(step.births);
    clock.ends(kDensity);
    return change;
  }

  DensityChange change_density(const GradientStep& step) override {
    StageClock clock(&seconds_);
    const DensityChange change = change_density_by_gradient(step, &state_);
    clock.ends(kDensity);
    return change;
  }

  void renew_weights(float beta) override {
    accumulate_weights(rows_of<const float>(state_.value), state_.coverage.data(),
                       state_.error.data(), state_.count, beta, &state_.cumulative);
    DensityArrays a{};
    add_time_statistics(&a);
    state_.split_above = split_threshold(a, state_.count);
  }

  void set_motion(std::vector<float> motion) override {
    motion.resize(3 * static_cast<size_t>(capacity()), 0);
    state_.motion = std::move(motion);
  }
  void keep(const std::vector<uint8_t>& mask) override { state_.keep(mask); }

  std::vector<RowSpan> spans() override { return spans_of(state_); }
  ModelState swap_rows(const std::vector<uint8_t>& leaves, const ModelState& entering) override {
    return train::swap_rows(&state_, leaves, entering);
  }
  BackendMemory memory() const override;
  BackendCost cost(const StepSize& size) const override;
  void limit_memory(uint64_t) override {}  // it keeps no targets

  io::Image render(const l4d_camera& camera, double time, const float* background) override {
    make_slots(1);
    l4d_renderer* renderer = prepare(slots_[0].get(), time, background);
    io::Image image(camera.width, camera.height);
    l4d_image out = L4D_INIT(l4d_image);
    out.rgb = image.rgb.data();
    slots_[0]->renderer.check(l4d_renderer_render(renderer, &camera, &out));
    return image;
  }

  std::array<double, kStages> take_seconds() override {
    const std::array<double, kStages> seconds = seconds_;
    seconds_.fill(0);
    return seconds;
  }

 private:
  template <typename Body>
  void for_rows(const Body& body) {
    parallel_for(threads_, static_cast<size_t>(state_.count), kRowGrain, body);
  }

  void add_time_statistics(DensityArrays* a) {
    a->time_gradient = state_.time_gradient.data();
    a->time_magnitude = state_.time_magnitude.data();
    a->time_visits = state_.time_visits.data();
  }

  AdamArrays adam_arrays() {
    AdamArrays a;
    a.value = rows_of<float>(state_.value);
    a.m = rows_of<float>(state_.m);
    a.v = rows_of<float>(state_.v);
    a.gradient = rows_of<float>(gradient_);
    a.shown = shown_.data();
    a.updates = state_.updates.data();
    a.prepared = state_.prepared.data();
    a.born = state_.born.data();
    a.id = state_.id.data();
    a.motion = state_.motion.empty() ? nullptr : state_.motion.data();
    return a;
  }

  void make_slots(size_t views) {
    while (slots_.size() < views) {
      l4d_renderer_options options = L4D_INIT(l4d_renderer_options);
      const int share = threads_ / static_cast<int>(std::max<size_t>(views, 1));
      options.threads = static_cast<uint32_t>(std::max(1, share));
      options.max_memory_bytes = renderer_memory_;
      slots_.push_back(std::make_unique<Slot>(options));
    }
  }

  l4d_renderer* prepare(Slot* slot, double time, const float* background) {
    const l4d_gaussians gaussians = state_.view();
    slot->renderer.set_gaussians(gaussians, timeline_);
    slot->renderer.check(l4d_renderer_set_background(slot->renderer.get(), background));
    slot->renderer.set_time(time);
    return slot->renderer.get();
  }

  void run_view(const StepInput& input, size_t index, Slot* slot) {
    const StepView& view = input.views[index];
    slot->seconds.fill(0);
    StageClock clock(&slot->seconds);
    l4d_renderer* renderer = prepare(slot, view.time, input.background);
    slot->gradient.sh_degree = state_.sh_degree();
    slot->gradient.resize(static_cast<size_t>(state_.count));
    for_each_attribute(
        [](const AttributeInfo&, std::vector<float>& v) { std::fill(v.begin(), v.end(), 0.0f); },
        slot->gradient);
    clock.ends(kPrepare);

    const size_t pixels = size_t{view.camera.width} * view.camera.height;
    slot->image.resize(3 * pixels);
    slot->rgb_gradient.resize(3 * pixels);
    slot->renderer.render(view.camera, slot->image.data());
    clock.ends(kRender);

    LossView<float> loss{};
    loss.width = view.camera.width;
    loss.height = view.camera.height;
    loss.rendered = slot->image.data();
    loss.target = view.target;
    loss.alpha = view.alpha;
    loss.mask = view.mask;
    loss.ssim_weight = input.ssim_weight;
    std::copy_n(input.background, 3, loss.background);
    if (view.exposure != nullptr) {
      for (size_t k = 0; k < 12; ++k) slot->exposure[k] = static_cast<float>(view.exposure[k]);
      loss.exposure = slot->exposure.data();
    }
    slot->exposure_gradient.fill(0);
    slot->factors.resize(loss_factors_size(loss));
    slot->sums = loss_forward(loss, slot->factors.data());
    const double weight = 1.0 / static_cast<double>(input.views.size());
    loss_backward(loss, slot->factors.data(), slot->sums, weight, slot->rgb_gradient.data(),
                  slot->exposure_gradient.data());
    clock.ends(kLoss);

    l4d_gradients gradients = gradients_of(&slot->gradient, state_.count);
    slot->view_gradient.fill(0);
    if (input.measure_cameras) gradients.view = slot->view_gradient.data();
    slot->renderer.check(
        l4d_renderer_backward(renderer, &view.camera, slot->rgb_gradient.data(), &gradients));
    if (input.measure_gradients) measure_gradients(view.time, view.camera, *slot);
    if (input.measure) measure(loss, renderer, view.camera, slot);
    clock.ends(kBackward);
  }

  // The derivative by the colour of a row of a sum of pixels is the sum of its blending weights:
  // two channels of one backward pass give the coverage and the coverage weighted by the error.
  void measure(const LossView<float>& loss, l4d_renderer* renderer, const l4d_camera& camera,
               Slot* slot) {
    const size_t pixels = size_t{camera.width} * camera.height;
    const float each = 1 / static_cast<float>(pixels);
    for (size_t i = 0; i < pixels; ++i) {
      float difference = 0;
      const bool counted = loss.mask == nullptr || loss.mask[i] != 0;
      const float alpha = loss.alpha == nullptr ? 1.0f : static_cast<float>(loss.alpha[i]) / 255;
      for (size_t c = 0; c < 3 && counted; ++c) {
        const float y = alpha * (static_cast<float>(loss.target[3 * i + c]) / 255) +
                        (1 - alpha) * loss.background[c];
        difference += std::abs(loss.rendered[3 * i + c] - y);
      }
      slot->rgb_gradient[3 * i] = difference / 3 * each;
      slot->rgb_gradient[3 * i + 1] = each;
      slot->rgb_gradient[3 * i + 2] = 0;
    }
    slot->measured.assign(slot->gradient.sh.size(), 0);
    l4d_gradients gradients = L4D_INIT(l4d_gradients);
    gradients.count = state_.count;
    gradients.sh = slot->measured.data();
    slot->renderer.check(
        l4d_renderer_backward(renderer, &camera, slot->rgb_gradient.data(), &gradients));
  }

  // The backward pass gives derivatives in the world alone, so that what moves the ellipse in the
  // image is not told from what deforms it.
  void measure_gradients(double time, const l4d_camera& camera, Slot& slot) {
    const size_t count = static_cast<size_t>(state_.count);
    slot.screen_gradient.assign(count, 0);
    for (size_t i = 0; i < count; ++i) {
      if (slot.gradient.opacity[i] == 0) continue;
      float p[3][4];
      const Slice4D<float> slice = slice_attributes<float>(
          state_.value.rotor.data() + 8 * i, state_.value.log_scale.data() + 4 * i, p);
      const double reference = reference_time(static_cast<double>(state_.value.mean_t[i]), 0.0,
                                              sequence_duration(timeline_));
      double mean[3];
      for (size_t c = 0; c < 3; ++c) {
        mean[c] = static_cast<double>(state_.value.position[3 * i + c]) +
                  static_cast<double>(slice.velocity[c]) * (time - reference);
      }
      slot.screen_gradient[i] =
          static_cast<float>(screen_gradient(camera, mean, slot.gradient.position.data() + 3 * i));
    }
  }

  // Sums of the views that are in the first slots, in their order.
  void add_views(const StepInput& input, size_t views) {
    const size_t width = 3 * (state_.sh_degree() + 1) * (state_.sh_degree() + 1);
    for_rows([&](uint64_t begin, uint64_t end) {
      for_each_attribute(
          [&](const AttributeInfo& a, std::vector<float>& to) {
            const size_t n = a.numbers(state_.sh_degree());
            std::fill(to.begin() + static_cast<ptrdiff_t>(begin * n),
                      to.begin() + static_cast<ptrdiff_t>(end * n), 0.0f);
          },
          gradient_);
      for (size_t k = 0; k < views; ++k) {
        for_each_attribute(
            [&](const AttributeInfo& a, const std::vector<float>& from, std::vector<float>& to) {
              const size_t n = a.numbers(state_.sh_degree());
              for (size_t i = begin * n; i < end * n; ++i) to[i] += from[i];
            },
            slots_[k]->gradient, gradient_);
      }
      for (size_t i = begin; i < end; ++i) shown_[i] = gradient_.opacity[i] != 0 ? 1 : 0;
      for (size_t i = begin; i < end && input.measure_gradients; ++i) {
        screen_gradient_[i] = 0;
        screen_views_[i] = 0;
        for (size_t k = 0; k < views; ++k) {
          if (slots_[k]->gradient.opacity[i] == 0) continue;
          screen_gradient_[i] += slots_[k]->screen_gradient[i];
          ++screen_views_[i];
        }
      }
      for (size_t i = begin; i < end && input.measure; ++i) {
        error_[i] = coverage_[i] = 0;
        for (size_t k = 0; k < views; ++k) {
          error_[i] += slots_[k]->measured[width * i];
          coverage_[i] += slots_[k]->measured[width * i + 1];
        }
      }
    });
  }

  void note_time(size_t i) {
    const float pull = gradient_.mean_t[i];
    if (!std::isfinite(pull)) return;
    state_.time_gradient[i] += pull;
    state_.time_magnitude[i] += std::abs(pull);
    ++state_.time_visits[i];
  }

  void note_shown(const StepInput& input) {
    const float each = 1 / (kDcFactor * static_cast<float>(input.views.size()));
    for_rows([&](uint64_t begin, uint64_t end) {
      for (size_t i = begin; i < end; ++i) {
        if (shown_[i] != 0) state_.last_shown[i] = static_cast<uint32_t>(input.adam.step);
        if (input.measure_time && shown_[i] != 0) note_time(i);
        if (input.measure_gradients) {
          state_.screen_gradient[i] += screen_gradient_[i];
          state_.screen_views[i] += screen_views_[i];
        }
        if (!input.measure || !(coverage_[i] > 0)) continue;
        state_.coverage[i] += kAverage * (coverage_[i] * each - state_.coverage[i]);
        state_.error[i] += kAverage * (error_[i] * each - state_.error[i]);
      }
    });
  }

  uint64_t run_adam(AdamStep adam) {
    adam.count = state_.count;
    std::vector<uint64_t> skipped(static_cast<size_t>(state_.count) / kRowGrain + 1, 0);
    for_rows([&](uint64_t begin, uint64_t end) {
      skipped[static_cast<size_t>(begin) / kRowGrain] = adam_rows(adam, adam_arrays(), begin, end);
    });
    uint64_t sum = 0;
    for (const uint64_t n : skipped) sum += n;
    return sum;
  }

  int threads_;
  uint64_t renderer_memory_;
  l4d_timeline timeline_{};
  ModelState state_;
  // Sums of a step over its views; those behind `shown_` only of one that measures.
  AttributeArrays gradient_;
  std::vector<uint8_t> shown_;
  std::vector<float> coverage_, error_, screen_gradient_;
  std::vector<uint32_t> screen_views_;
  uint32_t stop_ = 0, stop_any_ = 0;
  bool measures_ = false, measures_gradients_ = false;
  uint64_t skipped_rows_ = 0;
  std::vector<std::unique_ptr<Slot>> slots_;
  std::array<double, kStages> seconds_{};
  StageClock clock_{&seconds_};  // of the step
};

BackendCost CpuBackend::cost(const StepSize& size) const {
  ModelState row;
  row.allocate(1, size.sh_degree);
  uint64_t words = 0;
  for_each_column([&](const std::string&, size_t numbers, const auto&) { words += numbers; }, row);
  uint64_t derivatives = 0;
  for (const AttributeInfo& attribute : kAttributes) {
    derivatives += attribute.numbers(size.sh_degree);
  }
  const uint64_t sh = info_of(Attribute::kSh).numbers(size.sh_degree);
  BackendCost cost;
  cost.row = sizeof(float) * (words + 4 + derivatives + size.views * (derivatives + sh + 1)) + 1;
  const uint64_t of_pixel = 3 + 3 + 9;  // image, its derivative, factors of the loss
  cost.fixed = sizeof(float) * of_pixel * size.views * size.width * size.height;
  return cost;
}

BackendMemory CpuBackend::memory() const {
  BackendMemory memory;
  for_each_column([&](const std::string&, size_t,
                      const auto& column) { memory.model += column.size() * sizeof(uint32_t); },
                  state_);
  const auto add = [](const AttributeArrays& arrays, uint64_t* bytes) {
    for_each_attribute(
        [&](const AttributeInfo&, const std::vector<float>& rows) {
          *bytes += rows.size() * sizeof(float);
        },
        arrays);
  };
  add(gradient_, &memory.model);
  memory.model +=
      shown_.size() + (coverage_.size() + error_.size() + state_.motion.size()) * sizeof(float);
  for (const std::unique_ptr<Slot>& slot : slots_) {
    add(slot->gradient, &memory.renderer);
    for (const auto* rows : {&slot->measured, &slot->screen_gradient, &slot->image,
                             &slot->rgb_gradient, &slot->factors}) {
      memory.renderer += rows->size() * sizeof(float);
    }
  }
  return memory;
}

}  // namespace

std::unique_ptr<PhasedBackend> make_phased_cpu_backend(uint32_t threads) {
  return std::make_unique<CpuBackend>(threads, 0);
}

std::unique_ptr<Backend> make_cpu_backend(uint32_t threads, uint64_t renderer_memory) {
  return std::make_unique<CpuBackend>(threads, renderer_memory);
}

}  // namespace l4d::train
