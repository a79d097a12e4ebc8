// SPDX-License-Identifier: Apache-2.0
#include "training/run/setup/settings.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <sstream>

#include "training/density/relocate.h"
#include "training/step/cuda_backend.h"

namespace l4d::train {
namespace {

using io::Error;

constexpr size_t kMinVideosForExposure = 8;
constexpr size_t kMaxDevices = 8;

// Of the radius, where all cameras look at one place, which is at least half the radius away.
constexpr double kConvergentNear = 0.2;
constexpr double kOpacityWeight = 0.015, kAlphaOpacityWeight = 0.005;

constexpr double kMaxTime = 1e8;    // s: three years
constexpr double kMaxStopAt = 100;  // dB

// Of weights and factors: where they are larger, or the largest scale is smaller, numbers of the
// training leave the range of float.
constexpr double kMaxWeight = 1000, kLeastScale = 0.0001;

// What is further off than this is beyond what steps from where it is find: `l4dtrain sync`, or
// another calibration.
constexpr double kMaxClock = 10, kMaxDegrees = 5;
// Frames. `l4dtrain sync` is within 1.2 of them.
constexpr double kClocksOfTheirOwn = 2;

// Of a training for a stream of a size: a Gaussian for each byte at most. They are several times
// those that it has room for, since the best of many are better than the same number from the
// start.
constexpr uint64_t kLeastGaussians = 1000;

constexpr const char* kNeedsCpu = "--temporal-split on needs --backend cpu";

// Of 10 s and less.
double steps_of(const std::string& effort) {
  return effort == "quick" ? 5000 : effort == "best" ? 60000 : 20000;
}

std::string number(double value) {
  char text[40];
  std::snprintf(text, sizeof(text), "%.17g", value);
  return text;
}

std::string text_of_value(const std::string& value) { return value; }
std::string text_of_value(bool value) { return value ? "1" : "0"; }
std::string text_of_value(double value) { return number(value); }
std::string text_of_value(uint32_t value) { return std::to_string(value); }
std::string text_of_value(uint64_t value) { return std::to_string(value); }

bool is_one_of(const std::string& value, std::initializer_list<const char*> list) {
  return std::any_of(list.begin(), list.end(), [&](const char* item) { return value == item; });
}

// Sums of views are rounded by device, so the number of devices decides the bits.
bool same_number(const std::string& devices, const std::string& others) {
  const auto count = [](const std::string& list) {
    return std::max<size_t>(devices_of(list).size(), 1);
  };
  return count(devices) == count(others);
}

}  // namespace

std::vector<uint32_t> devices_of(const std::string& list) {
  std::vector<uint32_t> devices;
  std::istringstream in(list);
  for (std::string item; std::getline(in, item, ',');) {
    const bool is_number = !item.empty() && item.size() <= 3 &&
                           item.find_first_not_of("0123456789") == std::string::npos;
    if (!is_number) devices.resize(kMaxDevices);  // refused below
    devices.push_back(is_number ? static_cast<uint32_t>(std::stoul(item)) : 0);
  }
  if (devices.size() > kMaxDevices || (!list.empty() && list.back() == ',')) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "--devices is " + list + "; it must be 1 to 8 numbers of devices: 0,1");
  }
  return devices;
}

std::string text_of(const Settings& settings) {
  std::string out;
  for_each_setting(settings, [&](const char* name, const auto& value) {
    out += std::string(name) + " " + text_of_value(value) + "\n";
  });
  return out;
}

Settings defaults_of_before() {
  Settings s;
  s.near = 0;
  s.refine_times = 0;
  return s;
}

std::string differences(const std::string& before, const Settings& now, bool accept_changes) {
  std::map<std::string, std::string> old;  // whole lines by name
  const auto value_of = [](const std::string& line) {
    return line.substr(std::min(line.size(), line.find(' ') + 1));
  };
  const bool names_resident = before.find("\nresident ") != std::string::npos;
  std::istringstream lines(text_of(defaults_of_before()) + before);
  for (std::string line; std::getline(lines, line);) old[line.substr(0, line.find(' '))] = line;
  // Wherever it lies now.
  const bool same_capture =
      !now.capture_hash.empty() && old["capture_hash"] == "capture_hash " + now.capture_hash;
  std::string out;
  for_each_setting(now, [&](const char* name, const auto& value) {
    const std::string key = name, line = key + " " + text_of_value(value);
    if (old[key] == line || (key == "preset" && now.codec != "settle" && now.size == 0)) return;
    if (key == "any_path") return;       // only whether the capture may be read
    if (key == "device_memory") return;  // `resident` decides what is trained
    if (key == "quality") return;        // decides the stream alone
    if (key == "stop_at") return;        // only how many of the same steps there are
    if (key == "capture_hash" && accept_changes) return;
    if (key == "capture" && (accept_changes || same_capture)) return;
    if (key == "resident" && accept_changes && is_partly_away(now)) return;
    if (key == "resident" && !names_resident && !is_partly_away(now)) return;
    if (key == "devices" && same_number(value_of(old[key]), now.devices)) return;
    out += out.empty() ? "" : "; ";
    if (key == "capture_hash") {
      out += "the capture is not as it was, and --accept-changes goes on all the same";
    } else {
      out += "it has \"" + old[key] + "\", and now it is \"" + line + "\"";
    }
  });
  return out;
}

void check(const Settings& s) {
  const auto fail = [](const std::string& what) { throw Error(L4D_ERR_INVALID_ARGUMENT, what); };
  check(s.reading);
  if (!(s.scale > 0 && s.scale <= 1))
    fail("--scale is " + number(s.scale) + "; it must be above 0 and at most 1");
  if (s.sh_degree > 3)
    fail("--sh-degree is " + std::to_string(s.sh_degree) + "; it must be 0 to 3");
  if (!is_one_of(s.exposure, {"auto", "on", "off"}))
    fail("--exposure is " + s.exposure + "; it must be auto, on or off");
  if (!is_one_of(s.effort, {"quick", "good", "best"}))
    fail("--effort is " + s.effort + "; it must be quick, good or best");
  if (!is_one_of(s.density, {"relocate", "gradient", "off"}))
    fail("--density is " + s.density + "; it must be relocate, gradient or off");
  if (!is_one_of(s.temporal_split, {"on", "off"}))
    fail("--temporal-split is " + s.temporal_split + "; it must be on or off");
  if (s.temporal_split == "on" && s.density != "relocate")
    fail("--temporal-split on needs --density relocate");
  if (s.density_every == 0 || kCycle % s.density_every != 0) {
    fail("--density-every is " + std::to_string(s.density_every) + "; it must divide " +
         std::to_string(kCycle));
  }
  if (!is_one_of(s.codec, {"off", "prune", "settle"}))
    fail("--codec is " + s.codec + "; it must be off, prune or settle");
  if (s.codec != "off" && s.density == "off")
    fail("--codec " + s.codec + " needs --density relocate or gradient");
  if (!is_one_of(s.adam, {"auto", "dense", "sparse"}))
    fail("--adam is " + s.adam + "; it must be auto, dense or sparse");
  if (!is_one_of(s.backend, {"auto", "cpu", "cuda"}))
    fail("--backend is " + s.backend + "; it must be auto, cpu or cuda");
  if (s.backend == "cuda" && s.temporal_split == "on") fail(kNeedsCpu);
  if (!devices_of(s.devices).empty() && s.backend == "cpu")
    fail("--devices is " + s.devices + "; --backend cpu uses no device");
  if (!(s.seconds >= 0 && s.seconds <= kMaxTime))
    fail("--time is " + number(s.seconds) + "; it must be at most " + number(kMaxTime));
  if (s.seconds > 0 && s.steps > 0) fail("--time and --steps exclude each other");
  if (!(s.stop_at >= 0 && s.stop_at <= kMaxStopAt)) {
    fail("--stop-at is " + number(s.stop_at) + "; it must be above 0 and at most " +
         number(kMaxStopAt));
  }
  if (s.steps > 100000000) fail("--steps is above 100000000");
  if (s.gaussians > 100000000) fail("--gaussians is above 100000000");
  if (s.resident > 100000000) fail("--resident is above 100000000");
  if (s.views > 256) fail("--views is above 256");
  const auto need = [&](const char* option, double value, double least, double most = kMaxWeight) {
    if (value >= least && value <= most) return;
    fail(std::string(option) + " is " + number(value) + "; it must be " + number(least) + " to " +
         number(most));
  };
  if (s.refine_times != kAuto) need("--refine-times", s.refine_times, 0, kMaxClock);
  need("--refine-cameras", s.refine_cameras, 0, kMaxDegrees);
  need("--drift", s.drift, 0);
  need("--error-weight", s.error_weight, 0);
  need("--scale-weight", s.scale_weight, 0);
  need("--entropy-weight", s.entropy_weight, 0);
  need("--consistency-weight", s.consistency_weight, 0);
  need("--max-scale", s.max_scale, kLeastScale);
  if (s.opacity_weight != kAuto) need("--opacity-weight", s.opacity_weight, 0);
  if (!(s.near == kAuto || (s.near >= 0 && s.near < 10)))
    fail("--near is " + number(s.near) + "; it must be auto, or 0 to 10");
}

double near_of(const Settings& settings, const Capture& capture) {
  if (settings.near != kAuto) return settings.near;
  return look_at_one_place(capture) ? kConvergentNear : 0;
}

double refine_times_of(const Settings& settings, const Capture& capture) {
  if (settings.refine_times != kAuto) return settings.refine_times;
  const bool own_clocks =
      std::any_of(capture.cameras.begin(), capture.cameras.end(),
                  [](const CaptureCamera& c) { return c.source.time_offset != 0; });
  return own_clocks ? kClocksOfTheirOwn : 0;
}

double opacity_weight_of(const Settings& settings, bool has_alpha) {
  if (settings.opacity_weight != kAuto) return settings.opacity_weight;
  return has_alpha ? kAlphaOpacityWeight : kOpacityWeight;
}

Settings resolved(const Settings& settings, const Capture& capture, uint32_t width,
                  uint32_t height) {
  Settings s = settings;
  const double length = std::max(1.0, capture.duration() / 10);
  if (s.steps == 0 && s.seconds == 0) {
    s.steps = static_cast<uint64_t>(steps_of(s.effort) * std::pow(length, 0.9));
  }
  if (s.gaussians == 0) {
    const double pixels = static_cast<double>(width) * height;
    s.gaussians = static_cast<uint64_t>(
        std::max(200e3, 0.5 * pixels * std::pow(capture.duration() / 10, 0.55)));
    if (s.size > 0) s.gaussians = std::min(s.gaussians, std::max(s.size, kLeastGaussians));
  }
  size_t most = 0, run = 0, videos = 0;
  for (size_t k = 0; k < capture.views.size(); ++k) {
    run = k > 0 && capture.views[k].time == capture.views[k - 1].time ? run + 1 : 1;
    most = std::max(most, run);
  }
  if (s.views == 0) s.views = static_cast<uint32_t>(std::min<size_t>(most, 4));
  for (const CaptureCamera& camera : capture.cameras) {
    videos += camera.is_video() && camera.split == "train" ? 1U : 0U;
  }
  if (s.exposure == "auto") s.exposure = videos >= kMinVideosForExposure ? "on" : "off";
  if (s.backend == "auto") s.backend = has_cuda_backend() ? "cuda" : "cpu";
  if (s.backend == "cuda" && s.devices.empty()) s.devices = "0";
  if (s.backend == "cpu" && !s.devices.empty()) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "--devices is " + s.devices + ", but there is no usable CUDA device");
  }
  if (s.backend == "cuda" && s.temporal_split == "on") {
    throw Error(L4D_ERR_INVALID_ARGUMENT, kNeedsCpu);
  }
  s.near = near_of(settings, capture);
  s.refine_times = refine_times_of(settings, capture);
  if (s.init == "auto" && !capture.points.empty()) s.init = "capture";
  if (s.init == "auto" && !capture.points_file.empty()) s.init = capture.points_file;
  return s;
}

}  // namespace l4d::train
