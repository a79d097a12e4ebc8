// SPDX-License-Identifier: Apache-2.0
// The file of `decode --format raw` and of Python's Scene.write: arrays in the layout of
// docs/formats.md, "Raw arrays". read_raw (io/formats/readers.h) reads it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "io/file/memory.h"
#include "io/scene/scene.h"

namespace l4d::io {

// The little-endian numbers of an array, rows one after the other.
struct RawArray {
  std::string name;
  std::string type;  // f32, f64, u8, u16, u32, u64
  std::vector<uint64_t> shape;
  std::shared_ptr<const void> owner;  // of `data`; may be empty where something else keeps it
  const unsigned char* data = nullptr;

  size_t element_bytes() const;
  uint64_t num_elements() const;
  size_t num_bytes() const { return static_cast<size_t>(num_elements()) * element_bytes(); }
};

// The shape of an attribute of `count` Gaussians.
std::vector<uint64_t> raw_shape(const AttributeInfo& attribute, uint64_t count, uint32_t sh_degree);

// Turns numbers of `width` bytes each from the order of the host to little-endian, in place.
void to_little_endian(unsigned char* data, size_t bytes, size_t width);

// What RawArray::type calls a T.
template <typename T>
constexpr const char* raw_type() {
  if (std::is_floating_point_v<T>) return sizeof(T) == 4 ? "f32" : "f64";
  return sizeof(T) == 1 ? "u8" : sizeof(T) == 2 ? "u16" : sizeof(T) == 4 ? "u32" : "u64";
}

// Takes values in the order of the host.
template <typename T>
RawArray raw_array(std::string name, std::vector<uint64_t> shape, std::vector<T> values) {
  const auto owner = std::make_shared<std::vector<T>>(std::move(values));
  auto* data = reinterpret_cast<unsigned char*>(owner->data());
  to_little_endian(data, owner->size() * sizeof(T), sizeof(T));
  return {std::move(name), raw_type<T>(), std::move(shape), owner, data};
}

// What the metadata say of the arrays and of the scene that they come from.
struct RawStatements {
  std::string form = "attributes";  // or "packed"
  uint64_t count = 0;               // Gaussians
  uint32_t sh_degree = 0;
  uint32_t flags = 0;  // L4D_POSITION_AT_MEAN_TIME, L4D_OPACITY_LOGIT
  l4d_timeline timeline{};
  l4d_placement placement{};
  l4d_rendering rendering{};
  l4d_presentation presentation{};
};

// Writes the arrays. Throws Error(L4D_ERR_IO).
void write_raw(const std::string& path, const RawStatements& statements,
               const std::vector<RawArray>& arrays, const Check& check = {});
// Writes a scene, bit for bit and in its order: the arrays of a decoded stream, but for those that
// only a stream has (`buckets`, `mean_t_local`). Throws Error: L4D_ERR_IO, L4D_ERR_INVALID_SCENE.
void write_raw(const std::string& path, const Scene& scene, const Check& check = {});

}  // namespace l4d::io
