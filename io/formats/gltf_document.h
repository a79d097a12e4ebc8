// SPDX-License-Identifier: Apache-2.0
// The container of glTF 2.0: arrays of numbers, and meshes where the nodes of the scene put them.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "io/file/file.h"
#include "io/ply/scene_ply.h"
#include "io/scene/rotor_math.h"

namespace l4d::io {

constexpr const char* kGltfSplats = "KHR_gaussian_splatting";

// position in the scene = linear * position in the mesh + translation
struct GltfPlace {
  size_t mesh = 0;
  Matrix3 linear{1, 0, 0, 0, 1, 0, 0, 0, 1};
  Vec3 translation{};
};

class GltfDocument {
 public:
  // A .glb file, or a .gltf with its buffers inside or in files beside it.
  GltfDocument(InputFile* input, const ImportOptions& options);

  const nlohmann::json& root() const { return root_; }
  const std::string& path() const { return path_; }
  // Of the file and its buffers.
  uint64_t bytes() const;
  // All meshes of the scene that is shown first, or of all nodes where there is none.
  std::vector<GltfPlace> places() const;
  // How many elements of so many numbers an accessor has, all of them in its buffer.
  size_t count(const nlohmann::json& accessor, size_t width) const {
    return elements(accessor, width).count;
  }
  // [count, width] of an accessor: VEC3 has 3. Integers that are normalised become -1..1 or 0..1.
  // memory: counts them.
  std::vector<float> numbers(const nlohmann::json& accessor, size_t width,
                             std::shared_ptr<void>* memory) const;
  // Entry `index` of an array of the root.
  const nlohmann::json& entry(const char* array, const nlohmann::json& index) const;

  [[noreturn]] void fail(const std::string& message) const;
  // A whole number of an object; `otherwise` where it is not there.
  uint64_t whole(const nlohmann::json& object, const char* key, uint64_t otherwise) const;

 private:
  struct Span {
    const uint8_t* data;
    uint64_t size;
  };

  struct Elements {
    const uint8_t* data;
    size_t count;
    uint64_t stride;
    size_t component;  // of its types
    bool is_share;     // integers are
  };

  void parse(const char* begin, size_t size);
  void read_buffers();
  Span buffer_of(const std::string& uri);
  Span view(const nlohmann::json& accessor, uint64_t* stride) const;
  Elements elements(const nlohmann::json& accessor, size_t width) const;

  std::string path_;
  Hold holder_;
  std::function<void(const std::string&)> reads_;
  std::vector<std::shared_ptr<void>> memory_;
  std::vector<uint8_t> file_;
  nlohmann::json root_;
  std::map<std::string, std::vector<uint8_t>> own_;  // buffers by their URI
  std::vector<Span> buffers_;
  Span binary_{nullptr, 0};  // the second chunk of a .glb
};

}  // namespace l4d::io
