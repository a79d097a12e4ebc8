// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>

#include "io/ply/read_ply.h"

namespace l4d::io {
namespace {

// Frame i of n lies at i / max(n - 1, 1) of the normalised time, so 1 is the last frame's time, not
// the sequence's end.
void read_frames(const PlyReader& reader, const ImportOptions& options, Scene& scene) {
  const double frames = comment_number(reader, "n_frames", 0);
  if (frames == 0) return set_default_timeline(scene, options);
  if (!(frames >= 1 && frames <= L4D_MAX_FRAMES && frames == std::floor(frames))) {
    reader.fail(L4D_ERR_CORRUPT, "comment n_frames is no number of frames");
  }
  const double fps =
      options.fps > 0 ? options.fps : (options.seconds > 0 ? frames / options.seconds : 30);
  set_fps(scene.timeline, fps);
  scene.timeline.num_frames = static_cast<uint32_t>(frames);
  if (!(options.fps > 0) && !(options.seconds > 0)) {
    scene.notes.push_back("The file has no frame rate; 30 frames per second were assumed.");
  }
}

}  // namespace

Scene read_ftgs_ply(PlyReader& reader, const ImportOptions& options) {
  if (comment_number(reader, "ftgs_version", 1) != 1) {
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "a version of FreeTimeGS PLY other than 1");
  }
  Scene scene;
  scene.source = "ftgs_ply";
  scene.flags = L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT;
  read_frames(reader, options, scene);
  read_placement(reader, scene);
  const ShColumns sh = sh_columns_of(reader);
  scene.sh_degree = sh.degree;
  const size_t count = static_cast<size_t>(reader.element().count);
  scene.resize(count);
  const bool moving = comment_number(reader, "use_velocity", 1) != 0;
  std::vector<float> quaternion(count * 4), time(count), log_duration(count), velocity;

  ColumnSet columns(reader, scene);
  columns.add_position();
  columns.add_indexed("scale", 3, scene.log_scale.data(), 4);
  columns.add_indexed("rot", 4, quaternion.data(), 4);
  columns.add("opacity", scene.opacity.data(), 0, 1);
  columns.add("time", time.data(), 0, 1);
  columns.add("log_duration", log_duration.data(), 0, 1);
  // Not used where the model is said not to move.
  if (moving || reader.element().has("velocity_0")) {
    velocity.resize(count * 3);
    columns.add_indexed("velocity", 3, velocity.data(), 3);
  }
  columns.add_sh(sh);
  columns.read();
  settle_rows(reader, options, scene);
  note_unturned(quaternion, scene);
  const auto lasts = [](float log) { return log >= 0; };
  if (scene.count() > 0 &&
      std::all_of(log_duration.begin(), log_duration.begin() + static_cast<long>(scene.count()),
                  lasts)) {
    scene.notes.push_back(
        "log_duration is positive, as in files that have durations where logarithms belong: all "
        "Gaussians last longer than the sequence.");
  }
  raise_flat_scales(scene);

  const double unit = static_cast<double>(std::max(scene.timeline.num_frames, 2U) - 1) *
                      scene.timeline.fps_den / scene.timeline.fps_num;  // seconds
  const double min_duration = comment_number(reader, "min_duration", 0);
  for (size_t i = 0; i < scene.count(); ++i) {
    scene.mean_t[i] = static_cast<float>(static_cast<double>(time[i]) * unit);
    const double sigma_t =
        std::max(std::exp(static_cast<double>(log_duration[i])), min_duration) * unit;
    Vec4 wxyz;
    Vec3 scale, v{0, 0, 0};
    for (size_t k = 0; k < 4; ++k) wxyz[k] = static_cast<double>(quaternion[4 * i + k]);
    for (size_t k = 0; k < 3; ++k) {
      scale[k] = std::exp(static_cast<double>(scene.log_scale[4 * i + k]));
      if (moving) v[k] = static_cast<double>(velocity[3 * i + k]) / unit;
    }
    if (v == Vec3{0, 0, 0}) {  // nothing to mix: keep the scales' bits and temporal zeros
      store_still_shape(scene, i, wxyz, sigma_t);
    } else if (all_finite(wxyz.data(), 4) && all_finite(scale.data(), 3) &&
               all_finite(v.data(), 3) && all_finite(&sigma_t, 1) && sigma_t > 0) {
      store_shape(scene, i, shape_of_moving(quaternion_to_matrix(wxyz), scale, v, sigma_t));
    } else {
      store_invalid_shape(scene, i);
    }
  }
  const double floor = comment_number(reader, "opacity_floor", 0);
  if (floor > 0) {
    char text[160];
    std::snprintf(text, sizeof(text),
                  "The opacity floor of %g was dropped: opacities differ by at most that.", floor);
    scene.notes.push_back(text);
  }
  return scene;
}

}  // namespace l4d::io
