// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "training/capture/capture.h"

namespace l4d::train {

constexpr double kAuto = -1;

// What decides the result of a training, besides the capture. A checkpoint remembers it.
struct Settings {
  std::string capture;       // path; of a run that has begun, an absolute one
  std::string capture_hash;  // of a run that has begun: hash_of() what it began with
  CaptureOptions reading;
  double scale = 1;             // of images
  uint64_t gaussians = 0;       // N_max; 0 = from the images and the duration
  uint64_t steps = 0;           // 0 = from the duration, or as many as `seconds` allow
  std::string effort = "good";  // quick, good, best: how many steps are taken from the duration
  double seconds = 0;           // > 0: the clock decides when the training ends
  double stop_at = 0;           // dB of held-out, else training views that end it; 0 = none
  uint32_t views = 0;           // of a step; 0 = 4, or 1 for a moving camera
  std::string init = "auto";    // auto, frustum, hull, or points: a PLY, or a folder
  uint32_t sh_degree = 3;
  std::string exposure = "auto";       // auto, on, off
  std::string density = "relocate";    // relocate, gradient, off
  std::string temporal_split = "off";  // on, off
  uint32_t density_every = 1;          // steps between two changes of the density
  std::string codec = "off";           // off, prune, settle
  std::string preset;                  // of the encoder; "" = no stream
  uint64_t size = 0;                   // of the stream, bytes at most; 0 = by its quality
  double quality = 0;                  // of the stream, dB; 0 = that of the preset
  std::string adam = "auto";           // auto, dense, sparse
  std::string backend = "auto";        // auto, cpu, cuda
  std::string devices;                 // of cuda: "0,1"; "" = the first
  double drift = 2;                    // kappa
  double error_weight = 1;             // beta
  double near = kAuto;                 // cameras see nothing nearer, in units of their radius
  double opacity_weight = kAuto;       // regularisers: of the mean opacity
  double scale_weight = 0.05;          // of the mean scale, in units of the radius
  double entropy_weight = 0;           // of the mean entropy of opacities
  double consistency_weight = 0;       // of how far neighbours' velocities are apart
  double max_scale = 1;                // of Gaussians, of the radius
  // Bounds of what is found of training cameras while they train; 0 = they stay as they are.
  double refine_times = kAuto;               // frames, of clocks
  double refine_cameras = 0;                 // degrees, of places and lenses
  uint64_t host_memory = uint64_t{8} << 30;  // bytes of images
  uint64_t device_memory = 0;                // bytes of the back end; 0 = auto
  uint64_t resident = 0;                     // Gaussians in the back end at most; 0 = auto
  uint64_t seed = 0;
};

// Calls f(name, value) for each of the settings, in a fixed order: what files say of a run. S:
// Settings or const Settings.
template <typename S, typename F>
void for_each_setting(S& s, F&& f) {
  f("capture", s.capture);
  f("capture_hash", s.capture_hash);
  f("seconds", s.reading.seconds);
  f("fps", s.reading.fps);
  f("frames", s.reading.frames);
  f("test", s.reading.test);
  f("tolerant", s.reading.tolerant);
  f("any_path", s.reading.any_path);
  f("scale", s.scale);
  f("gaussians", s.gaussians);
  f("steps", s.steps);
  f("effort", s.effort);
  f("time", s.seconds);
  f("stop_at", s.stop_at);
  f("views", s.views);
  f("init", s.init);
  f("sh_degree", s.sh_degree);
  f("exposure", s.exposure);
  f("density", s.density);
  f("temporal_split", s.temporal_split);
  f("density_every", s.density_every);
  f("codec", s.codec);
  f("preset", s.preset);
  f("size", s.size);
  f("quality", s.quality);
  f("adam", s.adam);
  f("backend", s.backend);
  f("devices", s.devices);
  f("drift", s.drift);
  f("error_weight", s.error_weight);
  f("near", s.near);
  f("opacity_weight", s.opacity_weight);
  f("scale_weight", s.scale_weight);
  f("entropy_weight", s.entropy_weight);
  f("consistency_weight", s.consistency_weight);
  f("max_scale", s.max_scale);
  f("refine_times", s.refine_times);
  f("refine_cameras", s.refine_cameras);
  f("host_memory", s.host_memory);
  f("device_memory", s.device_memory);
  f("resident", s.resident);
  f("seed", s.seed);
}

// One line "name value" for each: what checkpoints have.
std::string text_of(const Settings& settings);
// The numbers of Settings::devices, 1 to 8 of them; none where it is empty. Throws
// io::Error(INVALID_ARGUMENT).
std::vector<uint32_t> devices_of(const std::string& list);
// What a setting is that the files of an earlier version do not name: its default, but that cameras
// had no near plane.
Settings defaults_of_before();
// What keeps a run from going on with other settings than those of `before`, a text as above; ""
// where nothing does. Settings that it does not name have the value of defaults_of_before(), and
// without a `resident` all Gaussians are in the back end. The preset counts only where the training
// depends on it, the capture_hash unless accept_changes, the path of the capture unless
// accept_changes or the hash is the same, and of the devices only how many there are.
std::string differences(const std::string& before, const Settings& now, bool accept_changes);
// Not all of the model is in the back end at a time.
inline bool is_partly_away(const Settings& settings) {
  return settings.resident != 0 && settings.resident < settings.gaussians;
}
// Throws io::Error(INVALID_ARGUMENT) where a setting is out of range.
void check(const Settings& settings);
// Settings::near, with the rule for what is auto: 0.2 where cameras look at one place, so that
// nothing is there, else 0.
double near_of(const Settings& settings, const Capture& capture);
// Settings::refine_times likewise: 2 where the capture has time offsets, else 0.
double refine_times_of(const Settings& settings, const Capture& capture);
// Settings::opacity_weight, with the rule for what is auto. has_alpha: of the images, which then
// are empty for the most part; their mean loss is small, and so is the weight beside it.
double opacity_weight_of(const Settings& settings, bool has_alpha);
// Fills what is 0 or "auto" in, but for `resident` and `adam` (run/capacity.h), from the capture
// and the size of its images.
Settings resolved(const Settings& settings, const Capture& capture, uint32_t width,
                  uint32_t height);

}  // namespace l4d::train
