// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstring>

#include "io/read_ply.h"

namespace l4d::io {
namespace {

void read_timeline(const PlyReader& reader, const ImportOptions& options, Scene& scene) {
  const char* unit = reader.header().comment("time_unit");
  if (unit != nullptr && std::strcmp(unit, "seconds") != 0) {
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "time_unit is not seconds");
  }
  const double begin = comment_number(reader, "time_begin", 0);
  const double end = comment_number(reader, "time_end", begin + 1);
  const double seconds = options.seconds > 0 ? options.seconds : end - begin;
  scene.timeline.time_begin = begin;
  try {
    if (options.fps > 0) {
      set_fps(scene.timeline, options.fps);
    } else {
      set_fps_from_comment(reader, scene.timeline);
    }
    set_duration(scene.timeline, seconds);
  } catch (const Error& error) {
    if (options.fps > 0 || options.seconds > 0 || error.status() == L4D_ERR_CORRUPT) throw;
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
  scene.sh_degree = sh_degree_of(reader);
  scene.resize(static_cast<size_t>(reader.element().count));

  ColumnSet columns(reader);
  columns.add_position(scene);
  columns.add("t", scene.mean_t.data(), 0, 1);
  columns.add_indexed("scale", 4, scene.log_scale.data(), 4);
  columns.add_indexed("rotor", 8, scene.rotor.data(), 8);
  columns.add("opacity", scene.opacity.data(), 0, 1);
  columns.add_sh(scene);
  columns.read();
  return scene;
}

}  // namespace l4d::io
