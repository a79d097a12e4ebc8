// SPDX-License-Identifier: Apache-2.0
#include "io/ply/read_ply.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <new>

#include "io/scene/statements.h"

namespace l4d::io {
namespace {

// Of layouts, beside what io/scene/statements.h has.
constexpr const char* kOfLayouts[] = {"l4d_ply",      "ftgs_version", "n_frames",
                                      "use_velocity", "min_duration", "opacity_floor"};
// Of a clock, as others may write them.
constexpr const char* kClock[] = {"fps",        "framerate",  "frame_rate", "n_frames",
                                  "num_frames", "time_begin", "time_end",   "time_unit"};

template <size_t N>
bool is_one_of(const char* const (&names)[N], const std::string& name) {
  return std::any_of(std::begin(names), std::end(names),
                     [&](const char* known) { return name == known; });
}

// Whether a word is one of kClock but for capitals and what follows ':' or '='.
bool speaks_of_clock(std::string word) {
  word.resize(std::min(word.size(), word.find_first_of(":=")));
  std::transform(word.begin(), word.end(), word.begin(), [](unsigned char c) {
    return static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  });
  return is_one_of(kClock, word);
}

std::string rest_of(const std::string& text, const std::string& key) {
  const size_t at = text.find_first_not_of(" \t", key.size());
  return at == std::string::npos ? "" : text.substr(at);
}

// What `read` makes of the comments; its errors name the file.
template <typename Read>
auto from_comments(const PlyReader& reader, const Read& read) {
  try {
    return read([&](const std::string& key) { return reader.header().comment(key); });
  } catch (const Error& error) {
    const l4d_status status = error.status();
    if (status != L4D_ERR_CORRUPT && status != L4D_ERR_FEATURE_UNSUPPORTED) throw;
    reader.fail(status, std::string("comment ") + error.what());
  }
}

}  // namespace

double comment_number(const PlyReader& reader, const char* key, double fallback) {
  return from_comments(
      reader, [&](const TextOf& text_of) { return stated_number(text_of, key, fallback); });
}

void set_fps_from_comment(const PlyReader& reader, l4d_timeline& timeline) {
  from_comments(reader, [&](const TextOf& text_of) { read_stated_fps(text_of, &timeline); });
}

void set_default_timeline(Scene& scene, const ImportOptions& options) {
  set_fps(scene.timeline, options.fps > 0 ? options.fps : 30);
  set_duration(scene.timeline, options.seconds > 0 ? options.seconds : 1);
  if (options.seconds > 0 && options.fps > 0) return;
  char text[160];
  std::snprintf(text, sizeof(text),
                "The file has no timeline; %g seconds at %g frames per second were assumed.",
                duration(scene.timeline),
                static_cast<double>(scene.timeline.fps_num) / scene.timeline.fps_den);
  scene.notes.push_back(text);
}

void read_placement(const PlyReader& reader, Scene& scene) {
  std::map<std::string, std::string> stated;
  for (const std::string& text : reader.header().comments) {
    const std::string key = text.substr(0, text.find_first_of(" \t"));
    if (!is_statement(key) && !is_one_of(kOfLayouts, key)) {
      if (key.rfind("l4d_", 0) == 0 || speaks_of_clock(key)) {
        scene.notes.push_back("The comment " + list_of_names({key}) +
                              " is not known and was not read.");
      }
      continue;
    }
    const std::string value = rest_of(text, key);
    const std::string& first = stated.emplace(key, value).first->second;
    if (value == first) continue;
    reader.fail(L4D_ERR_CORRUPT,
                "comment " + key + " is there twice: \"" + first + "\" and \"" + value + "\"");
  }
  from_comments(reader, [&](const TextOf& text_of) { read_stated_placement(text_of, &scene); });
}

void store_shape(Scene& scene, size_t i, const Shape4& shape) {
  for (size_t k = 0; k < 8; ++k) scene.rotor[8 * i + k] = static_cast<float>(shape.rotor[k]);
  for (size_t k = 0; k < 4; ++k) {
    scene.log_scale[4 * i + k] = static_cast<float>(std::log(shape.scale[k]));
  }
}

void store_still_shape(Scene& scene, size_t i, const Vec4& wxyz, double sigma_t) {
  const Rotor rotor = quaternion_to_rotor(wxyz);
  for (size_t k = 0; k < 8; ++k) scene.rotor[8 * i + k] = static_cast<float>(rotor[k]);
  scene.log_scale[4 * i + 3] = static_cast<float>(std::log(sigma_t));
}

void store_invalid_shape(Scene& scene, size_t i) {
  for (size_t k = 0; k < 8; ++k) scene.rotor[8 * i + k] = k == 0 ? 1.0F : 0.0F;
  for (size_t k = 0; k < 4; ++k) {
    scene.log_scale[4 * i + k] = std::numeric_limits<float>::quiet_NaN();
  }
}

Scene read_scene(PlyReader& reader, const ImportOptions& options) {
  const PlyHeader& header = reader.header();
  const PlyElement& vertex = reader.element();
  if (header.comment("l4d_ply") != nullptr) return read_l4d_ply(reader, options);
  if (header.comment("l4d_weights") != nullptr) {
    reader.fail(L4D_ERR_CORRUPT, "this is a file of weights, not a scene");
  }
  if (header.comment("ftgs_version") != nullptr ||
      (vertex.has("log_duration") && vertex.has("velocity_0"))) {
    return read_ftgs_ply(reader, options);
  }
  if (is_rt4dgs_ply(vertex)) return read_rt4dgs_ply(reader, options);
  if (is_stg_ply(vertex) && !vertex.has("rot_r_0")) return read_stg_ply(reader, options);
  if (is_compressed_ply(vertex)) return read_compressed_ply(reader, options);
  if (vertex.has("rotor_7") && vertex.has("scale_3")) {
    reader.fail(L4D_ERR_CORRUPT, "4D-rotor Gaussians, but the comment l4d_ply is missing");
  }
  refuse_unread_time(reader);
  if (vertex.has("scale_0") && vertex.has("rot_0") && vertex.has("opacity")) {
    refuse_deformed(reader);
    return read_3dgs_ply(reader, options);
  }
  reader.fail(L4D_ERR_FEATURE_UNSUPPORTED,
              "a PLY, but none of the Gaussian formats l4d_ply, 3DGS, FreeTimeGS, "
              "SpacetimeGaussians lite and Real-time-4DGS");
}

void note_far_times(Scene& scene) {
  if (scene.source == "l4d_ply" || scene.source == "raw" || scene.count() == 0) return;
  const double begin = scene.timeline.time_begin, length = duration(scene.timeline);
  const auto [low, high] = std::minmax_element(scene.mean_t.begin(), scene.mean_t.end());
  const double first = static_cast<double>(*low), last = static_cast<double>(*high);
  const auto is_outside = [&](float t) {
    return static_cast<double>(t) < begin || static_cast<double>(t) > begin + length;
  };
  const auto outside = std::count_if(scene.mean_t.begin(), scene.mean_t.end(), is_outside);
  const bool is_far = first < begin - length || last > begin + 2 * length;
  if (!is_far && static_cast<size_t>(outside) <= scene.count() / 10) return;
  char text[160];
  std::snprintf(text, sizeof(text),
                "Gaussians have their middle from %g to %g s; the sequence lasts from %g to %g s.",
                first, last, begin, begin + length);
  scene.notes.push_back(text);
}

namespace {

// What any reader makes of the rows: attributes, and positions, times and shapes as double, once
// more while they are converted.
uint64_t scene_bytes(PlyReader& reader) {
  if (is_compressed_ply(reader.element())) return compressed_ply_bytes(reader);
  size_t rest = 0;
  for (const PlyProperty& property : reader.element().properties) {
    rest += property.name.compare(0, 7, "f_rest_") == 0 ? 1U : 0U;
  }
  constexpr uint64_t kDoubles = 24 * sizeof(double);
  return reader.element().count * ((numbers_per_gaussian(0) + rest) * sizeof(float) + kDoubles);
}

}  // namespace

Scene read_scene_ply(const std::string& path, const ImportOptions& options) {
  try {
    PlyReader reader(InputFile(path, options.holder), "vertex");
    std::shared_ptr<void> memory = hold(options.holder, scene_bytes(reader), path);
    Scene scene = read_scene(reader, options);
    reader.finish();
    note_far_times(scene);
    scene.memory = std::move(memory);
    return scene;
  } catch (const std::bad_alloc&) {
    throw Error(L4D_ERR_OUT_OF_MEMORY, path + ": not enough memory for the scene");
  }
}

}  // namespace l4d::io
