// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>

#include "io/ply/read_ply.h"
#include "io/scene/rotor_math.h"

namespace l4d::io {
namespace {

void read_timeline(const PlyReader& reader, const ImportOptions& options, Scene& scene) {
  const char* unit = reader.header().comment("time_unit");
  if (unit != nullptr && std::strcmp(unit, "seconds") != 0) {
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "time_unit is not seconds");
  }
  const double begin = comment_number(reader, "time_begin", 0);
  const double end = comment_number(reader, "time_end", begin + 1);
  const bool is_stated = reader.header().comment("time_end") != nullptr;
  const bool takes_fps = options.fps > 0 && reader.header().comment("fps") == nullptr;
  const double seconds = options.seconds > 0 && !is_stated ? options.seconds : end - begin;
  scene.timeline.time_begin = begin;
  try {
    if (takes_fps) {
      set_fps(scene.timeline, options.fps);
    } else {
      set_fps_from_comment(reader, scene.timeline);
    }
    set_duration(scene.timeline, seconds);
  } catch (const Error& error) {
    if (takes_fps || options.seconds > 0 || error.status() == L4D_ERR_CORRUPT) throw;
    reader.fail(L4D_ERR_CORRUPT, error.what());
  }
  if (std::abs(duration(scene.timeline) - seconds) > 1e-6 * seconds) {
    char text[160];
    std::snprintf(text, sizeof(text),
                  "The duration of %g seconds is no whole number of frames; it became %g seconds.",
                  seconds, duration(scene.timeline));
    scene.notes.push_back(text);
  }
}

// Float32 times have steps; a note reports those that matter for short-lived Gaussians.
void note_coarse_times(Scene& scene) {
  if (!scene.mean_t_double.empty()) return;
  size_t coarse = 0;
  double widest = 0;
  for (size_t i = 0; i < scene.count(); ++i) {
    const float t = std::fabs(scene.mean_t[i]);
    if (!std::isfinite(t)) continue;
    const double step =
        static_cast<double>(std::nextafter(t, std::numeric_limits<float>::infinity()) - t);
    Rotor rotor;
    Vec4 scale;
    for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(scene.rotor[8 * i + k]);
    for (size_t k = 0; k < 4; ++k) {
      scale[k] = std::exp(static_cast<double>(scene.log_scale[4 * i + k]));
    }
    // A rotor that leaves time alone spares the slice.
    const bool still = rotor[4] == 0 && rotor[5] == 0 && rotor[6] == 0 && rotor[7] == 0;
    const double sigma = still ? scale[3] : slice(rotor, scale).sigma_t;
    if (!(step > 0.1 * sigma)) continue;
    ++coarse;
    widest = std::max(widest, step);
  }
  if (coarse == 0) return;
  char text[200];
  std::snprintf(text, sizeof(text),
                "Times are float32, in steps of up to %.2g seconds: too coarse for %zu short-lived "
                "Gaussians. `property double t` keeps them.",
                widest, coarse);
  scene.notes.push_back(text);
}

// To whole frames. What is no frame of the format stays invalid, for the encoder to name or drop.
void set_windows(const std::vector<float>& frames, Scene& scene) {
  if (std::all_of(frames.begin(), frames.end(), [](float f) { return f == 0; })) return;
  constexpr uint32_t kNoFrame = 0xffffffff;
  for (const float f : frames) {
    const bool valid = f >= 0 && f <= static_cast<float>(L4D_MAX_FRAMES);
    scene.window.push_back(valid ? static_cast<uint32_t>(std::floor(f + 0.5f)) : kNoFrame);
  }
}

}  // namespace

Scene read_l4d_ply(PlyReader& reader, const ImportOptions& options) {
  if (comment_number(reader, "l4d_ply", 0) != 1) {
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "a version of l4d_ply other than 1");
  }
  Scene scene;
  scene.source = "l4d_ply";
  scene.flags = L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT;
  read_timeline(reader, options, scene);
  read_placement(reader, scene);
  const ShColumns sh = sh_columns_of(reader);
  scene.sh_degree = sh.degree;
  scene.resize(static_cast<size_t>(reader.element().count));

  ColumnSet columns(reader, scene);
  columns.add_position();
  columns.add_time("t");
  columns.add_indexed("scale", 4, scene.log_scale.data(), 4);
  columns.add_indexed("rotor", 8, scene.rotor.data(), 8);
  columns.add("opacity", scene.opacity.data(), 0, 1);
  columns.add_sh(sh);
  std::vector<float> windows(reader.element().has("window_begin") ? 2 * scene.count() : 0);
  if (!windows.empty()) {
    columns.add("window_begin", windows.data(), 0, 2);
    columns.add("window_end", windows.data(), 1, 2);
  }
  columns.read();
  windows.resize(std::min(windows.size(), 2 * scene.count()));
  set_windows(windows, scene);
  note_coarse_times(scene);
  return scene;
}

}  // namespace l4d::io
