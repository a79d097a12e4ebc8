// SPDX-License-Identifier: Apache-2.0
#include "io/ply/read_ply.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <new>

#include "io/scene/rendering_text.h"

namespace l4d::io {
namespace {

const char* skip_blanks(const char* text) { return text + std::strspn(text, " \t"); }

// Parses one number and moves on; false if there is none.
bool parse_number(const char** text, double* value) {
  const char* begin = skip_blanks(*text);
  const auto result = std::from_chars(begin, begin + std::strlen(begin), *value);
  if (result.ec != std::errc() || !std::isfinite(*value)) return false;
  *text = result.ptr;
  return true;
}

// A grid on which both the origin and the positions less it are exact or nearly so, and no coarser
// than the scene is wide.
double rounded_origin(double low, double high) {
  const double middle = low / 2 + high / 2;
  const double half_extent = high / 2 - low / 2;
  // Within 8 half-extents float32 loses at most 3 of its 24 bits: not worth an origin.
  if (std::max(std::abs(low), std::abs(high)) <= 8 * half_extent) return 0;
  const double step = half_extent > 0 ? std::exp2(std::floor(std::log2(half_extent))) : 0;
  return step > 0 ? std::round(middle / step) * step : middle;
}

}  // namespace

namespace {

// Absolute map coordinates in float32 have lost what was below their steps before anyone reads
// them.
void note_coarse_positions(Scene& scene) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  double extent = 0;
  float far = 0;
  for (size_t k = 0; k < 3; ++k) {
    float low = kInfinity, high = -low;
    for (size_t i = k; i < scene.position.size(); i += 3) {
      if (!std::isfinite(scene.position[i])) continue;
      low = std::min(low, scene.position[i]);
      high = std::max(high, scene.position[i]);
    }
    if (!(low <= high)) return;
    extent = std::max(extent, static_cast<double>(high) - static_cast<double>(low));
    far = std::max({far, std::fabs(low), std::fabs(high)});
  }
  if (extent == 0 || static_cast<double>(far) < 1000 * extent) return;
  const double step = static_cast<double>(std::nextafter(far, kInfinity) - far);
  char text[200];
  std::snprintf(text, sizeof(text),
                "Coordinates around %.3g are float32, in steps of %.2g: `property double x` and so "
                "on would keep them.",
                static_cast<double>(far), step);
  scene.notes.push_back(text);
}

}  // namespace

double comment_number(const PlyReader& reader, const char* key, double fallback) {
  const char* text = reader.header().comment(key);
  if (text == nullptr) return fallback;
  double value = 0;
  if (!parse_number(&text, &value) || *skip_blanks(text) != '\0') {
    reader.fail(L4D_ERR_CORRUPT, std::string("comment ") + key + " holds no number");
  }
  return value;
}

void set_fps_from_comment(const PlyReader& reader, l4d_timeline& timeline) {
  const char* text = reader.header().comment("fps");
  const char* slash = text != nullptr ? std::strchr(text, '/') : nullptr;
  if (slash == nullptr) return set_fps(timeline, comment_number(reader, "fps", 30));
  const char* end = text + std::strlen(text);
  const auto num = std::from_chars(text, slash, timeline.fps_num);
  const auto den = std::from_chars(slash + 1, end, timeline.fps_den);
  if (num.ec != std::errc() || den.ec != std::errc() || num.ptr != slash || den.ptr != end ||
      timeline.fps_num == 0 || timeline.fps_den == 0) {
    reader.fail(L4D_ERR_CORRUPT, "comment fps is not a frame rate");
  }
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
  l4d_placement& placement = scene.placement;
  if (const char* text = reader.header().comment("l4d_origin")) {
    for (double& value : placement.origin) {
      if (!parse_number(&text, &value)) {
        reader.fail(L4D_ERR_CORRUPT, "comment l4d_origin needs three numbers");
      }
    }
  }
  placement.scale = comment_number(reader, "l4d_scale", 1);
  if (!(placement.scale > 0)) reader.fail(L4D_ERR_CORRUPT, "comment l4d_scale must be above 0");
  if (const char* text = reader.header().comment("l4d_coordinates")) {
    if (std::strcmp(text, "right_up_back") == 0) {
      placement.coordinate_system = L4D_COORDINATES_RIGHT_UP_BACK;
    } else if (std::strcmp(text, "right_down_forward") == 0) {
      placement.coordinate_system = L4D_COORDINATES_RIGHT_DOWN_FORWARD;
    } else {
      reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "unknown l4d_coordinates");
    }
  }
  if (const char* text = reader.header().comment("l4d_color_space")) {
    if (std::strcmp(text, "linear_srgb") != 0 && std::strcmp(text, "srgb") != 0) {
      reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "unknown l4d_color_space");
    }
    placement.color_space = *text == 'l' ? L4D_COLOR_LINEAR_SRGB : L4D_COLOR_SRGB;
  }
  const char* comment = "l4d_rendering";
  try {
    if (const char* text = reader.header().comment(comment)) {
      parse_rendering(text, &scene.rendering);
    }
    comment = "l4d_presentation";
    if (const char* text = reader.header().comment(comment)) {
      parse_presentation(text, &scene.presentation);
    }
  } catch (const Error& error) {
    reader.fail(L4D_ERR_CORRUPT, std::string("comment ") + comment + ": " + error.what());
  }
}

uint32_t sh_degree_of(const PlyReader& reader) {
  size_t count = 0;
  for (const PlyProperty& property : reader.element().properties) {
    if (property.name.compare(0, 7, "f_rest_") == 0) ++count;
  }
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    if (count == 3 * (size_t{degree + 1} * (degree + 1) - 1)) return degree;
  }
  if (count == 72) {
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "spherical harmonics of degree 4");
  }
  reader.fail(L4D_ERR_CORRUPT, std::to_string(count) +
                                   " f_rest properties belong to no degree of spherical harmonics");
}

size_t ColumnSet::require(const std::string& property) const {
  const size_t index = reader_.element().find(property);
  if (index == PlyElement::kNone) {
    reader_.fail(L4D_ERR_CORRUPT, "property " + property + " is missing");
  }
  return index;
}

void ColumnSet::add(const std::string& property, float* to, size_t first, size_t stride) {
  PlyColumn column;
  column.property = require(property);
  column.to_float = to;
  column.first = first;
  column.stride = stride;
  columns_.push_back(column);
}

void ColumnSet::add_indexed(const std::string& name, size_t count, float* to, size_t stride) {
  for (size_t k = 0; k < count; ++k) add(name + "_" + std::to_string(k), to, k, stride);
}

void ColumnSet::add_sh(Scene& scene) {
  const size_t coefficients = scene.sh_coefficients();
  const size_t stride = coefficients * 3;
  add_indexed("f_dc", 3, scene.sh.data(), stride);
  for (size_t channel = 0; channel < 3; ++channel) {
    for (size_t k = 1; k < coefficients; ++k) {
      const size_t source = channel * (coefficients - 1) + (k - 1);
      add("f_rest_" + std::to_string(source), scene.sh.data(), 3 * k + channel, stride);
    }
  }
}

void ColumnSet::add_position(Scene& scene) {
  static constexpr const char* kNames[3] = {"x", "y", "z"};
  bool doubles = false;
  for (const char* name : kNames) {
    // 32-bit integers exceed float32 as well.
    const PlyType type = reader_.element().properties[require(name)].type;
    doubles |= type == PlyType::kFloat64 || type == PlyType::kInt32 || type == PlyType::kUint32;
  }
  if (!doubles) {
    for (size_t k = 0; k < 3; ++k) add(kNames[k], scene.position.data(), k, 3);
    scene_with_floats_ = &scene;
    return;
  }
  positions_.resize(scene.count() * 3);
  scene_with_doubles_ = &scene;
  for (size_t k = 0; k < 3; ++k) {
    PlyColumn column;
    column.property = require(kNames[k]);
    column.to_double = positions_.data();
    column.first = k;
    column.stride = 3;
    columns_.push_back(column);
  }
}

void ColumnSet::add_time(const std::string& property, Scene& scene) {
  const PlyType type = reader_.element().properties[require(property)].type;
  if (type != PlyType::kFloat64 && type != PlyType::kInt32 && type != PlyType::kUint32) {
    return add(property, scene.mean_t.data(), 0, 1);
  }
  times_.resize(scene.count());
  scene_with_times_ = &scene;
  PlyColumn column;
  column.property = require(property);
  column.to_double = times_.data();
  columns_.push_back(column);
}

void ColumnSet::read() {
  reader_.read_rows(columns_);
  if (scene_with_times_ != nullptr) scene_with_times_->set_mean_times(std::move(times_));
  if (scene_with_floats_ != nullptr) note_coarse_positions(*scene_with_floats_);
  if (scene_with_doubles_ == nullptr) return;
  Scene& scene = *scene_with_doubles_;
  for (size_t k = 0; k < 3; ++k) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (size_t i = k; i < positions_.size(); i += 3) {
      if (!std::isfinite(positions_[i])) continue;
      low = std::min(low, positions_[i]);
      high = std::max(high, positions_[i]);
    }
    const double origin = low <= high ? rounded_origin(low, high) : 0;
    for (size_t i = k; i < positions_.size(); i += 3) {
      scene.position[i] = static_cast<float>(positions_[i] - origin);
    }
    scene.placement.origin[k] += scene.placement.scale * origin;
  }
  positions_ = {};
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
  if (vertex.has("trbf_center")) return read_stg_ply(reader, options);
  if (vertex.has("packed_position")) {
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED,
                "a compressed 3DGS PLY; `npx @playcanvas/splat-transform IN out.ply` expands it");
  }
  if (vertex.has("rotor_7") && vertex.has("scale_3")) {
    reader.fail(L4D_ERR_CORRUPT, "4D-rotor Gaussians, but the comment l4d_ply is missing");
  }
  if (vertex.has("scale_0") && vertex.has("rot_0") && vertex.has("opacity")) {
    return read_3dgs_ply(reader, options);
  }
  reader.fail(L4D_ERR_FEATURE_UNSUPPORTED,
              "a PLY, but none of the Gaussian formats l4d_ply, 3DGS, FreeTimeGS and "
              "SpacetimeGaussians lite");
}

namespace {

// What any reader makes of the rows: attributes, and positions, times and shapes as double, once
// more while they are converted.
uint64_t scene_bytes(const PlyReader& reader) {
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
    scene.memory = std::move(memory);
    return scene;
  } catch (const std::bad_alloc&) {
    throw Error(L4D_ERR_OUT_OF_MEMORY, path + ": not enough memory for the scene");
  }
}

}  // namespace l4d::io
