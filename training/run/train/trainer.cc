// SPDX-License-Identifier: Apache-2.0
#include "training/run/train/trainer.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iterator>

#include "eval/views/importance.h"
#include "io/image/metrics.h"
#include "libl4dcodec/scene/slice.h"
#include "training/density/motion.h"
#include "training/model/random.h"
#include "training/run/train/output.h"
#include "training/run/train/prune.h"

namespace l4d::train {
namespace {

constexpr uint64_t kMeasureEvery = 8;  // steps
constexpr double kRefineBegin = 0.1;   // of the training, of --refine-times and --refine-cameras
constexpr double kGrowth = 0.05;       // in kCycle steps
constexpr double kLossAverage = 0.02;  // weight of a new loss in its average
constexpr double kHighLoss = 3;        // times the average
constexpr uint64_t kMaxHighLosses = 200, kMaxLost = 3;
constexpr double kExposureRate = 1e-3, kExposureWeight = 0.01;
constexpr uint32_t kMinHalfSize = 64;  // pixels: smaller images are not halved
constexpr uint64_t kWatchFrom = 2000;  // steps
constexpr double kUnsynchronised = 3;  // times the median loss
constexpr double kMinCoverage = 1e-8;  // per pixel
constexpr double kGrowUpTo = 0.8;      // of a back end that holds a part of the model
// Of --codec prune: five times a tenth of the rows.
constexpr uint64_t kPrunes = 5;
constexpr double kPruneBegin = 0.6, kPruneEvery = 0.05, kPruneShare = 0.1;
constexpr size_t kPruneViews = 64;           // that losses are measured on, at most
constexpr double kSettleAt[] = {0.75, 0.8};  // encodes of --codec settle
// Of --density gradient.
constexpr double kGradientEnd = 0.5;    // of the training
constexpr double kSplitShare = 0.01;    // of the radius
constexpr uint64_t kResetEvery = 3000;  // steps
constexpr float kIdentity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

}  // namespace

Trainer::Trainer(const Settings& settings, const Capture& capture, const ImageLoader& loader,
                 const std::vector<Instant>& instants, ImageStore* store, Backend* backend,
                 uint32_t threads, Residence* residence)
    : settings_(settings),
      capture_(capture),
      loader_(loader),
      instants_(instants),
      store_(store),
      backend_(backend),
      threads_(threads),
      residence_(residence) {
  schedule_.radius = frame_of(capture).radius;
  schedule_.duration = capture.duration();
  schedule_.fps = capture.fps;
  schedule_.sh_degree = settings.sh_degree;
  schedule_.drift = settings.drift;
  schedule_.scale_weight = settings.scale_weight;
  schedule_.entropy_weight = settings.entropy_weight;
  schedule_.consistency_weight = settings.consistency_weight;
  schedule_.max_scale = settings.max_scale;
  const double refined = settings.refine_times / capture.fps;  // s that views may move
  for (const Instant& instant : instants) {
    training_views_ += instant.views.size();
    times_.push_back({instant.time - refined, instant.last + refined});
  }
  state_.camera_loss.assign(capture.cameras.size(), 0);
  store_->go_to(0);
  for (const uint32_t k : store_->instants()) {
    has_alpha_ = has_alpha_ || !store_->image(instants[k].views[0]).alpha.empty();
  }
  schedule_.opacity_weight = opacity_weight_of(settings, has_alpha_);
  if (settings.exposure == "on") exposures_.resize(capture.cameras.size());
}

void Trainer::start(ModelState model) {
  if (residence_ != nullptr) {
    std::fill(model.away.begin(), model.away.end(), 1U);
    residence_->place(model, capture_.timeline());
    return;
  }
  backend_->load(std::move(model), capture_.timeline());
  backend_->renew_weights(0);
}

void Trainer::restore(ModelState model, const RunState& state) {
  exposures_ = model.exposures;
  state_ = state;
  if (residence_ == nullptr) {
    backend_->load(std::move(model), capture_.timeline());
    return;
  }
  store_->use_windows(state.windows == 0 ? UINT32_MAX : static_cast<uint32_t>(state.windows));
  residence_->place(model, capture_.timeline());
}

ModelState Trainer::model() const {
  ModelState model = residence_ != nullptr ? residence_->whole() : backend_->save();
  model.exposures = exposures_;
  return model;
}

double Trainer::progress() const {
  const double f = settings_.seconds > 0
                       ? state_.seconds / settings_.seconds
                       : static_cast<double>(state_.step) / static_cast<double>(settings_.steps);
  return std::clamp(f, 0.0, 1.0);
}

bool Trainer::done() const {
  return settings_.seconds > 0 ? state_.seconds >= settings_.seconds
                               : state_.step >= settings_.steps;
}

double Trainer::seconds_left() const {
  return settings_.seconds > 0 ? std::max(0.0, settings_.seconds - state_.seconds) : 0;
}

uint64_t Trainer::steps_per_epoch() const {
  return std::max<uint64_t>(1, (training_views_ + settings_.views - 1) / settings_.views);
}

// Laps over the instants that are there, in a permutation each.
const Instant& Trainer::choose_instant(uint64_t* visit) const {
  const std::vector<uint32_t>& there = store_->instants();
  const uint64_t n = there.size();
  const uint64_t at = store_->step_of_period();
  const uint64_t lap = at / n;
  const std::vector<uint32_t> order =
      permutation(static_cast<uint32_t>(n), settings_.seed, store_->period() << 32 | lap,
                  static_cast<uint32_t>(Use::kInstants));
  // Visits of an instant take its cameras in turn.
  *visit = store_->period() * 7 + lap;
  return instants_[there[order[at % n]]];
}

std::vector<uint32_t> Trainer::choose_views(const Instant& instant, uint32_t index,
                                            uint64_t visit) const {
  const uint64_t n = instant.views.size();
  const uint64_t wanted = std::min<uint64_t>(settings_.views, n);
  std::vector<uint32_t> views;
  std::vector<uint32_t> order;
  uint64_t order_of = UINT64_MAX;
  for (uint64_t k = 0; k < wanted; ++k) {
    const uint64_t at = visit * wanted + k;
    if (at / n != order_of) {
      order_of = at / n;
      order = permutation(static_cast<uint32_t>(n), settings_.seed,
                          static_cast<uint64_t>(index) << 32 | order_of,
                          static_cast<uint32_t>(Use::kCameras));
    }
    const uint32_t view = instant.views[order[at % n]];
    // Where one round ends and the next begins, a camera could come twice.
    if (std::find(views.begin(), views.end(), view) == views.end()) views.push_back(view);
  }
  return views;
}

// All but its views.
StepInput Trainer::plan_step(double f, uint64_t step) {
  StepInput input;
  schedule_.rate_factor = state_.rate_factor;
  input.adam = adam_step_at(schedule_, f, settings_.seed, step, 0);
  input.adam.sparse = settings_.adam == "sparse";
  input.adam.model_count = count();
  if (settings_.density != "relocate") input.adam.noise = 0;
  input.measure_time = settings_.temporal_split == "on" && f < kDensityEnd;
  input.measure_gradients = settings_.density == "gradient" && f < kGradientEnd;
  input.measure = step % kMeasureEvery == 0 && settings_.density != "off";
  input.measure_cameras = !state_.refined.empty() && f >= kRefineBegin;
  if (has_alpha_) {
    const Random4 r = philox(settings_.seed, step, 0, Use::kBackground);
    for (size_t c = 0; c < 3; ++c) input.background[c] = uniform(r.v[c]);
  }
  return input;
}

StepReport Trainer::advance() {
  const double f = progress();
  store_->go_to(state_.step);
  const uint64_t step = state_.step + 1;
  if (residence_ != nullptr) {
    const auto since = std::chrono::steady_clock::now();
    renew_residence();
    seconds_swapping_ +=
        std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
  }
  uint64_t visit = 0;
  const Instant& instant = choose_instant(&visit);
  const std::vector<uint32_t> views =
      choose_views(instant, static_cast<uint32_t>(&instant - instants_.data()), visit);

  StepInput input = plan_step(f, step);
  std::vector<Pixels> halves(views.size());
  for (size_t k = 0; k < views.size(); ++k) {
    const Pixels* pixels = &store_->image(views[k]);
    const uint32_t camera = capture_.views[views[k]].camera;
    StepView view;
    view.camera = loader_.camera(camera);
    view.time = capture_.time_of(views[k]);
    view.image = views[k];
    const std::vector<uint8_t>& mask = loader_.mask(camera);
    const bool is_half = f < kHalfResolution && mask.empty() &&
                         std::min(view.camera.width, view.camera.height) >= 2 * kMinHalfSize;
    if (is_half) {
      halves[k] = halved(*pixels);
      pixels = &halves[k];
      view.image |= uint64_t{1} << 63;
      view.camera.width = pixels->width;
      view.camera.height = pixels->height;
      for (double* number : {&view.camera.fx, &view.camera.fy, &view.camera.cx, &view.camera.cy}) {
        *number /= 2;
      }
    }
    view.target = pixels->rgb.data();
    if (!pixels->alpha.empty()) view.alpha = pixels->alpha.data();
    if (!mask.empty()) view.mask = mask.data();
    if (!exposures_.empty()) view.exposure = exposures_[camera].value.data();
    input.views.push_back(view);
  }
  const StepOutput output = backend_->step(input);

  StepReport report;
  report.step = state_.step = step;
  report.progress = f;
  report.skipped_rows = output.skipped_rows;
  double squared = 0, values = 0;
  for (const LossSums& sums : output.views) {
    report.loss += sums.loss(static_cast<double>(input.ssim_weight)) /
                   static_cast<double>(output.views.size());
    squared += sums.squared;
    values += static_cast<double>(sums.values);
  }
  report.psnr = io::psnr_of_mse(values > 0 ? squared / values : 0);
  guard(report, output, views);
  if (output.finite) {
    if (!exposures_.empty()) update_exposures(output, views, f);
    watch_cameras(output, views);
    report.density = change_density(step, f);
    renew_motion();
    if (input.measure_cameras) {
      report.views = views;
      report.view_gradients = output.view_gradients;
    }
  }
  report.count = count();
  return report;
}

void Trainer::renew_motion() {
  if (settings_.consistency_weight == 0 || state_.step % kMotionEvery != 0) return;
  backend_->set_motion(neighbour_motion(backend_->save(), schedule_.radius / schedule_.duration));
}

void Trainer::update_exposures(const StepOutput& output, const std::vector<uint32_t>& views,
                               double f) {
  const double rate = kExposureRate * std::pow(0.1, f) * state_.rate_factor;
  for (size_t k = 0; k < views.size(); ++k) {
    Exposure& e = exposures_[capture_.views[views[k]].camera];
    ++e.updates;
    const double n = static_cast<double>(e.updates);
    for (size_t i = 0; i < 12; ++i) {
      const double apart = e.value[i] - static_cast<double>(kIdentity[i]);
      const double g = output.exposure_gradients[k][i] + 2 * kExposureWeight * apart;
      e.m[i] = 0.9 * e.m[i] + 0.1 * g;
      e.v[i] = 0.999 * e.v[i] + 0.001 * g * g;
      const double m = e.m[i] / (1 - std::pow(0.9, n)), v = e.v[i] / (1 - std::pow(0.999, n));
      e.value[i] -= rate * m / (std::sqrt(v) + 1e-15);
    }
  }
  // The mean over cameras stays the identity: the scene keeps the colours of the capture.
  std::array<double, 12> mean{};
  double cameras = 0;
  for (size_t c = 0; c < exposures_.size(); ++c) {
    if (capture_.cameras[c].split != "train") continue;
    ++cameras;
    for (size_t i = 0; i < 12; ++i) mean[i] += exposures_[c].value[i];
  }
  for (size_t c = 0; c < exposures_.size(); ++c) {
    if (capture_.cameras[c].split != "train") continue;
    for (size_t i = 0; i < 12; ++i) {
      exposures_[c].value[i] -= mean[i] / cameras - static_cast<double>(kIdentity[i]);
    }
  }
}

void Trainer::guard(const StepReport& report, const StepOutput& output,
                    const std::vector<uint32_t>& views) {
  const bool is_finite = output.finite && std::isfinite(report.loss);
  state_.lost = is_finite ? 0 : state_.lost + 1;
  if (is_finite) {
    const bool is_high = state_.loss_average > 0 && report.loss > kHighLoss * state_.loss_average;
    state_.high_losses = is_high ? state_.high_losses + 1 : 0;
    // The average does not follow losses that are out of bounds.
    if (state_.loss_average == 0) state_.loss_average = report.loss;
    if (!is_high) state_.loss_average += kLossAverage * (report.loss - state_.loss_average);
  }
  if (state_.lost < kMaxLost && state_.high_losses < kMaxHighLosses) return;
  size_t worst = 0;
  for (size_t k = 0; k < views.size(); ++k) {
    const double loss = output.views[k].loss(0.2);
    if (!std::isfinite(loss)) {
      worst = k;
      break;
    }
    if (loss > output.views[worst].loss(0.2)) worst = k;
  }
  throw Diverged(report.step, name_of(views[worst]));
}

std::string Trainer::name_of(uint32_t view) const {
  const CaptureView& v = capture_.views[view];
  return capture_.cameras[v.camera].name + ", frame " + std::to_string(v.frame);
}

void Trainer::watch_cameras(const StepOutput& output, const std::vector<uint32_t>& views) {
  for (size_t k = 0; k < views.size(); ++k) {
    double& average = state_.camera_loss[capture_.views[views[k]].camera];
    const double loss = output.views[k].loss(0.2);
    average = average == 0 ? loss : average + kLossAverage * (loss - average);
  }
  if (state_.step != kWatchFrom) return;
  std::vector<double> seen;
  for (const double loss : state_.camera_loss) {
    if (loss > 0) seen.push_back(loss);
  }
  if (seen.size() < 4) return;
  std::nth_element(seen.begin(), seen.begin() + static_cast<ptrdiff_t>(seen.size() / 2),
                   seen.end());
  const double median = seen[seen.size() / 2];
  for (size_t c = 0; c < state_.camera_loss.size(); ++c) {
    if (state_.camera_loss[c] <= kUnsynchronised * median) continue;
    notes_.push_back("The error of " + capture_.cameras[c].name + " is " +
                     std::to_string(state_.camera_loss[c] / median) +
                     " times that of the median camera: is it synchronised and calibrated?");
  }
}

DensityChange Trainer::change_density(uint64_t step, double f) {
  DensityChange change;
  if (settings_.density == "off") return change;
  const double total = settings_.seconds > 0 ? 1e9 : static_cast<double>(settings_.steps);
  const double begin = std::min(kDensityBegin, total / 10);
  prune(f);
  settle(f);
  if (f >= kDensityEnd) {
    if (!state_.swept) sweep(step);
    state_.swept = true;
    return change;
  }
  if (step % kCycle == 0) backend_->renew_weights(static_cast<float>(settings_.error_weight));
  if (static_cast<double>(step) < begin || step % settings_.density_every != 0) return change;
  const uint32_t cycle = kCycle / settings_.density_every;
  return settings_.density == "gradient" ? follow_gradients(step, f, cycle) : relocate(step, cycle);
}

// Rows to add after a step, at most.
uint64_t Trainer::growth_at(uint64_t step) const {
  const uint64_t every = settings_.density_every;
  const double per_step = kGrowth / kCycle * static_cast<double>(backend_->count());
  const double before = std::floor(per_step * static_cast<double>(step - every));
  uint64_t growth =
      static_cast<uint64_t>(std::floor(per_step * static_cast<double>(step)) - before);
  if (state_.prunes > 0) growth = 0;  // what is removed does not come back
  growth = std::min(growth, settings_.gaussians - std::min(settings_.gaussians, count()));
  if (residence_ == nullptr) return growth;
  // The rows of the next windows need capacity, too, and there may be more of them: where they once
  // did not fit, the model has grown enough.
  if (state_.windows != 0) return 0;
  const auto most = static_cast<uint64_t>(kGrowUpTo * static_cast<double>(residence_->capacity()));
  return std::min(growth, most - std::min(most, backend_->count()));
}

void Trainer::renew_residence() {
  const uint64_t period = store_->period() + 1;
  residence_->come_home();
  if (period == state_.period && state_.step % kCycle != 0) return;
  while (!residence_->renew(intervals_of(times_, store_->instants()), state_.step)) {
    if (store_->windows() <= 1) fail_for_capacity();
    store_->use_windows(store_->windows() - 1);
    state_.windows = store_->windows();
    notes_.push_back(
        "The Gaussians of the images in memory do not fit in the back end (" +
        std::to_string(residence_->needed()) + " of " + std::to_string(residence_->capacity()) +
        "): steps from " + std::to_string(state_.step + 1) + " on draw from " +
        std::to_string(state_.windows) + " windows of images, and no Gaussians are added any more");
  }
  state_.period = period;
  backend_->renew_weights(static_cast<float>(state_.step < kCycle ? 0 : settings_.error_weight));
}

void Trainer::fail_for_capacity() const {
  throw CapacityError("step " + std::to_string(state_.step + 1) + ": one window of images needs " +
                      std::to_string(residence_->needed()) +
                      " Gaussians at a time, and the back end holds " +
                      std::to_string(residence_->capacity()));
}

void Trainer::keep(ModelState model, const std::vector<uint8_t>& mask) {
  if (residence_ == nullptr) return backend_->keep(mask);
  model.keep(mask);
  residence_->place(model, capture_.timeline());
}

DensityChange Trainer::relocate(uint64_t step, uint32_t cycle) {
  const uint64_t every = settings_.density_every;
  DensityStep density;
  density.seed = settings_.seed;
  density.step = step;
  density.cycle = cycle;
  density.turn = static_cast<uint32_t>(step / every % cycle);
  density.time_begin = 0;
  density.time_end = capture_.duration();
  const uint64_t patience = 2 * steps_per_epoch();
  if (step > patience) density.unseen_since = static_cast<uint32_t>(step - patience);
  return backend_->change_density(density, growth_at(step));
}

DensityChange Trainer::follow_gradients(uint64_t step, double f, uint32_t cycle) {
  if (f >= kGradientEnd || state_.prunes > 0) return {};
  GradientStep density;
  density.seed = settings_.seed;
  density.step = step;
  density.cycle = cycle;
  density.turn = static_cast<uint32_t>(step / settings_.density_every % cycle);
  density.budget = settings_.gaussians;
  density.views = settings_.views;
  density.split_above = kSplitShare * schedule_.radius;
  density.time_end = capture_.duration();
  density.reset = step % kResetEvery == 0;
  return backend_->change_density(density);
}

void Trainer::sweep(uint64_t step) {
  ModelState whole = model();
  const uint64_t patience = 2 * steps_per_epoch();
  std::vector<uint8_t> mask(static_cast<size_t>(whole.count), 1);
  for (size_t i = 0; i < mask.size(); ++i) {
    // Steps while a row is away do not count.
    const uint64_t until = whole.away[i] == 0 ? step : whole.away[i] - 1;
    const bool unseen = whole.last_shown[i] + patience < until;
    const bool faint =
        whole.coverage[i] > 0 && static_cast<double>(whole.coverage[i]) < kMinCoverage;
    const float opacity = linear_opacity(whole.value.opacity[i], true);
    mask[i] = unseen || faint || !(opacity >= kDeadOpacity) ? 0 : 1;
  }
  if (std::any_of(mask.begin(), mask.end(), [](uint8_t kept) { return kept != 0; })) {
    keep(std::move(whole), mask);
  }
}

void Trainer::prune(double f) {
  if (settings_.codec == "off" || state_.prunes >= kPrunes) return;
  if (f < kPruneBegin + kPruneEvery * static_cast<double>(state_.prunes)) return;
  const uint64_t left = kPrunes - state_.prunes++;
  ModelState whole = model();
  double share = kPruneShare;
  std::vector<float> loss;
  if (settings_.size > 0) {
    const io::Scene scene = scene_of(whole, capture_.timeline());
    io::Weights weights = weights_of(scene, state_.prunes);
    const uint64_t bytes = trial_encode(scene, weights, settings_.preset, threads_).bytes;
    share = share_over(bytes, settings_.size, left);
    loss = loss_without(whole, std::move(weights.opacity));
  } else {
    loss = loss_without(whole, capture_, loader_, views_for_prune(),
                        rendering_of(settings_, threads_), settings_.seed + state_.prunes);
  }
  keep(std::move(whole), most_important(loss, share));
  backend_->renew_weights(static_cast<float>(settings_.error_weight));
}

std::vector<uint32_t> Trainer::views_for_prune() const {
  std::vector<uint32_t> views;
  for (uint32_t k = 0; k < capture_.views.size(); ++k) {
    if (capture_.cameras[capture_.views[k].camera].split == "train") views.push_back(k);
  }
  const size_t n = views.size(), chosen = std::min(n, kPruneViews);
  std::vector<uint32_t> measured;
  for (size_t k = 0; k < chosen; ++k) measured.push_back(views[(2 * k + 1) * n / (2 * chosen)]);
  return measured;
}

io::Weights Trainer::weights_of(const io::Scene& scene, uint64_t time) const {
  const eval::CameraViews views = views_of(capture_, loader_, "train");
  return eval::measure_importance(
             rendering_of(settings_, threads_), scene, views,
             eval::measure_options(0, views.views.size(), settings_.seed + time))
      .weights;
}

// Early enough that the rows that stay make up for those that go.
void Trainer::settle(double f) {
  if (settings_.codec != "settle" || state_.settles >= std::size(kSettleAt)) return;
  if (f < kSettleAt[state_.settles]) return;
  ++state_.settles;
  ModelState whole = model();
  const io::Scene scene = scene_of(whole, capture_.timeline());
  const io::Weights weights = weights_of(scene, state_.settles);
  keep(std::move(whole), trial_encode(scene, weights, settings_.preset, threads_).kept);
  backend_->renew_weights(static_cast<float>(settings_.error_weight));
}

bool Trainer::has_rows_to_remove() const {
  return (settings_.codec != "off" && state_.prunes < kPrunes) ||
         (settings_.codec == "settle" && state_.settles < std::size(kSettleAt));
}

void Trainer::end_early() {
  if (settings_.density != "off" && !state_.swept) sweep(state_.step);
}

std::vector<std::string> Trainer::take_notes() {
  std::vector<std::string> notes;
  notes.swap(notes_);
  return notes;
}

io::Image Trainer::render(uint32_t view) {
  const double time = capture_.time_of(view);
  const l4d_camera& camera = loader_.camera_of(view);
  if (residence_ == nullptr || residence_->visit(time)) {
    return backend_->render(camera, time, background_.data());
  }
  // More is visible then than the back end holds.
  const std::unique_ptr<Backend> host = make_cpu_backend(threads_);
  host->load(residence_->rows_at(time), capture_.timeline());
  return host->render(camera, time, background_.data());
}

}  // namespace l4d::train
