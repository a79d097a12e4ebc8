// SPDX-License-Identifier: Apache-2.0
#include "io/formats/write_gltf.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <nlohmann/json.hpp>

#include "io/file/file.h"
#include "io/formats/gltf_document.h"
#include "io/formats/instant.h"
#include "io/scene/shape3.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;

constexpr uint32_t kFloat = 5126, kPoints = 0, kArrayBuffer = 34962;

// One attribute: `numbers` of each splat.
struct GltfColumn {
  std::string name;
  const char* type;
  size_t numbers;
  std::function<void(size_t i, float* out)> value;
};

// Colours and opacity as a viewer draws them that knows no Gaussians.
void point_color(const Splats& splats, bool is_linear, size_t i, float* out) {
  linear_base_color(splats, is_linear, i, out);
  out[3] = splats.opacity[i];
}

std::vector<GltfColumn> columns_of(const Splats& splats, const std::vector<Shape3>& shapes,
                                   bool is_linear) {
  const std::string prefix = std::string(kGltfSplats) + ":";
  std::vector<GltfColumn> columns = {
      {"POSITION", "VEC3", 3,
       [&](size_t i, float* out) { std::copy_n(&splats.position[3 * i], 3, out); }},
      {"COLOR_0", "VEC4", 4,
       [&, is_linear](size_t i, float* out) { point_color(splats, is_linear, i, out); }},
      {prefix + "ROTATION", "VEC4", 4,
       [&](size_t i, float* out) {  // x y z w
         for (size_t k = 0; k < 4; ++k) out[k] = static_cast<float>(shapes[i].wxyz[(k + 1) % 4]);
       }},
      {prefix + "SCALE", "VEC3", 3,
       [&](size_t i, float* out) {
         for (size_t k = 0; k < 3; ++k) out[k] = static_cast<float>(shapes[i].scale[k]);
       }},
      {prefix + "OPACITY", "SCALAR", 1,
       [&](size_t i, float* out) { *out = std::clamp(splats.opacity[i], 0.0F, 1.0F); }}};
  const size_t numbers = size_t{3} * (splats.sh_degree + 1) * (splats.sh_degree + 1);
  size_t at = 0;
  for (uint32_t degree = 0; degree <= splats.sh_degree; ++degree) {
    for (uint32_t k = 0; k <= 2 * degree; ++k, ++at) {
      columns.push_back(
          {prefix + "SH_DEGREE_" + std::to_string(degree) + "_COEF_" + std::to_string(k), "VEC3", 3,
           [&, at, numbers](size_t i, float* out) {
             std::copy_n(&splats.sh[numbers * i + 3 * at], 3, out);
           }});
    }
  }
  return columns;
}

Json node_of(const l4d_placement& placement) {
  Json node = {{"mesh", 0}};
  const double* o = placement.origin;
  if (o[0] != 0 || o[1] != 0 || o[2] != 0) node["translation"] = {o[0], o[1], o[2]};
  if (placement.scale != 1) node["scale"] = {placement.scale, placement.scale, placement.scale};
  if (placement.coordinate_system != L4D_COORDINATES_RIGHT_DOWN_FORWARD) return node;
  // Half a turn around x: down becomes up, and forward back.
  node["rotation"] = {1, 0, 0, 0};
  if (node.contains("translation")) node["translation"] = {o[0], -o[1], -o[2]};
  return node;
}

Json document_of(const Splats& splats, const std::vector<GltfColumn>& columns,
                 const l4d_placement& placement, uint64_t bytes) {
  const bool is_linear = placement.color_space == L4D_COLOR_LINEAR_SRGB;
  const size_t count = splats.count();
  Json views = Json::array(), accessors = Json::array(), attributes = Json::object();
  uint64_t offset = 0;
  for (const GltfColumn& column : columns) {
    const uint64_t length = count * column.numbers * sizeof(float);
    views.push_back(
        {{"buffer", 0}, {"byteOffset", offset}, {"byteLength", length}, {"target", kArrayBuffer}});
    Json accessor = {{"bufferView", accessors.size()},
                     {"componentType", kFloat},
                     {"count", count},
                     {"type", column.type}};
    if (column.name == "POSITION") {
      std::array<float, 3> least{}, most{};
      for (size_t k = 0; k < 3; ++k) {
        least[k] = most[k] = splats.position[k];
        for (size_t i = 0; i < count; ++i) {
          least[k] = std::min(least[k], splats.position[3 * i + k]);
          most[k] = std::max(most[k], splats.position[3 * i + k]);
        }
      }
      accessor["min"] = least;
      accessor["max"] = most;
    }
    attributes[column.name] = accessors.size();
    accessors.push_back(accessor);
    offset += length;
  }
  const Json extension = {{"kernel", "ellipse"},
                          {"colorSpace", is_linear ? "lin_rec709_display" : "srgb_rec709_display"}};
  const Json primitive = {
      {"mode", kPoints}, {"attributes", attributes}, {"extensions", {{kGltfSplats, extension}}}};
  return {{"asset", {{"version", "2.0"}, {"generator", "l4dcodec"}}},
          {"extensionsUsed", Json::array({kGltfSplats})},
          {"scene", 0},
          {"scenes", Json::array({{{"nodes", Json::array({0})}}})},
          {"nodes", Json::array({node_of(placement)})},
          {"meshes", Json::array({{{"primitives", Json::array({primitive})}}})},
          {"buffers", Json::array({{{"byteLength", bytes}}})},
          {"bufferViews", views},
          {"accessors", accessors}};
}

void write_u32(OutputFile* file, uint64_t value) {
  uint8_t bytes[4];
  for (size_t k = 0; k < 4; ++k) bytes[k] = static_cast<uint8_t>(value >> (8 * k));
  file->write(bytes, sizeof(bytes));
}

}  // namespace

WriteNotes write_gltf(const std::string& path, Splats splats, const InstantSetting& setting) {
  if (splats.count() == 0) {
    throw Error(L4D_ERR_INVALID_SCENE, path + ": glTF has no array without elements");
  }
  require_finite(splats, path);
  const l4d_placement& placement = setting.placement;
  const auto memory = hold(setting.holder, splats.count() * sizeof(Shape3), path + " as glTF");
  std::vector<Shape3> shapes;
  shapes.reserve(splats.count());
  for (size_t i = 0; i < splats.count(); ++i) {
    shapes.push_back(shape_of_covariance(&splats.covariance[6 * i]));
  }
  const std::vector<GltfColumn> columns =
      columns_of(splats, shapes, placement.color_space == L4D_COLOR_LINEAR_SRGB);
  uint64_t bytes = 0;
  for (const GltfColumn& column : columns) bytes += splats.count() * column.numbers * sizeof(float);
  std::string text = document_of(splats, columns, placement, bytes).dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  constexpr uint64_t kHeads = 12 + 8 + 8;
  if (kHeads + text.size() + bytes > UINT32_MAX) {
    throw Error(L4D_ERR_LIMIT_EXCEEDED, path + ": a .glb file has at most 4 GB");
  }
  OutputFile file(path, setting.check);
  file.write("glTF", 4);
  write_u32(&file, 2);
  write_u32(&file, kHeads + text.size() + bytes);
  write_u32(&file, text.size());
  file.write("JSON", 4);
  file.write(text.data(), text.size());
  write_u32(&file, bytes);
  file.write("BIN\0", 4);
  std::vector<uint8_t> block;
  for (const GltfColumn& column : columns) {
    for (size_t i = 0; i < splats.count(); ++i) {
      float values[4];
      column.value(i, values);
      for (size_t k = 0; k < column.numbers; ++k) {
        uint32_t bits = 0;
        std::memcpy(&bits, &values[k], sizeof(bits));
        for (unsigned b = 0; b < 4; ++b) block.push_back(static_cast<uint8_t>(bits >> (8 * b)));
      }
      constexpr size_t kBlock = size_t{1} << 20;
      if (block.size() < kBlock) continue;
      file.write(block.data(), block.size());
      block.clear();
    }
  }
  file.write(block.data(), block.size());
  file.commit();
  if (placement.coordinate_system != L4D_COORDINATES_UNKNOWN) return {};
  return {{"the axes of the scene are not known; they are taken for those of glTF, with y up", 0}};
}

}  // namespace l4d::io
