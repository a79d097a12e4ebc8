// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <filesystem>

#include "io/ply/read_ply.h"
#include "io/ply/spacetime.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {
namespace {

// A lite model, and the same without turning under the names of programs that import such models.
struct Names {
  const char* center;
  const char* width;
  bool width_is_sigma;  // its logarithm is that of a standard deviation
  bool colors_are_rgb;  // and not coefficients
};
constexpr Names kNames[] = {{"trbf_center", "trbf_scale", false, true},
                            {"t", "scale_t", true, false}};

const Names* names_of(const PlyElement& vertex) {
  for (const Names& names : kNames) {
    if (vertex.has(names.center) && vertex.has(names.width)) return &names;
  }
  return nullptr;
}

// Numbers of a Gaussian in motion_*: for a line, a parabola or a cubic.
size_t motions_of(const PlyReader& reader) {
  size_t count = 0;
  while (reader.element().has("motion_" + std::to_string(count))) ++count;
  if (count <= 9 && count % 3 == 0) return count;
  reader.fail(L4D_ERR_CORRUPT, std::to_string(count) + " motion properties, and not 0, 3, 6 or 9");
}

// The frames of the sequence by the arguments of the training, which lie in the folder of the
// model: point_cloud/iteration_N/ above. 0: none are there.
uint32_t frames_of_arguments(const std::string& path) {
  namespace fs = std::filesystem;
  const fs::path file = fs::path(path).parent_path() / "../../cfg_args";
  std::error_code error;
  constexpr size_t kMost = 1 << 16;
  if (!fs::is_regular_file(file, error)) return 0;
  std::string text(kMost, ' ');
  text.resize(InputFile(file.string()).read(text.data(), text.size()));
  static constexpr char kKey[] = "duration=";
  const auto is_inside = [&](size_t at) {  // another word
    return at > 0 &&
           (text[at - 1] == '_' || std::isalnum(static_cast<unsigned char>(text[at - 1])));
  };
  size_t at = text.find(kKey);
  while (at != std::string::npos && is_inside(at)) at = text.find(kKey, at + 1);
  if (at == std::string::npos) return 0;
  uint32_t frames = 0;
  const char* begin = text.data() + at + sizeof kKey - 1;
  const auto result = std::from_chars(begin, text.data() + text.size(), frames);
  return result.ec == std::errc() && frames <= L4D_MAX_FRAMES ? frames : 0;
}

void set_timeline(const PlyReader& reader, const ImportOptions& options, Scene& scene) {
  const uint32_t frames = options.seconds > 0 ? 0 : frames_of_arguments(reader.path());
  if (frames == 0) return set_default_timeline(scene, options);
  set_fps(scene.timeline, options.fps > 0 ? options.fps : 30);
  scene.timeline.num_frames = frames;
  scene.notes.push_back("The sequence has " + std::to_string(frames) +
                        " frames by the arguments of the training (cfg_args)" +
                        (options.fps > 0 ? "." : "; 30 frames per second were assumed."));
}

// Of the sequence, from 0 to 1. Times beyond are seconds.
void normalise_times(SpacetimeRows& rows, Scene& scene) {
  const size_t count = scene.count();
  const auto inside = [](float t) { return !(t < 0 || t > 1); };
  if (std::all_of(rows.center.begin(), rows.center.begin() + static_cast<long>(count), inside)) {
    scene.notes.push_back("Times from 0 to 1 are taken as parts of the sequence.");
    return;
  }
  const double unit = duration(scene.timeline);
  double power = 1;
  for (size_t i = 0; i < count; ++i) {
    rows.center[i] = static_cast<float>(static_cast<double>(rows.center[i]) / unit);
    rows.log_width[i] = static_cast<float>(static_cast<double>(rows.log_width[i]) - std::log(unit));
    power = unit;
    for (size_t k = 0; k < 9; k += 3, power *= unit) {
      for (size_t axis = 0; axis < 3; ++axis) {
        float& m = rows.motion[9 * i + k + axis];
        m = static_cast<float>(static_cast<double>(m) * power);
      }
    }
  }
  scene.notes.push_back(
      "Times are not all from 0 to 1: they are taken as seconds from the beginning of the "
      "sequence.");
}

}  // namespace

bool is_stg_ply(const PlyElement& vertex) { return names_of(vertex) != nullptr; }

Scene read_stg_ply(PlyReader& reader, const ImportOptions& options) {
  if (reader.element().has("f_t_0") || reader.element().has("f_dc_3")) {
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED,
                "a full SpacetimeGaussians model: its colours come from a neural network outside "
                "this file, which does not even say what its features are without that; train a "
                "lite model of the same capture (`ours_lite`), whose colours are in its PLY");
  }
  const Names& names = *names_of(reader.element());
  Scene scene;
  scene.source = "stg_ply";
  scene.flags = L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT;
  set_timeline(reader, options, scene);
  read_placement(reader, scene);
  const ShColumns sh = names.colors_are_rgb ? ShColumns() : sh_columns_of(reader);
  scene.sh_degree = sh.degree;
  const size_t count = static_cast<size_t>(reader.element().count);
  scene.resize(count);
  SpacetimeRows stg(count);

  ColumnSet columns(reader, scene);
  columns.add_position();
  columns.add_indexed("scale", 3, scene.log_scale.data(), 4);
  columns.add_indexed("rot", 4, stg.quaternion.data(), 4);
  if (reader.element().has("omega_3")) {
    columns.add_indexed("omega", 4, stg.turning_rate.data(), 4);
  }
  columns.add_indexed("motion", motions_of(reader), stg.motion.data(), 9);
  columns.add("opacity", scene.opacity.data(), 0, 1);
  columns.add(names.center, stg.center.data(), 0, 1);
  columns.add(names.width, stg.log_width.data(), 0, 1);
  columns.add_sh(sh);
  columns.read();
  settle_rows(reader, options, scene);
  if (options.activated) {
    for (float& width : stg.log_width) {
      width = static_cast<float>(std::log(static_cast<double>(width)));
    }
  }
  note_unturned(stg.quaternion, scene);
  raise_flat_scales(scene);
  if (names.colors_are_rgb) {
    for (float& c : scene.sh) {
      c = static_cast<float>((static_cast<double>(c) - 0.5) / sh_constant::k0);
    }
  }
  if (names.width_is_sigma) {
    for (float& width : stg.log_width) width += static_cast<float>(std::log(kWidthOfSigma));
    normalise_times(stg, scene);
  }
  store_spacetime(stg, scene);
  return scene;
}

}  // namespace l4d::io
