// SPDX-License-Identifier: Apache-2.0
#include "training/step/cuda_backend.h"

#include <algorithm>
#include <cmath>

#include "l4d/cuda.h"
#include "l4d/experimental/cuda_train.h"
#include "l4d/l4d.hpp"
#include "training/cuda/device_exchange.h"
#include "training/cuda/device_model.h"
#include "training/cuda/loss_device.h"
#include "training/cuda/target_cache.h"
#include "training/step/group_backend.h"

namespace l4d::train {
namespace {

constexpr uint64_t kFirstInstances = 1u << 20;
constexpr double kGrowth = 1.5;  // of what a view needs, where capacity lacks
// What a trainable scene allocates (include/l4d/experimental/cuda_train.h).
constexpr uint64_t kLiveBytesOfRow = 84, kViewBytesOfRow = 136, kBytesOfInstance = 68;
constexpr int kEvents = kStages + 1;

void check(const Status& status) {
  if (!status.ok()) throw Error(status.code(), status.detail());
}
void check_cuda(cudaError_t error, const char* what) {
  if (error != cudaSuccess) check(cuda::device_error(error, what));
}

struct DestroyTrainable {
  void operator()(l4d_cuda_trainable* live) const { l4d_cuda_trainable_destroy(live); }
};

// Memory of a view of a step.
struct ViewMemory {
  cuda::DeviceMemory rgb, rgb_gradient, factors, error, partial;
};

// What a step tells the host.
struct StepCounts {
  uint32_t stop, stop_any;  // of the views here; of those of all back ends that share the step
  unsigned long long skipped_rows;
  ViewGradient view_gradients[kMaxDeviceViews];
  DeviceDensityChange density;  // what comes before it each step begins with at 0
  DeviceLossSums views[kMaxDeviceViews];
};
// What the host tells a step.
struct StepNumbers {
  uint32_t count, unused[3];
  float exposures[kMaxDeviceViews][12];
};

class CudaBackend final : public PhasedBackend {
 public:
  // sharing: back ends of the device, which share its memory.
  CudaBackend(uint32_t device, uint64_t sharing) : device_(static_cast<int>(device)) {
    l4d_cuda_renderer_options options = L4D_INIT(l4d_cuda_renderer_options);
    options.device = device;
    l4d_cuda_trainable* live = nullptr;
    const l4d_status status = l4d_cuda_trainable_create(&options, &live);
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
    live_.reset(live);
    check(cuda::use_device(device_));
    check_cuda(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "making a stream");
    for (cudaEvent_t& event : events_) check_cuda(cudaEventCreate(&event), "making an event");
    check(counts_.reserve(sizeof(StepCounts)));
    check(host_counts_.reserve(sizeof(StepCounts)));
    check(numbers_.reserve(sizeof(StepNumbers)));
    check(host_numbers_.reserve(sizeof(StepNumbers)));
    check_cuda(cudaMemset(counts_.data(), 0, sizeof(StepCounts)), "clearing counters");
    size_t free = 0, total = 0;
    check_cuda(cudaMemGetInfo(&free, &total), "asking for memory");
    targets_ = std::make_unique<TargetCache>(free / 2 / sharing);
  }
  ~CudaBackend() override {
    cudaSetDevice(device_);
    if (stream_ != nullptr) cudaStreamSynchronize(stream_);
    for (cudaEvent_t event : events_) {
      if (event != nullptr) cudaEventDestroy(event);
    }
    live_.reset();
    if (stream_ != nullptr) cudaStreamDestroy(stream_);
  }

  void load(ModelState state, const l4d_timeline& timeline) override {
    use();
    timeline_ = timeline;
    check(model_.load(state, stream_));
    const l4d_gaussians gaussians = model_.gaussians();
    l4d_cuda_trainable_rows rows = L4D_INIT(l4d_cuda_trainable_rows);
    rows.count = &numbers_.as<StepNumbers>()->count;
    rows.overflow = &counts()->stop;
    check_live(l4d_cuda_trainable_set_scene(live(), &gaussians, &timeline_, &rows));
    degree_ = model_.stored_degree();
    width_ = height_ = 0;
  }
  ModelState save() override {
    use();
    ModelState state;
    check(model_.save(&state, stream_));
    return state;
  }
  uint64_t count() const override { return model_.count; }
  uint64_t capacity() const override { return model_.capacity(); }
  void render_views(const StepInput& input, ViewRange range) override;
  StepSums sums() override;
  void update(const StepInput& input) override;
  bool finish(const StepInput& input, ViewRange range, StepOutput* output) override;
  DensityChange change_density(DensityStep step, uint64_t growth) override;
  // On the host: the rule is there to compare, and its model goes there and back.
  DensityChange change_density(const GradientStep& step) override {
    ModelState state = save();
    const DensityChange change = change_density_by_gradient(step, &state);
    load(std::move(state), timeline_);
    return change;
  }
  void renew_weights(float beta) override {
    use();
    check(model_.accumulate_weights(beta, stream_));
  }
  void set_motion(std::vector<float> motion) override {
    use();
    check(model_.set_motion(motion, stream_));
  }
  void keep(const std::vector<uint8_t>& mask) override {
    ModelState state = save();
    state.keep(mask);
    load(std::move(state), timeline_);
  }
  std::vector<RowSpan> spans() override {
    use();
    std::vector<RowSpan> spans;
    check(model_.spans(stream_, &spans));
    return spans;
  }
  ModelState swap_rows(const std::vector<uint8_t>& leaves, const ModelState& entering) override {
    use();
    ModelState left;
    check(model_.swap_rows(leaves, entering, stream_, &left));
    return left;
  }
  BackendMemory memory() const override;
  BackendCost cost(const StepSize& size) const override;
  void limit_memory(uint64_t bytes) override {
    limit_ = bytes;
    share_memory();
  }
  io::Image render(const l4d_camera& camera, double time, const float* background) override;
  std::array<double, kStages> take_seconds() override {
    const std::array<double, kStages> seconds = seconds_;
    seconds_.fill(0);
    return seconds;
  }

 private:
  void share_memory();
  void use() { check_cuda(cudaSetDevice(device_), "selecting the device"); }
  l4d_cuda_trainable* live() const { return live_.get(); }
  void check_live(l4d_status status) const {
    if (status != L4D_OK) throw Error(status, l4d_last_error_message());
  }
  StepCounts* counts() const { return counts_.as<StepCounts>(); }
  void mark(int event) { check_cuda(cudaEventRecord(events_[event], stream_), "recording"); }
  void reserve(const StepInput& input, ViewRange range, uint64_t instances);
  void send_numbers(const StepInput* input, ViewRange range);
  void clear_sums(const StepInput& input);
  // Of views in the memory of the step.
  std::vector<l4d_cuda_trainable_view> live_views(const StepInput& input, ViewRange range) const;
  DeviceLossBatch loss_batch(const StepInput& input, ViewRange range);
  l4d_cuda_trainable_statistics statistics(const StepInput& input) const;
  void launch_views(const StepInput& input, ViewRange range);
  AdamStep adam_of(const StepInput& input) const;
  // What an update goes by.
  const uint32_t* stop() const { return is_shared_ ? &counts()->stop_any : &counts()->stop; }
  void read_times();

  int device_;
  std::unique_ptr<l4d_cuda_trainable, DestroyTrainable> live_;
  cudaStream_t stream_ = nullptr;
  cudaEvent_t events_[kEvents] = {};
  DeviceModel model_;
  l4d_timeline timeline_{};
  uint32_t degree_ = 0, width_ = 0, height_ = 0, num_views_ = 0;
  uint64_t instances_ = kFirstInstances;
  bool is_shared_ = false;                              // the step, by several back ends
  bool measures_ = false, measures_gradients_ = false;  // likewise
  bool has_sums_ = false;                               // of a step that is not finished
  std::vector<ViewMemory> views_;
  cuda::DeviceMemory counts_, numbers_;
  cuda::PinnedMemory host_counts_, host_numbers_;
  std::unique_ptr<TargetCache> targets_;
  uint64_t limit_ = 0;  // bytes of all; 0 = none
  std::array<double, kStages> seconds_{};
};

// Memory for the views. Only grows.
void CudaBackend::reserve(const StepInput& input, ViewRange range, uint64_t instances) {
  uint32_t width = width_, height = height_;
  for (size_t k = range.begin; k < range.end; ++k) {
    width = std::max(width, input.views[k].camera.width);
    height = std::max(height, input.views[k].camera.height);
  }
  const uint32_t count = std::max(num_views_, static_cast<uint32_t>(range.count()));
  if (count > kMaxDeviceViews) {
    throw Error(L4D_ERR_LIMIT_EXCEEDED, "a step has more than 16 views for a device");
  }
  if (width == width_ && height == height_ && count == num_views_ && instances == instances_)
    return;
  l4d_cuda_frame_capacity capacity = L4D_INIT(l4d_cuda_frame_capacity);
  capacity.width = width;
  capacity.height = height;
  capacity.visible = std::max<uint64_t>(model_.capacity(), 1);
  capacity.instances = instances;
  check_live(l4d_cuda_trainable_reserve(live(), &capacity, count));
  const size_t pixels = size_t{width} * height;
  views_.resize(count);
  for (ViewMemory& v : views_) {
    check(v.rgb.reserve(3 * pixels * sizeof(float)));
    check(v.rgb_gradient.reserve(3 * pixels * sizeof(float)));
    check(v.factors.reserve(9 * pixels * sizeof(float)));
    check(v.error.reserve(pixels * sizeof(float)));
    check(v.partial.reserve(loss_partial_size(width, height) * sizeof(double)));
  }
  width_ = width;
  height_ = height;
  num_views_ = count;
  instances_ = instances;
  share_memory();
}

void CudaBackend::send_numbers(const StepInput* input, ViewRange range) {
  auto* numbers = host_numbers_.as<StepNumbers>();
  numbers->count = static_cast<uint32_t>(model_.count);
  for (size_t v = 0; v < range.count(); ++v) {
    const double* exposure = input->views[range.begin + v].exposure;
    for (size_t k = 0; exposure != nullptr && k < 12; ++k) {
      numbers->exposures[v][k] = static_cast<float>(exposure[k]);
    }
  }
  check_cuda(cudaMemcpyAsync(numbers_.data(), numbers, sizeof(StepNumbers), cudaMemcpyHostToDevice,
                             stream_),
             "sending a step's numbers");
}

std::vector<l4d_cuda_trainable_view> CudaBackend::live_views(const StepInput& input,
                                                             ViewRange range) const {
  std::vector<l4d_cuda_trainable_view> out(range.count());
  for (size_t v = 0; v < out.size(); ++v) {
    out[v] = L4D_INIT(l4d_cuda_trainable_view);
    out[v].camera = &input.views[range.begin + v].camera;
    out[v].time = input.views[range.begin + v].time;
    std::copy_n(input.background, 3, out[v].background);
    out[v].rgb = views_[v].rgb.as<float>();
  }
  return out;
}

DeviceLossBatch CudaBackend::loss_batch(const StepInput& input, ViewRange range) {
  DeviceLossBatch batch{};
  batch.count = static_cast<uint32_t>(range.count());
  for (size_t k = 0; k < range.count(); ++k) {
    const StepView& view = input.views[range.begin + k];
    const ViewMemory& memory = views_[k];
    const TargetCache::Target* target = nullptr;
    check(targets_->take(view, input.adam.step, stream_, &target));
    DeviceLossView& v = batch.views[k];
    v.view.width = view.camera.width;
    v.view.height = view.camera.height;
    v.view.rendered = memory.rgb.as<float>();
    v.view.target = target->rgb.as<uint8_t>();
    v.view.alpha = target->alpha_or_null;
    v.view.mask = target->mask_or_null;
    v.view.exposure = view.exposure == nullptr ? nullptr : numbers_.as<StepNumbers>()->exposures[k];
    v.view.ssim_weight = input.ssim_weight;
    std::copy_n(input.background, 3, v.view.background);
    v.factors = memory.factors.as<float>();
    v.partial = memory.partial.as<double>();
    v.sums = &counts()->views[k];
    v.rgb_gradient = memory.rgb_gradient.as<float>();
    v.error = input.measure ? memory.error.as<float>() : nullptr;
    v.weight = 1 / static_cast<float>(input.views.size());
  }
  return batch;
}

// Derivatives are 0 already: the update leaves them so.
void CudaBackend::clear_sums(const StepInput& input) {
  check_cuda(cudaMemsetAsync(counts_.data(), 0, offsetof(StepCounts, density), stream_),
             "clearing counters");
  check_cuda(cudaMemsetAsync(model_.shown(), 0, model_.count, stream_), "clearing flags");
  if (input.measure || input.measure_gradients) {
    check_cuda(
        cudaMemsetAsync(model_.coverage(), 0, 3 * model_.capacity() * sizeof(float), stream_),
        "clearing coverage");
    check_cuda(
        cudaMemsetAsync(model_.screen_views(), 0, model_.capacity() * sizeof(uint32_t), stream_),
        "clearing counts of views");
  }
}

l4d_cuda_trainable_statistics CudaBackend::statistics(const StepInput& input) const {
  l4d_cuda_trainable_statistics statistics = L4D_INIT(l4d_cuda_trainable_statistics);
  statistics.shown = model_.shown();
  statistics.coverage = input.measure ? model_.coverage() : nullptr;
  statistics.error_coverage = input.measure ? model_.error_coverage() : nullptr;
  if (input.measure_gradients) {
    statistics.screen_gradient = model_.screen_gradient();
    statistics.views = model_.screen_views();
  }
  return statistics;
}

void CudaBackend::launch_views(const StepInput& input, ViewRange range) {
  const DeviceLossBatch batch = loss_batch(input, range);
  check_live(l4d_cuda_trainable_refresh(live(), stream_));
  mark(kPrepare + 1);
  const std::vector<l4d_cuda_trainable_view> views = live_views(input, range);
  check_live(l4d_cuda_trainable_forward(live(), views.data(), batch.count, stream_));
  mark(kRender + 1);
  launch_loss_forward(batch, &counts()->stop, stream_);
  launch_loss_backward(batch, stream_);
  mark(kLoss + 1);
  std::vector<l4d_cuda_trainable_loss> losses(batch.count);
  for (size_t v = 0; v < losses.size(); ++v) {
    losses[v] = L4D_INIT(l4d_cuda_trainable_loss);
    losses[v].rgb_gradient = batch.views[v].rgb_gradient;
    losses[v].error = batch.views[v].error;
    if (input.measure_cameras) losses[v].view_gradient = counts()->view_gradients[v].data();
  }
  const l4d_cuda_trainable_statistics shown = statistics(input);
  const l4d_gradients gradients = model_.gradients();
  check_live(
      l4d_cuda_trainable_backward(live(), losses.data(), batch.count, &gradients, &shown, stream_));
}

AdamStep CudaBackend::adam_of(const StepInput& input) const {
  AdamStep adam = input.adam;
  adam.count = model_.count;
  adam.active_sh_degree = std::min(adam.active_sh_degree, model_.sh_degree());
  adam.sh_degree = model_.stored_degree();
  return adam;
}

void CudaBackend::render_views(const StepInput& input, ViewRange range) {
  use();
  if (input.views.empty()) throw Error(L4D_ERR_INVALID_ARGUMENT, "a step has no view");
  const AdamStep adam = adam_of(input);
  is_shared_ = false;
  measures_ = input.measure;
  measures_gradients_ = input.measure_gradients;
  reserve(input, range, instances_);
  if (has_sums_) check(model_.clear_gradients(stream_));
  has_sums_ = true;
  // Rows that it has moved it leaves alone when a step is repeated.
  if (adam.sparse) {
    for (const double time : times_of(input)) {
      launch_catch_up(adam, model_.adam_arrays(), time, stream_);
    }
  }
  mark(0);
  send_numbers(&input, range);
  clear_sums(input);
  if (degree_ != adam.active_sh_degree) {
    degree_ = adam.active_sh_degree;
    check_live(l4d_cuda_trainable_set_sh_degree(live(), degree_));
  }
  if (range.count() > 0) {
    launch_views(input, range);
  } else {
    for (const int stage : {kPrepare, kRender, kLoss}) mark(stage + 1);
  }
  mark(kBackward + 1);
  check_cuda(cudaGetLastError(), "launching views");
}

StepSums CudaBackend::sums() {
  is_shared_ = true;
  StepSums out = model_.sums(measures_, measures_gradients_);
  out.stop = &counts()->stop;
  out.stop_any = &counts()->stop_any;
  out.device = device_;
  out.stream = stream_;
  return out;
}

void CudaBackend::update(const StepInput& input) {
  use();
  mark(kExchange + 1);
  const AdamStep adam = adam_of(input);
  const l4d_cuda_trainable_statistics sums = statistics(input);
  const size_t pixels = size_t{input.views[0].camera.width} * input.views[0].camera.height;
  const ShownRows shown{sums.shown,
                        sums.coverage,
                        sums.error_coverage,
                        1 / (static_cast<float>(pixels) * static_cast<float>(input.views.size())),
                        sums.screen_gradient,
                        sums.views};
  launch_note_shown(adam, shown, model_.averages(), stop(), stream_);
  launch_adam(adam, model_.adam_arrays(), model_.sh_updates(), stop(), &counts()->skipped_rows,
              stream_);
  mark(kAdam + 1);
  check_cuda(cudaGetLastError(), "launching an update");
}

void CudaBackend::read_times() {
  for (size_t stage = 0; stage < kDensity; ++stage) {
    float milliseconds = 0;
    check_cuda(cudaEventElapsedTime(&milliseconds, events_[stage], events_[stage + 1]), "timing");
    seconds_[stage] += 1e-3 * static_cast<double>(milliseconds);
  }
}

// Waits for the device once.
bool CudaBackend::finish(const StepInput& input, ViewRange range, StepOutput* output) {
  use();
  if (range.count() > 0) check_live(l4d_cuda_trainable_copy_report(live(), stream_));
  const auto* read = host_counts_.as<StepCounts>();
  check_cuda(cudaMemcpyAsync(host_counts_.data(), counts_.data(), sizeof(StepCounts),
                             cudaMemcpyDeviceToHost, stream_),
             "reading counters");
  check_cuda(cudaStreamSynchronize(stream_), "a step");
  read_times();
  // What views have added must not be added again.
  const bool stopped = (is_shared_ ? read->stop_any : read->stop) != 0;
  if (stopped) check(model_.clear_gradients(stream_));
  has_sums_ = false;
  if (range.count() > 0) {
    l4d_cuda_trainable_report report = L4D_INIT(l4d_cuda_trainable_report);
    check_live(l4d_cuda_trainable_get_report(live(), 1, &report));
    if (report.required_instances > instances_) {
      const double wanted = kGrowth * static_cast<double>(report.required_instances);
      reserve(input, range, static_cast<uint64_t>(wanted));
      return false;
    }
  }
  *output = {};
  output->skipped_rows = read->skipped_rows;
  output->finite = !stopped;
  for (size_t v = 0; v < range.count(); ++v) {
    const DeviceLossSums& sums = read->views[v];
    output->views.push_back({sums.absolute, sums.squared, sums.similarity, sums.values});
    output->exposure_gradients.emplace_back();
    output->view_gradients.push_back(read->view_gradients[v]);
    if (input.views[range.begin + v].exposure != nullptr) {
      std::copy_n(sums.by_exposure, 12, output->exposure_gradients.back().begin());
    }
  }
  return true;
}

DensityChange CudaBackend::change_density(DensityStep step, uint64_t growth) {
  use();
  step.count = model_.count;
  step.sh_degree = model_.stored_degree();
  step.births = std::min(growth, model_.capacity() - model_.count);
  step.next_id = model_.next_id;
  mark(kDensity);
  launch_change_density(step, model_.density_arrays(), model_.relocation_memory(),
                        &counts()->density, stream_);
  mark(kDensity + 1);
  auto* change = &host_counts_.as<StepCounts>()->density;
  check_cuda(
      cudaMemcpyAsync(change, &counts()->density, sizeof *change, cudaMemcpyDeviceToHost, stream_),
      "reading counters");
  check_cuda(cudaStreamSynchronize(stream_), "density control");
  float milliseconds = 0;
  check_cuda(cudaEventElapsedTime(&milliseconds, events_[kDensity], events_[kDensity + 1]),
             "timing");
  seconds_[kDensity] += 1e-3 * static_cast<double>(milliseconds);
  model_.count += change->born;
  model_.next_id += static_cast<uint32_t>(step.births);
  return {change->relocated, change->born};
}

io::Image CudaBackend::render(const l4d_camera& camera, double time, const float* background) {
  use();
  StepInput input;
  std::copy_n(background, 3, input.background);
  StepView view;
  view.time = time;
  view.camera = camera;
  input.views.push_back(view);
  const ViewRange range{0, 1};
  reserve(input, range, instances_);
  send_numbers(nullptr, {});
  check_live(l4d_cuda_trainable_refresh(live(), stream_));
  io::Image image(camera.width, camera.height);
  for (;;) {
    const std::vector<l4d_cuda_trainable_view> views = live_views(input, range);
    check_live(l4d_cuda_trainable_forward(live(), views.data(), 1, stream_));
    check_live(l4d_cuda_trainable_copy_report(live(), stream_));
    check_cuda(cudaMemcpyAsync(image.rgb.data(), views[0].rgb, image.rgb.size() * sizeof(float),
                               cudaMemcpyDeviceToHost, stream_),
               "reading an image");
    check_cuda(cudaStreamSynchronize(stream_), "rendering");
    l4d_cuda_trainable_report report = L4D_INIT(l4d_cuda_trainable_report);
    check_live(l4d_cuda_trainable_get_report(live(), 1, &report));
    if (report.required_instances <= instances_) return image;
    reserve(input, range,
            static_cast<uint64_t>(kGrowth * static_cast<double>(report.required_instances)));
  }
}

// Targets get what the model and the renderer leave, if there is a limit.
void CudaBackend::share_memory() {
  if (limit_ == 0) return;
  const BackendMemory used = memory();
  const uint64_t others = used.model + used.renderer;
  targets_->set_budget(limit_ - std::min(limit_, others));
}

BackendCost CudaBackend::cost(const StepSize& size) const {
  BackendCost cost;
  cost.row =
      DeviceModel::bytes_of_row(size.sh_degree) + kLiveBytesOfRow + kViewBytesOfRow * size.views;
  const uint64_t pixels = uint64_t{size.width} * size.height;
  const uint64_t of_view = (3 + 3 + 9 + 1) * pixels * sizeof(float) +
                           loss_partial_size(size.width, size.height) * sizeof(double) +
                           kBytesOfInstance * kFirstInstances;
  // A step has its targets there, with alpha and mask.
  cost.fixed = size.views * (of_view + 5 * pixels);
  size_t free = 0, total = 0;
  check_cuda(cudaSetDevice(device_), "selecting the device");
  check_cuda(cudaMemGetInfo(&free, &total), "asking for memory");
  cost.free = free;
  return cost;
}

BackendMemory CudaBackend::memory() const {
  BackendMemory memory;
  memory.model = model_.bytes();
  memory.renderer =
      counts_.size() + numbers_.size() + kLiveBytesOfRow * model_.capacity() +
      num_views_ * (kViewBytesOfRow * model_.capacity() + kBytesOfInstance * instances_);
  for (const ViewMemory& v : views_) {
    memory.renderer +=
        v.rgb.size() + v.rgb_gradient.size() + v.factors.size() + v.error.size() + v.partial.size();
  }
  memory.targets = targets_->bytes();
  return memory;
}

}  // namespace

bool has_cuda_backend() {
  l4d_cuda_device_info info = L4D_INIT(l4d_cuda_device_info);
  return l4d_cuda_get_device_info(0, &info) == L4D_OK && info.usable != 0;
}

std::unique_ptr<Backend> make_cuda_backend(uint32_t device) {
  return std::make_unique<CudaBackend>(device, 1);
}

std::unique_ptr<Backend> make_cuda_group(const std::vector<uint32_t>& devices,
                                         Transport transport) {
  if (devices.size() == 1) return make_cuda_backend(devices[0]);
  check(check_devices(devices));
  std::vector<std::unique_ptr<PhasedBackend>> members;
  for (const uint32_t device : devices) {
    const auto sharing = std::count(devices.begin(), devices.end(), device);
    members.push_back(std::make_unique<CudaBackend>(device, static_cast<uint64_t>(sharing)));
  }
  std::unique_ptr<Exchange> exchange;
  check(make_device_exchange(devices, transport, &exchange));
  return make_group_backend(std::move(members), std::move(exchange));
}

}  // namespace l4d::train
