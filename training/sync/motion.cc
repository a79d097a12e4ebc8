// SPDX-License-Identifier: Apache-2.0
#include "training/sync/motion.h"

#include <algorithm>
#include <cmath>

#include "libl4dcodec/base/threads.h"
#include "training/images/loader.h"

namespace l4d::train {
namespace {

constexpr double kSide = 160;  // pixels of the images that are compared: what is smaller is noise
constexpr int kNoise = 4;      // of 255

std::vector<uint8_t> grey_of(const Pixels& pixels, const std::vector<uint8_t>& mask) {
  std::vector<uint8_t> grey(pixels.rgb.size() / 3);
  for (size_t i = 0; i < grey.size(); ++i) {
    if (!mask.empty() && mask[i] == 0) continue;
    const uint8_t* at = &pixels.rgb[3 * i];
    grey[i] = static_cast<uint8_t>((2 * at[0] + 5 * at[1] + at[2]) / 8);
  }
  return grey;
}

double change(const std::vector<uint8_t>& a, const std::vector<uint8_t>& b) {
  uint64_t sum = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    const int step = std::abs(int{a[i]} - int{b[i]});
    sum += step > kNoise ? static_cast<uint64_t>(step) : 0;
  }
  return static_cast<double>(sum) / static_cast<double>(a.size());
}

}  // namespace

Signal resampled(const std::vector<double>& times, const std::vector<double>& values, double rate) {
  Signal out;
  if (times.empty()) return out;
  size_t next = 0;
  for (size_t k = 0;; ++k) {
    const double time = static_cast<double>(k) / rate;
    if (time > times.back()) return out;
    while (times[next] < time) ++next;
    if (next == 0) {
      out.push_back(values[0]);
      continue;
    }
    const double part = (time - times[next - 1]) / (times[next] - times[next - 1]);
    out.push_back((1 - part) * values[next - 1] + part * values[next]);
  }
}

std::vector<Signal> motion_of(const Capture& capture, uint32_t threads,
                              const std::function<bool()>& cancelled) {
  double side = 1;
  for (const CaptureCamera& camera : capture.cameras) {
    side = std::max<double>({side, static_cast<double>(camera.source.camera.width),
                             static_cast<double>(camera.source.camera.height)});
  }
  const ImageLoader loader(capture, std::min(1.0, kSide / side));
  std::vector<std::vector<uint32_t>> views(capture.cameras.size());  // by time
  for (uint32_t k = 0; k < capture.views.size(); ++k) views[capture.views[k].camera].push_back(k);
  std::vector<Signal> signals(views.size());
  parallel_for(static_cast<int>(threads), views.size(), 1, [&](size_t begin, size_t end) {
    for (size_t camera = begin; camera < end; ++camera) {
      if (views[camera].size() < 3) continue;
      std::vector<double> times, values;
      std::vector<uint8_t> before;
      double before_time = 0;
      // One thread reads images in the order of their frames.
      const auto add = [&](uint32_t view, const Pixels& pixels) {
        std::vector<uint8_t> grey = grey_of(pixels, loader.mask(capture.views[view].camera));
        const double time = capture.views[view].time;
        if (!before.empty() && time > before_time) {
          times.push_back((before_time + time) / 2);
          // By the time between them: a frame that is missing is no faster motion.
          values.push_back(change(before, grey) / ((time - before_time) * capture.fps));
        }
        before = std::move(grey);
        before_time = time;
      };
      loader.load(views[camera], 1, add, cancelled);
      signals[camera] = resampled(times, values, capture.fps);
    }
  });
  if (cancelled && cancelled()) throw io::Error(L4D_ERR_CANCELLED, "cancelled");
  return signals;
}

}  // namespace l4d::train
