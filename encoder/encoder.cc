// SPDX-License-Identifier: Apache-2.0
#include "encoder/encoder.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <map>

#include "encoder/beside.h"
#include "encoder/observed_errors.h"
#include "encoder/position_plan.h"
#include "encoder/quality.h"
#include "encoder/sh_coder.h"
#include "encoder/written_check.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/container/levels.h"

namespace l4d {
namespace {

// Thrown out of the innermost loops; caught in encode().
struct Cancelled {};

// Rough share of the work of each step, for the progress callback. Gaussians times numbers of a
// component times codebook is what vector quantisation costs, so SH outweighs the rest.
constexpr uint64_t kPrepareWork = 2;
constexpr uint64_t kShWork = 60;
constexpr uint64_t kLayersWork = 30;
constexpr uint64_t kWriteWork = 8;
constexpr uint64_t kTotalWork = kPrepareWork + kShWork + kLayersWork + kWriteWork;

// While nothing but SH is left to wait for, the callback is asked whether to cancel this often.
constexpr std::chrono::milliseconds kAskAgain{200};

// Gaussians that are stored as they are, by the temporal level that they belong to.
using Literals = std::map<unsigned, std::vector<uint32_t>>;

// Takes Gaussians (ascending) out of the layers that they were planned for; returns them.
Literals take_out(const std::vector<uint32_t>& these, std::vector<LayerPlan>* plans) {
  Literals out;
  if (these.empty()) return out;
  for (LayerPlan& plan : *plans) {
    std::vector<uint32_t>& taken = out[plan.level];
    const auto is_one = [&](uint32_t i) {
      const bool found = std::binary_search(these.begin(), these.end(), i);
      if (found) taken.push_back(i);
      return found;
    };
    plan.members.erase(std::remove_if(plan.members.begin(), plan.members.end(), is_one),
                       plan.members.end());
  }
  return out;
}

// Layers stay in the order of their levels.
void add_literals(const EncoderScene& scene, unsigned level, std::vector<uint32_t> members,
                  std::vector<CodedLayer>* layers) {
  if (members.empty()) return;
  const auto finer = std::find_if(layers->begin(), layers->end(),
                                  [&](const CodedLayer& l) { return l.header.level > level; });
  layers->insert(finer, code_literals(scene, level, members));
}

}  // namespace

// Times the steps and tells the caller about them.
class Encoder::Steps {
 public:
  Steps(l4d_progress_fn fn, void* user) : fn_(fn), user_(user) {}

  void begin(const char* name) {
    end();
    name_ = name;
    started_ = Clock::now();
    report(done_);
  }
  void end() {
    if (name_ == nullptr) return;
    const double seconds = std::chrono::duration<double>(Clock::now() - started_).count();
    const auto same = std::find_if(stages_.begin(), stages_.end(),
                                   [&](const auto& s) { return std::strcmp(s.first, name_) == 0; });
    if (same == stages_.end()) {
      stages_.emplace_back(name_, seconds);
    } else {
      same->second += seconds;
    }
    name_ = nullptr;
  }
  void advance(uint64_t work) { done_ += work; }
  void report(uint64_t done) {
    if (cancelled(done)) throw Cancelled();
  }
  // Called now and then inside long loops, which then return early with what they have. One nonzero
  // answer of the callback is enough: the next report ends the call.
  bool cancelled() { return cancelled(done_); }
  // For other threads: whether the callback has answered so.
  bool was_cancelled() const { return cancelled_; }
  std::vector<std::pair<const char*, double>> take() { return std::move(stages_); }

 private:
  using Clock = std::chrono::steady_clock;

  bool cancelled(uint64_t done) {
    if (!cancelled_ && fn_ != nullptr && name_ != nullptr) {
      cancelled_ = fn_(user_, done, kTotalWork, name_) != 0;
    }
    return cancelled_;
  }

  l4d_progress_fn fn_;
  void* user_;
  const char* name_ = nullptr;
  Clock::time_point started_;
  uint64_t done_ = 0;
  std::atomic<bool> cancelled_{false};
  std::vector<std::pair<const char*, double>> stages_;
};

Status Encoder::set_scene(const l4d_gaussians& gaussians, const l4d_timeline& timeline,
                          const l4d_placement& placement) {
  EncoderInput input;
  input.gaussians = gaussians;
  input.timeline = timeline;
  input.placement = placement;
  L4D_RETURN_IF_ERROR(check_input(input));
  input_ = input;
  return {};
}

Status Encoder::set_weights(uint32_t which, const float* weights, uint64_t count) {
  if (which >= L4D_WEIGHT_COUNT) return invalid_argument("unknown kind of weights");
  if (input_.gaussians.count == 0) return Status(L4D_ERR_INVALID_STATE, "set the scene first");
  if (weights != nullptr && count != input_.gaussians.count) {
    return invalid_argument(std::to_string(count) + " weights for " +
                            std::to_string(input_.gaussians.count) + " Gaussians");
  }
  EncoderInput input = input_;
  input.weights[which] = weights;
  L4D_RETURN_IF_ERROR(check_input(input));
  input_ = input;
  return {};
}

Status Encoder::set_least_sizes(const float* sizes, uint64_t count) {
  if (input_.gaussians.count == 0) return Status(L4D_ERR_INVALID_STATE, "set the scene first");
  if (sizes != nullptr && count != input_.gaussians.count) {
    return invalid_argument(std::to_string(count) + " least sizes for " +
                            std::to_string(input_.gaussians.count) + " Gaussians");
  }
  EncoderInput input = input_;
  input.least_sizes = sizes;
  L4D_RETURN_IF_ERROR(check_input(input));
  input_ = input;
  return {};
}

Status Encoder::encode(const WriteFn& write) {
  if (input_.gaussians.count == 0) return Status(L4D_ERR_INVALID_STATE, "no scene is set");
  L4D_RETURN_IF_ERROR(settings_.check_profile());
  const auto started = std::chrono::steady_clock::now();
  const int threads = static_cast<int>(options_.threads);
  const bool lossless = settings_.get_bool(L4D_ENC_LOSSLESS);
  Steps steps(progress_, progress_user_);
  const std::function<bool()> cancelled = [&] { return steps.cancelled(); };
  const std::function<bool()> was_cancelled = [&] { return steps.was_cancelled(); };
  EncodeReport report;
  try {
    steps.begin("prepare");
    EncoderScene scene;
    L4D_RETURN_IF_ERROR(prepare_scene(input_, settings_, threads, &scene));
    std::vector<LayerPlan> plans = plan_layers(scene, settings_);
    const Quality quality(settings_, scene.count);
    ErrorBounds bounds = declared_bounds(scene, settings_);
    PositionPlan positions;
    if (!lossless) positions = plan_positions(scene, settings_, quality, &bounds);
    Literals literals = take_out(positions.out_of_reach, &plans);
    const bool may_be_literal =
        !lossless && settings_.get_int(L4D_ENC_PROFILE) != static_cast<int>(ProfileId::kIndexed);
    steps.advance(kPrepareWork);

    CoderOptions coder_options;
    coder_options.settings = &settings_;
    coder_options.bounds = bounds;
    coder_options.threads = threads;
    coder_options.device = device_.get();
    coder_options.seed = options_.seed;
    coder_options.cancelled = &cancelled;
    coder_options.cancelled_elsewhere = &was_cancelled;
    coder_options.step = [&](const char* name) { steps.begin(name); };

    SceneHeader header;
    header.num_gaussians = scene.count;
    header.timeline = scene.timeline;
    header.placement = input_.placement;
    header.sh_degree = scene.sh_degree;
    header.metadata = metadata_;
    if (positions.bits > 0) {
      header.position = MeanCodingId::kFixed;
      header.position_bits = positions.bits;
      header.position_scale = static_cast<float>(positions.step);
      std::copy_n(positions.center, 3, header.position_center);
      coder_options.frame = &header;
    }
    // With a device, SH is mostly its work, and the host's cores are there for the layers
    // meanwhile. Only this thread may tell of steps and ask whether to cancel.
    const bool apart = device_ != nullptr && resolve_threads(threads) > 1 && !lossless &&
                       settings_.get_int(L4D_ENC_CODING, L4D_COMPONENT_SH) == 0;
    CoderOptions sh_options = coder_options;
    if (apart) {
      steps.begin("sh_vq");
      sh_options.cancelled = &was_cancelled;
      sh_options.step = [](const char*) {};
    }
    std::future<CodedComponent> sh_beside;
    if (!lossless) sh_beside = start_beside(apart, [&] { return code_sh(scene, sh_options); });
    CodedComponent sh;
    const auto take_sh = [&] {
      sh = sh_beside.get();
      header.sh.coding = sh.is_transform ? ComponentCodingId::kTransform : ComponentCodingId::kVq;
      describe_component(sh, &header.sh);
      if (header.sh.transform()) header.sh_base = static_cast<unsigned>(sh.transform.base);
    };
    if (lossless) {
      header.position_at_mean_time = (input_.gaussians.flags & L4D_POSITION_AT_MEAN_TIME) != 0;
      header.opacity_logit = (input_.gaussians.flags & L4D_OPACITY_LOGIT) != 0;
      header.opacity.coding = ScalarCodingId::kRaw32;
      header.sh.coding = ComponentCodingId::kRaw32;
    } else if (!apart) {
      take_sh();
    }
    if (!apart) steps.advance(kShWork);

    // Finest first: what no longer fits moves to the next coarser layer before that is coded.
    std::vector<CodedLayer> layers(plans.size());
    for (size_t l = plans.size(); l-- > 0;) {
      if (plans[l].members.empty()) {
        layers[l].header.level = plans[l].level;
        continue;
      }
      steps.begin("layering");
      std::vector<uint32_t> misfits;
      layers[l] = code_layer(scene, plans[l], coder_options, &misfits,
                             may_be_literal ? &literals[plans[l].level] : nullptr);
      if (!misfits.empty()) {
        std::vector<uint32_t>& to = plans[l - 1].members;
        std::vector<uint32_t> all(to.size() + misfits.size());
        std::merge(to.begin(), to.end(), misfits.begin(), misfits.end(), all.begin());
        to = std::move(all);
        report.totals.moved_to_coarser += misfits.size();
      }
      steps.advance(kLayersWork / plans.size());
    }
    if (apart) {
      steps.begin("sh_vq");
      while (sh_beside.wait_for(kAskAgain) != std::future_status::ready) steps.cancelled();
      take_sh();
      steps.advance(kShWork);
    }
    layers.erase(std::remove_if(layers.begin(), layers.end(),
                                [](const CodedLayer& l) { return l.members.empty(); }),
                 layers.end());

    steps.begin("write");
    for (auto& [level, members] : literals) {
      report.totals.literals += members.size();
      add_literals(scene, level, std::move(members), &layers);
    }
    if (positions.bits == 0) choose_frame(layers, lossless, &header);
    if (!lossless) {
      if (positions.bits == 0 && positions.step > 0) {
        choose_fixed_frame(layers, positions.step, &header);
      }
      choose_opacity(layers, positions.opacity_bits, &header);
    }
    // Lossless streams have no errors.
    GaussianErrors worst;
    if (!lossless) worst = observed_errors(scene, header, layers, bounds, threads);
    header.errors = statement_of(worst, bounds);
    header.errors.own_least_sizes = !lossless && input_.least_sizes != nullptr;
    report.totals.max_position_error = worst.position;
    report.totals.max_covariance_factor = worst.covariance;
    report.totals.max_opacity_error = worst.opacity;
    report.totals.max_visible_error = worst.visible;
    report.totals.max_mean_t_error = worst.mean_time;
    report.totals.num_layers = static_cast<uint32_t>(layers.size());
    FileParts parts;
    L4D_RETURN_IF_ERROR(build_file(scene, settings_, header, layers, sh, threads, &parts));
    L4D_RETURN_IF_ERROR(check_written(parts.chunks));
    for (const Bytes& chunk : parts.chunks) {
      steps.report(kTotalWork - kWriteWork);
      if (!write(chunk.data(), chunk.size())) return Status(L4D_ERR_IO, "writing failed");
    }
    steps.end();
    report.order = std::move(parts.order);
    report.totals.file_bytes = parts.bytes;
    report.totals.input_gaussians = input_.gaussians.count;
    report.totals.coded_gaussians = scene.count;
    report.totals.invalid_dropped = scene.invalid_dropped;
    report.totals.pruned = scene.pruned;
    report.totals.raw_bytes = 4 * (17 + scene.sh_dim()) * input_.gaussians.count;
  } catch (const Cancelled&) {
    return Status(L4D_ERR_CANCELLED, "cancelled by the progress callback");
  }
  report.stages = steps.take();
  report.totals.num_stages = static_cast<uint32_t>(report.stages.size());
  report.totals.total_seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  report_ = std::move(report);
  has_report_ = true;
  return {};
}

}  // namespace l4d
