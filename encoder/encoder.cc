// SPDX-License-Identifier: Apache-2.0
#include "encoder/encoder.h"

#include <algorithm>
#include <chrono>
#include <map>

#include "encoder/component/codebook_coder.h"
#include "encoder/encode_steps.h"
#include "encoder/file/choose_header.h"
#include "encoder/file/written_check.h"
#include "encoder/layer/color_bounds.h"
#include "encoder/layer/layer_coder.h"
#include "encoder/layer/observed_errors.h"
#include "encoder/layer/position_coding.h"
#include "encoder/layer/sh_coder.h"
#include "encoder/plan/layers.h"
#include "encoder/plan/positions.h"
#include "encoder/prepare/quality.h"
#include "libl4dcodec/base/async.h"
#include "libl4dcodec/base/threads.h"
#include "libl4dcodec/container/levels.h"

namespace l4d {
namespace {

// Rough share of the work of each step, for the progress callback. Gaussians times numbers of a
// component times codebook is what vector quantisation costs, so SH outweighs the rest.
constexpr uint64_t kPrepareWork = 2;
constexpr uint64_t kShWork = 60;
constexpr uint64_t kLayersWork = 30;
constexpr uint64_t kWriteWork = 8;
constexpr uint64_t kTotalWork = kPrepareWork + kShWork + kLayersWork + kWriteWork;

// While nothing but SH is left to wait for, the callback is asked whether to cancel this often.
constexpr std::chrono::milliseconds kAskAgain{200};

// Gaussians that are stored as they are, by the temporal level that they belong to and whether they
// have flat windows.
using Escapes = std::map<std::pair<unsigned, bool>, std::vector<uint32_t>>;

// Takes Gaussians (ascending) out of the layers that they were planned for; returns them.
Escapes take_out(const std::vector<uint32_t>& these, std::vector<LayerPlan>* plans) {
  Escapes out;
  if (these.empty()) return out;
  for (LayerPlan& plan : *plans) {
    std::vector<uint32_t>& taken = out[{plan.level, plan.flat}];
    const auto is_one = [&](uint32_t i) {
      const bool found = std::binary_search(these.begin(), these.end(), i);
      if (found) taken.push_back(i);
      return found;
    };
    plan.gaussians.erase(std::remove_if(plan.gaussians.begin(), plan.gaussians.end(), is_one),
                         plan.gaussians.end());
  }
  return out;
}

// Layers stay in the order of their levels.
void add_escapes(const EncoderScene& scene, unsigned level, bool flat,
                 std::vector<uint32_t> gaussians, std::vector<CodedLayer>* layers) {
  if (gaussians.empty()) return;
  const auto finer = std::find_if(layers->begin(), layers->end(),
                                  [&](const CodedLayer& l) { return l.level > level; });
  layers->insert(finer, code_escapes(scene, level, flat, gaussians));
}

// Gives each layer the codes of its Gaussians, in their order, as those of other components are.
// What stays is shared by all layers.
void distribute_sh(int threads, CodedScene* coded) {
  CodedComponent& sh = coded->sh;
  const auto* vq = std::get_if<CodedVq>(&sh);
  if (vq == nullptr || !vq->any_escape) rows_of(sh).decoded = std::vector<float>();
  for (CodedLayer& layer : coded->layers) {
    layer.component[L4D_COMPONENT_SH] = codes_of(sh, layer.gaussians, threads);
  }
  drop_codes(sh);
}

}  // namespace

// One encode, step by step in the order of its public functions.
class Encoder::Run {
 public:
  Run(const Encoder& encoder, const EncoderInput& input, const EncoderSettings& settings)
      : input_(input),
        settings_(settings),
        metadata_(encoder.metadata_),
        threads_(static_cast<int>(encoder.options_.threads)),
        lossless_(settings_.get_bool(Parameter::kLossless)),
        steps_(encoder.progress_, encoder.progress_user_, kTotalWork) {
    options_.settings = &settings_;
    options_.threads = threads_;
    options_.device = encoder.device_.get();
    options_.seed = encoder.options_.seed;
    options_.cancelled = &cancelled_;
    options_.step = [this](const char* name) { steps_.begin(name); };
  }
  // Its callbacks refer to it.
  Run(const Run&) = delete;
  Run& operator=(const Run&) = delete;

  // The scene, the layers that its Gaussians belong to, and how finely positions are coded.
  Status prepare() {
    steps_.begin("prepare");
    L4D_RETURN_IF_ERROR(prepare_scene(input_, settings_, threads_, &scene_));
    plans_ = plan_layers(scene_, settings_);
    options_.bounds = declared_bounds(scene_, settings_);
    if (!lossless_) {
      positions_ =
          plan_positions(scene_, settings_, Quality(settings_, scene_.count, scene_.shared_count),
                         &options_.bounds);
    }
    if (positions_.bits > 0) {
      known_positions_ = planned_positions(positions_);
      options_.positions = &known_positions_;
    }
    escapes_ = take_out(positions_.out_of_reach, &plans_);
    steps_.advance(kPrepareWork);
    return {};
  }

  // With a device, SH is mostly its work, and the host's cores are there for the layers meanwhile.
  // Only this thread may tell of steps and ask whether to cancel.
  void start_sh() {
    sh_apart_ = options_.device != nullptr && resolve_threads(threads_) > 1 && !lossless_ &&
                settings_.get_int(Parameter::kCoding, L4D_COMPONENT_SH) == 0;
    if (lossless_) {
      coded_.sh = RawRows{};
    } else {
      sh_options_ = options_;
      if (sh_apart_) {
        steps_.begin("sh_vq");
        sh_options_.step = [](const char*) {};
      }
      sh_ = start_async(sh_apart_, [this] { return code_sh(scene_, sh_options_); });
      if (!sh_apart_) coded_.sh = sh_.get();
    }
    if (!sh_apart_) steps_.advance(kShWork);
  }

  // Finest first: what no longer fits moves to the next coarser layer before that is coded.
  void code_layers() {
    const bool may_be_escape = !lossless_ && settings_.get_int(Parameter::kProfile) !=
                                                 static_cast<int>(ProfileId::kIndexed);
    std::vector<CodedLayer>& layers = coded_.layers;
    layers.resize(plans_.size());
    for (size_t l = plans_.size(); l-- > 0;) {
      if (plans_[l].gaussians.empty()) continue;
      steps_.begin("layering");
      std::vector<uint32_t> demoted;
      layers[l] =
          code_layer(scene_, plans_[l], options_, &demoted,
                     may_be_escape ? &escapes_[{plans_[l].level, plans_[l].flat}] : nullptr);
      if (!demoted.empty()) {
        size_t coarser = l - 1;
        while (plans_[coarser].flat || plans_[coarser].tier > 0) --coarser;
        std::vector<uint32_t>& to = plans_[coarser].gaussians;
        std::vector<uint32_t> all(to.size() + demoted.size());
        std::merge(to.begin(), to.end(), demoted.begin(), demoted.end(), all.begin());
        to = std::move(all);
        report_.totals.moved_to_coarser += demoted.size();
      }
      steps_.advance(kLayersWork / plans_.size());
    }
    layers.erase(std::remove_if(layers.begin(), layers.end(),
                                [](const CodedLayer& l) { return l.gaussians.empty(); }),
                 layers.end());
  }

  void finish_sh() {
    if (!sh_apart_) return;
    steps_.begin("sh_vq");
    while (sh_.wait_for(kAskAgain) != std::future_status::ready) steps_.cancelled();
    coded_.sh = sh_.get();
    steps_.advance(kShWork);
  }

  // Layers of what is stored as it is. All layers are there then, and get their SH.
  Status complete_layers() {
    steps_.begin("write");
    if (!lossless_) {
      colors_ = largest_color_errors(scene_, coded_.sh, threads_);
      L4D_RETURN_IF_ERROR(check_colors(colors_, options_.bounds));
    }
    for (auto& [layer, gaussians] : escapes_) {
      report_.totals.escapes += gaussians.size();
      add_escapes(scene_, layer.first, layer.second, std::move(gaussians), &coded_.layers);
    }
    report_.totals.num_layers = static_cast<uint32_t>(coded_.layers.size());
    distribute_sh(threads_, &coded_);
    return {};
  }

  Status choose_header() {
    GaussianErrors worst, stated;
    header_ = l4d::choose_header(
        {input_, scene_, metadata_, positions_, options_.bounds, colors_, lossless_, threads_},
        coded_, &worst, &stated);
    report_.totals.max_position_error = stated.position;
    report_.totals.max_covariance_factor = stated.covariance;
    report_.totals.max_opacity_error = stated.opacity;
    report_.totals.max_visible_error = stated.visible;
    report_.totals.max_mean_t_error = stated.mean_time;
    report_.totals.max_base_color_error = stated.base_color;
    report_.totals.max_directional_color_error = stated.directional_color;
    // Binary16 positions keep no bound, and their streams state none that they miss.
    const bool promised = !lossless_ && header_.position != CoordinateCodingId::kF16;
    return promised ? check_bounds(worst, options_.bounds) : Status();
  }

  Status write(const WriteFn& write) {
    FileParts parts;
    const PositionCoding positions = header_;
    const ScalarCoding opacity = header_.opacity;
    const ErrorStatement errors = header_.errors;
    L4D_RETURN_IF_ERROR(
        build_file(scene_, settings_, std::move(header_), coded_, threads_, &parts, &cancelled_));
    steps_.begin("check");
    const ExpectedStream expected = {scene_, coded_,      positions, opacity,
                                     errors, parts.order, lossless_};
    L4D_RETURN_IF_ERROR(check_written(parts.chunks, &expected, threads_));
    steps_.begin("write");
    uint64_t written = 0;
    for (const Bytes& chunk : parts.chunks) {
      const double share = static_cast<double>(written) / static_cast<double>(parts.bytes);
      steps_.report(kTotalWork - kWriteWork + static_cast<uint64_t>(share * kWriteWork));
      if (!write(chunk.data(), chunk.size())) return Status(L4D_ERR_IO, "writing failed");
      written += chunk.size();
    }
    steps_.report(kTotalWork);
    steps_.end();
    report_.order = std::move(parts.order);
    report_.totals.file_bytes = parts.bytes;
    return {};
  }

  EncodeReport report() {
    EncodeReport report = std::move(report_);
    report.totals.input_gaussians = input_.gaussians.count;
    report.totals.coded_gaussians = scene_.count;
    report.totals.invalid_dropped = scene_.invalid_dropped;
    report.totals.pruned = scene_.pruned;
    report.totals.raw_bytes = 4 * (17 + scene_.sh_dim()) * input_.gaussians.count;
    report.steps = steps_.take();
    report.totals.num_steps = static_cast<uint32_t>(report.steps.size());
    report.totals.total_seconds =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - started_).count();
    return report;
  }

 private:
  const std::chrono::steady_clock::time_point started_ = std::chrono::steady_clock::now();
  const EncoderInput& input_;
  const EncoderSettings& settings_;
  const std::vector<std::pair<std::string, std::string>>& metadata_;
  const int threads_;
  const bool lossless_;
  EncodeSteps steps_;
  const std::function<bool()> cancelled_ = [this] { return steps_.cancelled(); };
  CoderOptions options_;
  EncoderScene scene_;
  std::vector<LayerPlan> plans_;
  PositionPlan positions_;
  PositionCoding known_positions_;
  Escapes escapes_;
  CodedScene coded_;
  ColorErrors colors_;
  SceneHeader header_;
  EncodeReport report_;
  bool sh_apart_ = false;
  CoderOptions sh_options_;
  // The last member, the first to go: its end waits for a thread that uses the others.
  std::future<CodedComponent> sh_;
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

Status Encoder::set_fitted_opacity(const float* opacity) {
  if (input_.gaussians.count == 0) return Status(L4D_ERR_INVALID_STATE, "set the scene first");
  const float* given = input_.opacity_given();
  input_.gaussians.opacity = opacity == nullptr ? given : opacity;
  input_.stated_opacity = opacity == nullptr ? nullptr : given;
  return {};
}

Status Encoder::set_importance(const l4d_importance& importance) {
  if (input_.gaussians.count == 0) return Status(L4D_ERR_INVALID_STATE, "set the scene first");
  EncoderInput input = input_;
  input.importance = importance;
  L4D_RETURN_IF_ERROR(check_input(input));
  input_ = input;
  return {};
}

Status Encoder::set_rendering(const l4d_rendering& rendering) {
  if (!is_valid(rendering)) return invalid_argument("a number of the rendering is out of range");
  input_.rendering = rendering;
  return {};
}

Status Encoder::set_presentation(const l4d_presentation& presentation) {
  if (!is_valid(presentation)) {
    return invalid_argument("a number of the presentation is out of range");
  }
  input_.presentation = presentation;
  return {};
}

Status Encoder::encode(const WriteFn& write) {
  if (input_.gaussians.count == 0) return Status(L4D_ERR_INVALID_STATE, "no scene is set");
  EncodeReport report;
  L4D_RETURN_IF_ERROR(encode_input(input_, settings_, write, &report));
  report_ = std::move(report);
  has_report_ = true;
  return {};
}

Status Encoder::encode_input(const EncoderInput& input, const EncoderSettings& settings,
                             const WriteFn& write, EncodeReport* report) const {
  L4D_RETURN_IF_ERROR(settings.check_profile());
  if (settings.get_bool(Parameter::kLossless) && input.stated_opacity != nullptr) {
    return invalid_argument("a lossless stream has the opacities of the scene, not fitted ones");
  }
  Run run(*this, input, settings);
  try {
    L4D_RETURN_IF_ERROR(run.prepare());
    run.start_sh();
    run.code_layers();
    run.finish_sh();
    L4D_RETURN_IF_ERROR(run.complete_layers());
    L4D_RETURN_IF_ERROR(run.choose_header());
    L4D_RETURN_IF_ERROR(run.write(write));
  } catch (const Cancelled&) {
    return Status(L4D_ERR_CANCELLED, "cancelled by the progress callback");
  }
  *report = run.report();
  return {};
}

}  // namespace l4d
