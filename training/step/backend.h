// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "io/image/image.h"
#include "l4d/render.h"
#include "training/density/gradient.h"
#include "training/density/relocate.h"
#include "training/model/span.h"
#include "training/model/state.h"
#include "training/step/adam.h"
#include "training/step/loss.h"

// What a trainer needs of the machine that it runs on. A back end owns the model while it trains:
// the CPU's in memory, a device's on the device. The trainer decides what happens in each step, so
// that all back ends train alike.
namespace l4d::train {

struct StepView {
  l4d_camera camera;                 // of the size of the target
  double time = 0;                   // s; views of a step may differ by parts of a frame
  uint64_t image = 0;                // identifies the target, for back ends that keep images
  const uint8_t* target = nullptr;   // [height, width, 3] on the host
  const uint8_t* alpha = nullptr;    // [height, width] or null
  const uint8_t* mask = nullptr;     // [height, width] or null
  const double* exposure = nullptr;  // [3, 4] of the camera, or null: none
};

struct StepInput {
  float background[3] = {0, 0, 0};
  float ssim_weight = 0.2f;
  std::vector<StepView> views;
  AdamStep adam;  // the back end sets `count`
  // Also update `coverage` and `error` of the rows that the views show: moving averages of the
  // sum of blending weights per pixel, and of that weighted by the mean absolute error of pixels.
  bool measure = false;
  // Also add to `screen_gradient` and `screen_views` of the rows that the views show.
  bool measure_gradients = false;
  // Also take derivatives by cameras and clocks.
  bool measure_cameras = false;
  // Also add to `time_gradient`, `time_magnitude` and `time_visits` of those rows. Of the CPU's
  // back end alone.
  bool measure_time = false;
};

using ViewGradient = std::array<double, 9>;

// The times of a step's views, each once.
std::vector<double> times_of(const StepInput& input);

// Seconds since the last call of Backend::take_seconds, by stage. kExchange: sums go from back end
// to back end, where several share a step.
enum Stage : uint32_t { kPrepare, kRender, kLoss, kBackward, kExchange, kAdam, kDensity, kStages };
extern const std::array<const char*, kStages> kStageNames;

struct StepOutput {
  std::vector<LossSums> views;
  // [views] derivative of the mean loss of the views by each exposure; zeros without one.
  std::vector<std::array<double, 12>> exposure_gradients;
  // [views] likewise by what the view is of, as l4d_gradients::view; zeros if not measured.
  std::vector<ViewGradient> view_gradients;
  uint64_t skipped_rows = 0;  // whose derivatives were not finite
  // Losses are finite. Otherwise the model is as before the step.
  bool finite = true;
};

// Bytes that a back end takes; of a group, each member.
struct BackendMemory {
  uint64_t model = 0;     // rows, their derivatives and statistics
  uint64_t renderer = 0;  // and images of a step
  uint64_t targets = 0;   // captured images that it keeps
  uint64_t total() const { return model + renderer + targets; }
};

// What decides how large a model a back end can have.
struct BackendCost {
  uint64_t row = 0;    // bytes of a Gaussian of the capacity
  uint64_t fixed = 0;  // and of all else that steps need, but for targets that stay
  uint64_t free = 0;   // bytes that a device has free; 0 = it does not bound the model
};
struct StepSize {
  uint32_t sh_degree = 0, views = 0, width = 0, height = 0;
};

class Backend {
 public:
  virtual ~Backend() = default;
  // Takes the model over, but for exposures, which are the trainer's. `timeline` is that of the
  // capture. Arrays keep their capacity.
  virtual void load(ModelState state, const l4d_timeline& timeline) = 0;
  // Copies the model out: for checkpoints, previews and the end.
  virtual ModelState save() = 0;
  virtual uint64_t count() const = 0;
  virtual uint64_t capacity() const = 0;

  // Renders the views, computes losses and derivatives, and updates the model.
  virtual StepOutput step(const StepInput& input) = 0;
  // step.count, births and next_id are the back end's; `growth` is how many rows to add at most.
  virtual DensityChange change_density(DensityStep step, uint64_t growth) = 0;
  virtual DensityChange change_density(const GradientStep& step) = 0;
  // Renews the weights by which targets are drawn.
  virtual void renew_weights(float beta) = 0;
  // What AdamStep::consistency_weight pulls the rows to; it is forgotten where rows are removed or
  // swapped. motion: [count, 3] of AdamArrays.
  virtual void set_motion(std::vector<float> motion) = 0;
  // Removes the rows whose mask is 0. mask: [count].
  virtual void keep(const std::vector<uint8_t>& mask) = 0;

  // For models that are larger than the back end, which is in the order of ids then. When each row
  // is visible; [count].
  virtual std::vector<RowSpan> spans() = 0;
  // As swap_rows (model/state.h). The weights by which targets are drawn stay those of the rows
  // before: the caller renews them before change_density, or brings the same rows back.
  virtual ModelState swap_rows(const std::vector<uint8_t>& leaves, const ModelState& entering) = 0;
  virtual BackendMemory memory() const = 0;
  virtual BackendCost cost(const StepSize& size) const = 0;
  // Bytes for all that memory() counts; targets stay as far as the model and the renderer leave
  // memory for them.
  virtual void limit_memory(uint64_t bytes) = 0;

  virtual io::Image render(const l4d_camera& camera, double time, const float* background) = 0;
  virtual std::array<double, kStages> take_seconds() = 0;
};

// The back end of l4d_renderer. threads: 0 = one per core; never changes the result.
// renderer_memory: bytes that each of the renderers may hold, of which there is one for each view
// of a step; 0 = as the renderer has it.
std::unique_ptr<Backend> make_cpu_backend(uint32_t threads, uint64_t renderer_memory = 0);

}  // namespace l4d::train
