// SPDX-License-Identifier: Apache-2.0
#include "io/formats/splatv_view.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "io/scene/counted.h"
#include "io/scene/rotor_math.h"

namespace l4d::io {
namespace {

constexpr double kFarthest = 1e9;

// Nothing beyond that, and no NaN.
bool read_numbers(const nlohmann::json& list, size_t count, double* to) {
  if (!list.is_array() || list.size() != count) return false;
  for (size_t k = 0; k < count; ++k) {
    if (!list[k].is_number()) return false;
    to[k] = list[k].get<double>();
    if (!(std::abs(to[k]) <= kFarthest)) return false;
  }
  return true;
}

bool read_number(const nlohmann::json& object, const char* key, double* to) {
  const auto found = object.find(key);
  return found != object.end() && read_numbers(nlohmann::json::array({*found}), 1, to);
}

struct SplatvCamera {
  Vec3 position, right, down, forward;
  double width = 0, height = 0, fx = 0, fy = 0;  // pixels
};

bool read_camera(const nlohmann::json& object, SplatvCamera* camera) {
  if (!object.is_object() || !object.contains("position") || !object.contains("rotation") ||
      !read_numbers(object["position"], 3, camera->position.data()) ||
      !read_number(object, "width", &camera->width) ||
      !read_number(object, "height", &camera->height) || !read_number(object, "fx", &camera->fx) ||
      !read_number(object, "fy", &camera->fy)) {
    return false;
  }
  const nlohmann::json& rows = object["rotation"];
  if (!rows.is_array() || rows.size() != 3) return false;
  for (size_t r = 0; r < 3; ++r) {
    double row[3];
    if (!read_numbers(rows[r], 3, row)) return false;
    camera->right[r] = row[0];
    camera->down[r] = row[1];
    camera->forward[r] = row[2];
  }
  const Vec3* const axes[] = {&camera->right, &camera->down, &camera->forward};
  for (size_t a = 0; a < 3; ++a) {
    for (size_t b = a; b < 3; ++b) {
      if (!(std::abs(dot(*axes[a], *axes[b]) - (a == b ? 1 : 0)) < 1e-2)) return false;
    }
  }
  return camera->width > 0 && camera->height > 0 && camera->fx > 0 && camera->fy > 0;
}

// The median of each coordinate.
Vec3 middle_of(const Scene& scene) {
  Vec3 middle{};
  std::vector<float> values;
  values.reserve(scene.count());
  for (size_t k = 0; k < 3; ++k) {
    values.clear();
    for (size_t i = k; i < scene.position.size(); i += 3) {
      if (std::isfinite(scene.position[i])) values.push_back(scene.position[i]);
    }
    if (values.empty()) continue;
    const auto half = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), half, values.end());
    middle[k] = static_cast<double>(*half);
  }
  return middle;
}

// Nothing happens, and false is returned, where the camera looks elsewhere.
bool state_view(const SplatvCamera& camera, const Vec3& middle, l4d_presentation* p) {
  constexpr double kWidest = 2.9;
  Vec3 from;
  for (size_t k = 0; k < 3; ++k) from[k] = middle[k] - camera.position[k];
  const double depth = dot(from, camera.forward);
  if (!(depth > 0) || std::abs(dot(from, camera.right)) * camera.fx > depth * camera.width / 2 ||
      std::abs(dot(from, camera.down)) * camera.fy > depth * camera.height / 2) {
    return false;
  }
  for (size_t k = 0; k < 3; ++k) {
    p->camera_position[k] = camera.position[k];
    p->camera_target[k] = camera.position[k] + depth * camera.forward[k];
    p->camera_up[k] = -camera.down[k];
  }
  p->camera_fov = std::min(2 * std::atan2(camera.height / 2, camera.fy), kWidest);
  p->has_camera = 1;
  return true;
}

}  // namespace

void state_splatv_view(const nlohmann::json& cameras, Scene* scene) {
  const size_t count = cameras.is_array() ? cameras.size() : 1;
  if (count == 0) return;
  SplatvCamera first;
  const bool is_known = cameras.is_array() && read_camera(cameras[0], &first);
  const bool is_stated = is_known && state_view(first, middle_of(*scene), &scene->presentation);
  if (is_stated && count == 1) return;
  const std::string all = counted(count, "camera was", "cameras were");
  scene->notes.push_back(
      is_stated ? "Of " + std::to_string(count) +
                      " cameras the first became the first view; others were not read."
      : is_known ? all + " not read: the first does not see the middle of the scene."
                 : all +
                       " not read: the first has no position, rotation, focal "
                       "lengths and size.");
}

}  // namespace l4d::io
