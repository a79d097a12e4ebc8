// SPDX-License-Identifier: Apache-2.0
#include "training/sync/sync.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "io/camera/write_cameras.h"
#include "io/image/loudness.h"
#include "libl4dcodec/base/threads.h"
#include "training/sync/motion.h"

namespace l4d::train {
namespace {

constexpr double kSoundRate = 100;  // values a second
// How far a method may be off, in frames: sound takes a frame of 30 a second for 11 m, and what
// moves is seen from several sides.
constexpr double kSoundFrames = 0.5, kMotionFrames = 2;

// What cameras heard, by their own clocks and the offsets that the capture gives; nothing unless
// all heard something.
std::vector<Signal> sound_of(const Capture& capture, uint32_t threads) {
  const size_t n = capture.cameras.size();
  std::vector<Signal> signals(n);
  for (const CaptureCamera& camera : capture.cameras) {
    if (!camera.is_video()) return {};
  }
  parallel_for(static_cast<int>(threads), n, 1, [&](size_t begin, size_t end) {
    for (size_t k = begin; k < end; ++k) {
      const io::Camera& source = capture.cameras[k].source;
      const std::vector<double> loudness = io::read_loudness(source.video, kSoundRate);
      // From the second 0 of the sequence on.
      const auto shift = static_cast<std::ptrdiff_t>(std::lround(source.time_offset * kSoundRate));
      if (shift >= 0) signals[k].assign(static_cast<size_t>(shift), 0.0);
      const size_t from =
          std::min(loudness.size(), static_cast<size_t>(std::max<std::ptrdiff_t>(0, -shift)));
      signals[k].insert(signals[k].end(), loudness.begin() + static_cast<std::ptrdiff_t>(from),
                        loudness.end());
    }
  });
  const bool all = std::all_of(signals.begin(), signals.end(), [](const Signal& signal) {
    return std::any_of(signal.begin(), signal.end(), [](double value) { return value > 0; });
  });
  return all ? signals : std::vector<Signal>();
}

}  // namespace

ClockReport find_clocks(const Capture& capture, double most, uint32_t threads,
                        const std::function<bool()>& cancelled) {
  ClockReport report;
  std::vector<Offset> offsets;
  const auto hear = [&] {
    const std::vector<Signal> sounds = sound_of(capture, threads);
    if (sounds.empty()) return false;
    offsets = align(sounds, kSoundRate, most, threads);
    return std::all_of(offsets.begin(), offsets.end(),
                       [](const Offset& offset) { return offset.is_sure(); });
  };
  const bool heard = hear();
  report.by = heard ? "sound" : "motion";
  if (!heard) offsets = align(motion_of(capture, threads, cancelled), capture.fps, most, threads);
  const double told = (heard ? kSoundFrames : kMotionFrames) / capture.fps;
  for (size_t k = 0; k < offsets.size(); ++k) {
    const CaptureCamera& camera = capture.cameras[k];
    const bool is_off = offsets[k].is_sure() && std::abs(offsets[k].seconds) > told;
    report.cameras.push_back({camera.name, camera.source.time_offset, offsets[k], is_off});
  }
  return report;
}

void write_synchronised(const std::string& path, const Capture& capture,
                        const ClockReport& clocks) {
  io::CameraSet set = camera_set(capture);
  for (size_t k = 0; k < set.cameras.size(); ++k) {
    if (clocks.cameras[k].is_off) set.cameras[k].time_offset += clocks.cameras[k].found.seconds;
  }
  io::write_cameras(path, set);
}

std::string ClockReport::text() const {
  std::string out = "clocks      by " + by + "\n";
  int unknown = 0;
  for (const CameraClock& camera : cameras) {
    const Offset& found = camera.found;
    const char* verdict = camera.is_off ? "off" : found.is_sure() ? "right" : "not known";
    char line[192];
    std::snprintf(line, sizeof(line),
                  "%-11s %-9s %+7.3f s  correlation %.2f, elsewhere %.2f, chance %.2f\n",
                  camera.name.c_str(), verdict, found.seconds, found.correlation, found.elsewhere,
                  found.chance);
    out += line;
    unknown += camera.is_off || found.is_sure() ? 0 : 1;
  }
  if (unknown > 0) {
    out +=
        "what to do  clocks that are not known stay as they are: if they are within 10 frames, "
        "`l4dtrain train --refine-times 10` may find them; a clap that all see or hear makes them "
        "known\n";
  }
  return out;
}

std::string ClockReport::json() const {
  nlohmann::ordered_json out = {{"schema", "l4dtrain.clocks/1"}, {"by", by}};
  for (const CameraClock& camera : cameras) {
    out["cameras"].push_back({{"name", camera.name},
                              {"time_offset", camera.given},
                              {"found_s", camera.found.seconds},
                              {"sure", camera.found.is_sure()},
                              {"off", camera.is_off},
                              {"correlation", camera.found.correlation},
                              {"elsewhere", camera.found.elsewhere},
                              {"chance", camera.found.chance}});
  }
  return out.dump(1);
}

}  // namespace l4d::train
