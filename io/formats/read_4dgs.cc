// SPDX-License-Identifier: Apache-2.0
// .4dgs of version 1: Gaussians that move along straight lines and fade around a time of their own,
// or stay within a window. The first kind is exactly a 4D-rotor Gaussian, the second a flat window.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "io/formats/fdgs_records.h"
#include "io/formats/inflate.h"
#include "io/formats/readers.h"
#include "io/ply/read_ply.h"
#include "io/scene/statements.h"
#include "libl4dcodec/scene/sh.h"
#include "libl4dcodec/scene/slice.h"

namespace l4d::io {
namespace {

constexpr double kRadians = 0.017453292519943295;  // of a degree
constexpr double kNever = std::numeric_limits<double>::infinity();

// What the numbers of a Gaussian are before they become those of a scene.
struct BornGaussian {
  Vec3 position, scale, velocity;
  Vec4 wxyz;
  double time = 0, sigma = kNever;
  fdgs::Window window;
};

class FdgsReader {
 public:
  FdgsReader(InputFile* input, const ImportOptions& options)
      : path_(input->path()),
        options_(options),
        bytes_(read_counted(input, options.holder, &file_memory_)),
        file_(fdgs::walk_records(bytes_, path_)) {}

  Scene read() {
    scene_.source = "4dgs";
    scene_.flags = L4D_POSITION_AT_MEAN_TIME;
    scene_.sh_degree = file_.sh_degree;
    const uint64_t row = numbers_per_gaussian(file_.sh_degree) * sizeof(float) + 8;
    if (file_.count > UINT64_MAX / 4096) fail("it promises too many Gaussians");
    std::shared_ptr<void> memory = hold(options_.holder, file_.count * row, path_);
    read_clock();
    read_placement();
    read_view();
    scene_.resize(static_cast<size_t>(file_.count));
    scene_.window.resize(2 * scene_.count());
    kept_.assign(scene_.count(), 1);
    size_t first = 0;
    for (const fdgs::ChunkPlace& chunk : file_.chunks) {
      read_chunk(chunk, first);
      first += chunk.count;
    }
    finish();
    scene_.memory = std::move(memory);
    return std::move(scene_);
  }

 private:
  [[noreturn]] void fail(const std::string& message) const {
    throw Error(L4D_ERR_CORRUPT, path_ + ": " + message);
  }
  double fps() const {
    return static_cast<double>(scene_.timeline.fps_num) / scene_.timeline.fps_den;
  }

  // The first of these rates whose frames begin where windows do.
  double rate_of_windows() const {
    constexpr double kRates[] = {30, 24, 25, 60, 50, 15, 20, 10, 12, 48, 90, 100, 120};
    const auto on_frames = [&](double rate) {
      return std::all_of(file_.windows.begin(), file_.windows.end(),
                         [&](const fdgs::Window& window) {
                           const double end = std::min(window.end, file_.seconds);
                           const double begin = std::max(window.begin, 0.0);
                           return std::fabs(begin * rate - std::round(begin * rate)) < 1e-3 &&
                                  std::fabs(end * rate - std::round(end * rate)) < 1e-3;
                         });
    };
    const auto* found = std::find_if(std::begin(kRates), std::end(kRates), on_frames);
    return found == std::end(kRates) ? kRates[0] : *found;
  }

  // The format has no place for it, so that programs write what they want under this name.
  bool read_frame_rate() {
    const auto stated = file_.attributes.find(fdgs::kFrameRate);
    if (stated == file_.attributes.end()) return false;
    const char* text = stated->second.c_str();
    try {
      read_stated_fps([&](const std::string& key) { return key == "fps" ? text : nullptr; },
                      &scene_.timeline);
      return true;
    } catch (const Error&) {
      return false;
    }
  }

  void read_clock() {
    if (!(file_.seconds > 0 && std::isfinite(file_.seconds))) {
      return set_default_timeline(scene_, options_);
    }
    if (options_.fps > 0) {
      set_fps(scene_.timeline, options_.fps);
    } else if (!read_frame_rate()) {
      set_fps(scene_.timeline, rate_of_windows());
      char note[120];
      std::snprintf(note, sizeof(note),
                    "The file has no frame rate; %g frames per second were assumed.", fps());
      scene_.notes.push_back(note);
    }
    try {
      set_duration(scene_.timeline, file_.seconds);
    } catch (const Error& error) {
      fail(error.what());
    }
    const double seconds = duration(scene_.timeline);
    if (std::fabs(seconds - file_.seconds) > 1e-6 * file_.seconds) {
      char note[160];
      std::snprintf(note, sizeof(note),
                    "The duration of %g seconds is no whole number of frames; it became %g "
                    "seconds.",
                    file_.seconds, seconds);
      scene_.notes.push_back(note);
    }
  }

  void read_placement() {
    scene_.placement.coordinate_system = file_.coordinate_system;
    scene_.presentation.metres_per_unit = file_.metres_per_unit;
    if (file_.has_other_axes) {
      scene_.notes.push_back("The axes of the file have no name here; they are taken as unknown.");
    }
    const auto space = file_.attributes.find(fdgs::kColorSpace);
    if (space != file_.attributes.end() && space->second == fdgs::kLinearColors) {
      scene_.placement.color_space = L4D_COLOR_LINEAR_SRGB;
    }
    if (!file_.unread.empty()) {
      scene_.notes.push_back("The file has more that was not read: " + list_of_names(file_.unread) +
                             ".");
    }
  }

  // The format says nothing of what is up, but where it is an axis; a view along it is left out.
  void read_view() {
    const fdgs::FirstView& view = file_.view;
    Vec3 along;
    for (size_t k = 0; k < 3; ++k) along[k] = view.target[k] - view.position[k];
    const double fov = view.fov_degrees * kRadians, length = std::sqrt(dot(along, along));
    if (!(fov > 0 && fov < 3 && std::isfinite(length))) return;
    if (!(std::hypot(along[0], along[2]) > 1e-3 * length)) return;
    l4d_presentation& p = scene_.presentation;
    const bool is_down = file_.coordinate_system == L4D_COORDINATES_RIGHT_DOWN_FORWARD;
    p.has_camera = 1;
    p.camera_fov = fov;
    p.camera_up[1] = is_down ? -1 : 1;
    std::copy_n(view.position.begin(), 3, p.camera_position);
    std::copy_n(view.target.begin(), 3, p.camera_target);
  }

  void read_chunk(const fdgs::ChunkPlace& chunk, size_t first) {
    if (chunk.count == 0) return;
    // Integers of all attributes, and once more the widest of them with the bytes it comes from.
    constexpr uint64_t kNumbers = 22, kWidest = 48;
    const uint64_t expanded = chunk.compression.empty() ? 0 : 2 * chunk.expanded;
    if (chunk.expanded > UINT64_MAX / 4) fail("a chunk promises too many bytes");
    const std::shared_ptr<void> memory =
        hold(options_.holder, expanded + chunk.count * (kNumbers * sizeof(int32_t) + kWidest * 5),
             path_);
    std::vector<uint8_t> block;
    if (!chunk.compression.empty()) block = expand_block(chunk);
    fdgs::Fields fields(chunk.compression.empty() ? chunk.data : block.data(), chunk.expanded,
                        path_);
    read_streams(chunk, &fields);
    for (size_t i = 0; i < chunk.count; ++i) {
      const BornGaussian g = gaussian(i);
      store_color(first + i, i);
      store_time(first + i, g);
    }
    for (uint32_t band = 1; band <= file_.sh_degree; ++band) {
      store_band(band, fdgs::expand_stream(chunk.bands[band - 1], path_), first, chunk.count);
    }
  }

  std::vector<uint8_t> expand_block(const fdgs::ChunkPlace& chunk) const {
    const size_t size = static_cast<size_t>(chunk.bytes);
    std::vector<uint8_t> block;
    if (chunk.compression == "zstd") {
      block = expand_zstd(chunk.data, size, chunk.expanded + 1, path_);
    } else if (chunk.compression == "deflate") {
      block = expand_zlib(chunk.data, size, chunk.expanded + 1, path_);
    } else {
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED, path_ + ": the compression '" + chunk.compression +
                                                   "' of .4dgs; zstd and deflate are read");
    }
    if (block.size() != chunk.expanded) fail("a chunk has another length than it states");
    return block;
  }

  void read_streams(const fdgs::ChunkPlace& chunk, fdgs::Fields* fields) {
    bins_ = {};
    while (fields->left() > 0) {
      const fdgs::PackedStream stream = fdgs::next_stream(fields);
      const bool is_object = stream.attribute == fdgs::kObjectId;
      if (stream.attribute >= fdgs::kRequiredAttributes && !is_object) continue;
      if (stream.count != chunk.count ||
          stream.channels != (is_object ? 1 : fdgs::kChannels[stream.attribute])) {
        fail("attribute " + std::to_string(stream.attribute) + " does not fit its chunk");
      }
      if (is_object) {
        refuse_moved(fdgs::expand_stream(stream, path_));
        continue;
      }
      fdgs::Bins& bins = bins_[stream.attribute];
      if (!bins.values.empty()) {
        fail("a chunk has attribute " + std::to_string(stream.attribute) + " twice");
      }
      bins = fdgs::expand_stream(stream, path_);
    }
    for (size_t k = 0; k < bins_.size(); ++k) {
      if (bins_[k].values.empty()) fail("a chunk lacks attribute " + std::to_string(k));
    }
  }

  void refuse_moved(const fdgs::Bins& objects) const {
    for (const int32_t object : objects.values) {
      if (file_.moved_objects.count(static_cast<uint32_t>(object)) == 0) continue;
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                  path_ + ": object " + std::to_string(static_cast<uint32_t>(object)) +
                      " of the .4dgs file moves along a track; Gaussians that move by themselves "
                      "are read");
    }
  }

  const fdgs::Bins& bins(fdgs::AttributeId id) const { return bins_[id]; }

  BornGaussian gaussian(size_t i) const {
    const fdgs::Grids& grids = file_.grids;
    BornGaussian g;
    const int32_t index = bins(fdgs::kWindowIndex).at(i);
    if (index < 0 || static_cast<size_t>(index) >= file_.windows.size()) {
      fail("window " + std::to_string(index) + " of a Gaussian; there are " +
           std::to_string(file_.windows.size()));
    }
    g.window = file_.windows[static_cast<size_t>(index)];
    if ((bins(fdgs::kFlags).at(i) & fdgs::kNeverFades) == 0) {
      g.sigma = std::exp(bins(fdgs::kSigma).at(i) * grids.sigma_log);
    }
    const double motion =
        fdgs::motion_step(grids, file_.cutoff, g.sigma, g.window.end - g.window.begin);
    g.time = bins(fdgs::kMeanTime).at(i) * fdgs::time_step(grids, g.sigma);
    for (size_t k = 0; k < 3; ++k) {
      g.position[k] = grids.origin[k] + bins(fdgs::kPosition).at(i, k) * grids.position;
      g.scale[k] = bins(fdgs::kScale).at(i, k) * grids.scale_log;  // its logarithm
      g.velocity[k] = bins(fdgs::kMotion).at(i, k) * motion;
    }
    g.wxyz = rotation(i);
    return g;
  }

  // Three numbers of x y z w; the largest follows from them.
  Vec4 rotation(size_t i) const {
    const int32_t largest = bins(fdgs::kRotationIndex).at(i);
    if (largest < 0 || largest > 3) fail("a rotation leaves out a number that it does not have");
    Vec4 xyzw{};
    double sum = 0;
    for (size_t k = 0, from = 0; k < 4; ++k) {
      if (k == static_cast<size_t>(largest)) continue;
      xyzw[k] = bins(fdgs::kRotation).at(i, from++) * file_.grids.rotation;
      sum += xyzw[k] * xyzw[k];
    }
    xyzw[static_cast<size_t>(largest)] = std::sqrt(std::max(0.0, 1 - sum));
    return {xyzw[3], xyzw[0], xyzw[1], xyzw[2]};
  }

  void store_color(size_t to, size_t i) {
    const fdgs::Bins& color = bins(fdgs::kColor);  // green, red less green, blue less green
    const double green = color.at(i, 0);
    const double rgb[3] = {green + color.at(i, 1), green, green + color.at(i, 2)};
    for (size_t k = 0; k < 3; ++k) {
      scene_.sh[3 * scene_.sh_coefficients() * to + k] = static_cast<float>(
          (rgb[k] * file_.grids.color - 0.5) / static_cast<double>(sh_constant::k0));
    }
    const double opacity = bins(fdgs::kOpacity).at(i) * file_.grids.opacity;
    scene_.opacity[to] = static_cast<float>(std::clamp(opacity, 0.0, 1.0));
  }

  void store_band(uint32_t band, const fdgs::Bins& bytes, size_t first, size_t count) {
    const size_t numbers = 2 * size_t{band} + 1;
    for (size_t i = 0; i < count; ++i) {
      float* sh = &scene_.sh[3 * scene_.sh_coefficients() * (first + i)];
      for (size_t c = 0; c < 3; ++c) {
        for (size_t k = 0; k < numbers; ++k) {
          const int32_t byte = bytes.at(i, numbers * c + k);
          if (byte < 0 || byte > 255) fail("a spherical harmonic is no byte");
          sh[3 * (size_t{band} * band + k) + c] =
              static_cast<float>(fdgs::kLeastHarmonic + byte * fdgs::kHarmonicStep);
        }
      }
    }
  }

  void store_time(size_t to, BornGaussian g) {
    const double seconds = duration(scene_.timeline);
    const bool fades = g.sigma != kNever;
    const bool whole = g.window.begin <= 0 && g.window.end >= std::min(seconds, file_.seconds);
    if (!(g.window.begin < g.window.end) || !(g.window.end > 0) || !(g.window.begin < seconds)) {
      kept_[to] = 0;
      ++unseen_;
      return;
    }
    if (fades) {
      note_cut(to, g);
    } else if (whole) {
      move_to(seconds / 2, &g);
      g.sigma = 16 * seconds;
      ++lasting_;
    } else if (!set_window(to, &g)) {
      return;
    }
    store(to, g);
  }

  // A Gaussian that is not at its mean time, with a position at another.
  static void move_to(double time, BornGaussian* g) {
    for (size_t k = 0; k < 3; ++k) g->position[k] += g->velocity[k] * (time - g->time);
    g->time = time;
  }

  // False where it falls between two frames.
  bool set_window(size_t to, BornGaussian* g) {
    const double last = scene_.timeline.num_frames;
    const double begin = std::clamp(std::round(g->window.begin * fps()), 0.0, last);
    const double end = std::clamp(std::round(g->window.end * fps()), 0.0, last);
    if (!(begin < end)) {
      kept_[to] = 0;
      ++unseen_;
      return false;
    }
    const double moved =
        std::max(std::fabs(begin / fps() - std::max(g->window.begin, 0.0)),
                 std::fabs(end / fps() - std::min(g->window.end, duration(scene_.timeline))));
    if (moved > 1e-6) ++rounded_;
    most_rounded_ = std::max(most_rounded_, moved);
    scene_.window[2 * to] = static_cast<uint32_t>(begin);
    scene_.window[2 * to + 1] = static_cast<uint32_t>(end);
    has_windows_ = true;
    move_to((begin + end) / 2 / fps(), g);
    g->sigma = 1 / fps();  // that of a frame; a window shows nothing of it
    return true;
  }

  // How much of its opacity a Gaussian has left where its window ends it.
  void note_cut(size_t to, const BornGaussian& g) {
    double left = 0;
    for (const double edge : {g.window.begin, g.window.end}) {
      if (!(edge > 0 && edge < duration(scene_.timeline))) continue;
      left = std::max(left, falloff(1 / (g.sigma * g.sigma), edge - g.time));
    }
    if (left <= std::max(file_.cutoff, 1.0 / 255)) return;
    ++cut_;
    most_cut_ = std::max(most_cut_, left * static_cast<double>(scene_.opacity[to]));
  }

  void store(size_t to, const BornGaussian& g) {
    for (size_t k = 0; k < 3; ++k) {
      scene_.position[3 * to + k] = static_cast<float>(g.position[k]);
      scene_.log_scale[4 * to + k] = static_cast<float>(g.scale[k]);
    }
    raised_ += raise_flat_scale(&scene_.log_scale[4 * to]);
    scene_.mean_t[to] = static_cast<float>(g.time);
    Vec3 scale;
    for (size_t k = 0; k < 3; ++k) {
      scale[k] = std::exp(static_cast<double>(scene_.log_scale[4 * to + k]));
    }
    if (g.velocity == Vec3{0, 0, 0}) {
      store_still_shape(scene_, to, g.wxyz, g.sigma);
    } else if (all_finite(g.wxyz.data(), 4) && all_finite(scale.data(), 3) &&
               all_finite(g.velocity.data(), 3) && all_finite(&g.sigma, 1) && g.sigma > 0) {
      store_shape(scene_, to,
                  shape_of_moving(quaternion_to_matrix(g.wxyz), scale, g.velocity, g.sigma));
    } else {
      store_invalid_shape(scene_, to);
    }
  }

  void note(uint64_t count, const char* form, double size = 0) {
    if (count == 0) return;
    char text[240];
    // NOLINTNEXTLINE(clang-diagnostic-format-nonliteral): all forms are in finish()
    std::snprintf(text, sizeof(text), form, static_cast<unsigned long long>(count), size);
    scene_.notes.push_back(text);
  }

  void finish() {
    if (!has_windows_) scene_.window.clear();
    if (unseen_ > 0) scene_.keep(kept_);
    note(lasting_,
         "%llu Gaussians never fade; they last 16 times the sequence: their opacity varies by less "
         "than 0.05 %%.");
    note(raised_, "%llu Gaussians had a scale below e^-16, which was raised to that.");
    note(unseen_, "%llu Gaussians whose windows show no frame were left out.");
    note(rounded_, "Windows of %llu Gaussians were rounded to frames, by up to %.3g seconds.",
         most_rounded_);
    note(
        cut_,
        "%llu Gaussians fade on where the file ends them in the midst of it, with an opacity of up "
        "to %.3g there.",
        most_cut_);
  }

  std::string path_;
  ImportOptions options_;
  std::shared_ptr<void> file_memory_;
  std::vector<uint8_t> bytes_;
  fdgs::Contents file_;
  Scene scene_;
  std::array<fdgs::Bins, fdgs::kRequiredAttributes> bins_;  // of the chunk at hand
  std::vector<uint8_t> kept_;
  bool has_windows_ = false;
  uint64_t lasting_ = 0, raised_ = 0, unseen_ = 0, rounded_ = 0, cut_ = 0;
  double most_rounded_ = 0, most_cut_ = 0;
};

}  // namespace

Scene read_4dgs(InputFile input, const ImportOptions& options) {
  return FdgsReader(&input, options).read();
}

}  // namespace l4d::io
