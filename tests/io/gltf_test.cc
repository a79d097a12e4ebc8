// SPDX-License-Identifier: Apache-2.0
// Splats of glTF: what was written comes back, and nodes put it where they say.
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "io/formats/scene_file.h"
#include "io/formats/write_gltf.h"
#include "io/scene/shape3.h"
#include "libl4dcodec/scene/sh.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;

constexpr double kQuarter = 0.7071067811865476;

class GltfTest : public test::IoTest {
 protected:
  static Splats three_splats() {
    Splats splats;
    splats.sh_degree = 2;
    splats.position = {1.5F, -2.25F, 0.1F, 0, 4, 1e-9F, -3, 0.5F, 2};
    splats.covariance = {0.25F, 0.02F, 0.01F, 0.125F, 0,       0.5F, 4,    0,    0,
                         1,     0,     9,     0.5F,   -0.125F, 0,    0.5F, 0.1F, 0.25F};
    splats.opacity = {0.25F, 1, 0.5F};
    for (size_t k = 0; k < size_t{3} * 3 * 9; ++k) {
      splats.sh.push_back(static_cast<float>(std::sin(1.7 * static_cast<double>(k))));
    }
    return splats;
  }
  // The three splats as a .gltf and a .bin beside it, which a test may change.
  Json document(const l4d_placement& placement = {
                    {0, 0, 0}, 1, L4D_COORDINATES_RIGHT_UP_BACK, L4D_COLOR_SRGB}) {
    InstantSetting setting;
    setting.placement = placement;
    write_gltf(path("a.glb"), three_splats(), setting);
    const std::string bytes = test::read_bytes(path("a.glb"));
    uint32_t length = 0;
    std::memcpy(&length, &bytes[12], sizeof(length));
    write("a.bin", bytes.substr(28 + length));
    Json json = Json::parse(bytes.substr(20, length));
    json["buffers"][0]["uri"] = "a.bin";
    return json;
  }
  Scene read(const Json& json) {
    write("a.gltf", json.dump());
    return read_scene_file(path("a.gltf"), "a.gltf");
  }
  static Vec3 color(uint32_t degree, const float* sh, const Vec3& direction) {
    Vec3 out{};
    sh_color(degree, sh, direction.data(), out.data());
    return out;
  }
  // Covariance of Gaussian i.
  static Matrix3 covariance(const Scene& scene, size_t i) {
    Rotor rotor{};
    Vec4 scale{};
    for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(scene.rotor[8 * i + k]);
    for (size_t k = 0; k < 4; ++k) {
      scale[k] = std::exp(static_cast<double>(scene.log_scale[4 * i + k]));
    }
    const Slice s = slice(rotor, scale);
    Matrix3 out{};
    for (size_t a = 0; a < 3; ++a) {
      for (size_t b = 0; b < 3; ++b) {
        for (size_t k = 0; k < 4; ++k) out[3 * a + b] += s.rows[a][k] * s.rows[b][k];
      }
    }
    return out;
  }
};

TEST_F(GltfTest, WhatIsWrittenComesBack) {
  const Splats splats = three_splats();
  const l4d_placement placement = {
      {10, 20, -30.5}, 2, L4D_COORDINATES_RIGHT_DOWN_FORWARD, L4D_COLOR_LINEAR_SRGB};
  document(placement);
  const Scene scene = read_scene_file(path("a.glb"), "a.glb");
  EXPECT_EQ(scene.source, "gltf");
  EXPECT_EQ(scene.position, splats.position);
  EXPECT_EQ(scene.opacity, splats.opacity);
  EXPECT_EQ(scene.sh, splats.sh);
  EXPECT_EQ(scene.placement.coordinate_system, placement.coordinate_system);
  EXPECT_EQ(scene.placement.color_space, placement.color_space);
  EXPECT_EQ(scene.placement.scale, 2);
  for (size_t k = 0; k < 3; ++k) EXPECT_EQ(scene.placement.origin[k], placement.origin[k]);
  for (size_t i = 0; i < 3; ++i) {
    const float* c = &splats.covariance[6 * i];
    const Matrix3 found = covariance(scene, i);
    const float wanted[] = {c[0], c[1], c[2], c[1], c[3], c[4], c[2], c[4], c[5]};
    for (size_t k = 0; k < 9; ++k) EXPECT_NEAR(found[k], static_cast<double>(wanted[k]), 2e-6 * 9);
  }
}

// A quarter turn around y in one node, a scale and a shift in the one around it.
TEST_F(GltfTest, NodesTurnPositionsShapesAndColours) {
  Json json = document();
  json["nodes"] = {{{"children", {1}}, {"scale", {2, 2, 2}}, {"translation", {0, 0, 5}}},
                   {{"mesh", 0}, {"rotation", {0, kQuarter, 0, kQuarter}}},
                   {{"mesh", 0}, {"translation", {100, 0, 0}}}};
  json["scenes"][0]["nodes"] = {0, 2};
  const Scene scene = read(json);
  const Splats splats = three_splats();
  ASSERT_EQ(scene.count(), 6u);
  const auto turned = [](const Vec3& v) { return Vec3{v[2], v[1], -v[0]}; };
  // The nodes that stand last come first.
  for (size_t i = 0; i < 3; ++i) {
    const float* p = &splats.position[3 * i];
    const Vec3 at =
        turned({static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])});
    const float* moved = &scene.position[3 * i];
    const float* here = &scene.position[3 * (3 + i)];
    EXPECT_FLOAT_EQ(moved[0], p[0] + 100);
    for (size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(static_cast<double>(here[k]), 2 * at[k] + (k == 2 ? 5 : 0), 1e-6) << i;
    }
    // x becomes -z and z becomes x.
    const float* c = &splats.covariance[6 * i];
    const Matrix3 shape = covariance(scene, 3 + i);
    EXPECT_NEAR(shape[0], 4 * static_cast<double>(c[5]), 1e-4);
    EXPECT_NEAR(shape[8], 4 * static_cast<double>(c[0]), 1e-4);
    EXPECT_NEAR(shape[2], -4 * static_cast<double>(c[2]), 1e-4);
    EXPECT_NEAR(shape[1], 4 * static_cast<double>(c[4]), 1e-4);
    for (const Vec3& d : {Vec3{1, 0, 0}, Vec3{0.48, -0.6, 0.64}, Vec3{-0.6, 0, -0.8}}) {
      const Vec3 before = color(2, &splats.sh[27 * i], d);
      const Vec3 after = color(2, &scene.sh[27 * (3 + i)], turned(d));
      for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(before[k], after[k], 1e-5) << i;
    }
  }
}

// The extension allows any scales above 0: covariances become M C M^T.
TEST_F(GltfTest, NodesStretchShapes) {
  Json json = document();
  json["nodes"][0]["scale"] = {1, 2, 4};
  json["nodes"][0]["rotation"] = {0, kQuarter, 0, kQuarter};
  const Scene scene = read(json);
  const Splats splats = three_splats();
  ASSERT_EQ(scene.count(), 3u);
  for (size_t i = 0; i < 3; ++i) {
    const float* c = &splats.covariance[6 * i];
    // x becomes -z, four times as long z becomes x.
    const Matrix3 shape = covariance(scene, i);
    EXPECT_NEAR(shape[0], 16 * static_cast<double>(c[5]), 1e-4);
    EXPECT_NEAR(shape[1], 8 * static_cast<double>(c[4]), 1e-4);
    EXPECT_NEAR(shape[2], -4 * static_cast<double>(c[2]), 1e-4);
    EXPECT_NEAR(shape[4], 4 * static_cast<double>(c[3]), 1e-4);
    EXPECT_NEAR(shape[8], static_cast<double>(c[0]), 1e-4);
    EXPECT_FLOAT_EQ(scene.position[3 * i], 4 * splats.position[3 * i + 2]);
    const Vec3 before = color(2, &splats.sh[27 * i], {0.48, -0.6, 0.64});
    const Vec3 after = color(2, &scene.sh[27 * i], {0.64, -0.6, -0.48});
    for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(before[k], after[k], 1e-5) << i;
  }
}

// Positions of integers need another extension than that of splats.
TEST_F(GltfTest, QuantizedPositionsAreRead) {
  Json json = document();
  json["extensionsRequired"] = {"KHR_mesh_quantization"};
  // 1 -1 0, 2 0 3, 0 0 -4, each with a byte that is skipped.
  json["buffers"].push_back(
      {{"byteLength", 12}, {"uri", "data:application/octet-stream;base64,Af8AAAIAAwAAAPwA"}});
  json["bufferViews"].push_back({{"buffer", 1}, {"byteLength", 12}, {"byteStride", 4}});
  Json& accessor = json["accessors"][0];
  accessor["bufferView"] = json["bufferViews"].size() - 1;
  accessor["componentType"] = 5120;
  EXPECT_EQ(read(json).position, (std::vector<float>{1, -1, 0, 2, 0, 3, 0, 0, -4}));
}

TEST_F(GltfTest, IntegersThatAreSharesAndStrides) {
  Json json = document();
  // Opacities 1 and 51/255 in bytes, each with three that are skipped, in a data URI: ff..33..80.
  json["buffers"].push_back(
      {{"byteLength", 12}, {"uri", "data:application/octet-stream;base64,/wAAADMAAACAAAAA"}});
  json["bufferViews"].push_back({{"buffer", 1}, {"byteLength", 12}, {"byteStride", 4}});
  json["accessors"].push_back({{"bufferView", json["bufferViews"].size() - 1},
                               {"componentType", 5121},
                               {"normalized", true},
                               {"count", 3},
                               {"type", "SCALAR"}});
  Json& attributes = json["meshes"][0]["primitives"][0]["attributes"];
  attributes["KHR_gaussian_splatting:OPACITY"] = json["accessors"].size() - 1;
  const Scene scene = read(json);
  EXPECT_EQ(scene.opacity, (std::vector<float>{1, 0.2F, 128.0F / 255}));
}

// An earlier draft had logarithms under the same name.
TEST_F(GltfTest, ScalesBelowZeroAreLogarithms) {
  Json json = document();
  Json& attributes = json["meshes"][0]["primitives"][0]["attributes"];
  attributes["KHR_gaussian_splatting:SCALE"] = attributes["POSITION"];
  const Scene scene = read(json);
  EXPECT_EQ(scene.log_scale[1], -2.25F);
  const auto is_of_logarithms = [](const std::string& note) {
    return note.find("logarithms") != std::string::npos;
  };
  EXPECT_TRUE(std::any_of(scene.notes.begin(), scene.notes.end(), is_of_logarithms));
}

TEST_F(GltfTest, WhatIsNotReadIsRefused) {
  struct Case {
    const char* why;
    l4d_status status;
    const char* message;
    std::function<void(Json&)> change;
  };
  const auto attributes = [](Json& j) -> Json& {
    return j["meshes"][0]["primitives"][0]["attributes"];
  };
  const auto extension = [](Json& j) -> Json& {
    return j["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"];
  };
  const std::string prefix = "KHR_gaussian_splatting:";
  const Case cases[] = {
      {"a coefficient is missing", L4D_ERR_CORRUPT, "degree 2 are missing",
       [&](Json& j) { attributes(j).erase(prefix + "SH_DEGREE_2_COEF_3"); }},
      {"no scale", L4D_ERR_CORRUPT, "without KHR_gaussian_splatting:SCALE",
       [&](Json& j) { attributes(j).erase(prefix + "SCALE"); }},
      {"another kernel", L4D_ERR_FEATURE_UNSUPPORTED, "the kernel cube",
       [&](Json& j) { extension(j)["kernel"] = "cube"; }},
      {"a kernel that is a number", L4D_ERR_CORRUPT, "kernel is no text",
       [&](Json& j) { extension(j)["kernel"] = 4; }},
      {"no splats", L4D_ERR_FEATURE_UNSUPPORTED, "no splats",
       [&](Json& j) { j["meshes"][0]["primitives"][0].erase("extensions"); }},
      {"compressed", L4D_ERR_FEATURE_UNSUPPORTED, "needs the extension \"EXT_x\"",
       [](Json& j) {
         j["extensionsRequired"] = {"KHR_gaussian_splatting", "EXT_x"};
       }},
      {"mirrored", L4D_ERR_FEATURE_UNSUPPORTED, "mirrors",
       [](Json& j) {
         j["nodes"][0]["scale"] = {-1, 1, 1};
       }},
      {"sheared", L4D_ERR_FEATURE_UNSUPPORTED, "shears",
       [](Json& j) { j["nodes"][0]["matrix"] = {1, 0, 0, 0, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}; }},
      {"a node in itself", L4D_ERR_CORRUPT, "two places",
       [](Json& j) { j["nodes"][0]["children"] = {0}; }},
      {"a node that is none", L4D_ERR_CORRUPT, "no entry 7 of nodes",
       [](Json& j) { j["nodes"][0]["children"] = {7}; }},
      {"a rotation of three numbers", L4D_ERR_CORRUPT, "another length",
       [](Json& j) {
         j["nodes"][0]["rotation"] = {0, 0, 1};
       }},
      {"too many splats", L4D_ERR_CORRUPT, "beyond its buffer view",
       [](Json& j) { j["accessors"][0]["count"] = 400000000; }},
      {"of another number", L4D_ERR_CORRUPT, "another number of splats",
       [](Json& j) { j["accessors"][0]["count"] = 2; }},
      {"a view beyond", L4D_ERR_CORRUPT, "beyond its buffer",
       [](Json& j) { j["bufferViews"][0]["byteOffset"] = uint64_t{1} << 62; }},
      {"a buffer that is short", L4D_ERR_CORRUPT, "shorter",
       [](Json& j) { j["buffers"][0]["byteLength"] = 1 << 20; }},
      {"a file elsewhere", L4D_ERR_CORRUPT, "not beside it",
       [](Json& j) { j["buffers"][0]["uri"] = "../a.bin"; }},
      {"no base64", L4D_ERR_CORRUPT, "no base64",
       [](Json& j) { j["buffers"][0]["uri"] = "data:;base64,!!"; }},
      {"shown 90,000 times", L4D_ERR_LIMIT_EXCEEDED, "more splats than the file has bytes",
       [](Json& j) {
         const Json node = {{"mesh", 0}};
         const Json primitive = j["meshes"][0]["primitives"][0];
         for (int k = 0; k < 30; ++k) j["meshes"][0]["primitives"].push_back(primitive);
         j["nodes"] = Json(3000, node);
         j["scenes"][0]["nodes"] = Json::array();
         for (int k = 0; k < 3000; ++k) j["scenes"][0]["nodes"].push_back(k);
       }},
      {"sparse", L4D_ERR_FEATURE_UNSUPPORTED, "sparse",
       [](Json& j) { j["accessors"][0]["sparse"] = Json::object(); }},
      {"an opacity of 4", L4D_ERR_CORRUPT, "an opacity of 4", [&](Json& j) {
         j["accessors"][attributes(j)[prefix + "OPACITY"].get<size_t>()]["bufferView"] =
             j["accessors"][0]["bufferView"];
         j["accessors"][attributes(j)[prefix + "OPACITY"].get<size_t>()]["byteOffset"] = 16;
       }}};
  for (const Case& c : cases) {
    Json json = document();
    c.change(json);
    try {
      read(json);
      ADD_FAILURE() << c.why;
    } catch (const Error& error) {
      EXPECT_EQ(error.status(), c.status) << c.why;
      EXPECT_NE(std::string(error.what()).find(c.message), std::string::npos)
          << c.why << ": " << error.what();
    }
  }
}

// Each file that ends early, or has one byte changed, is read or refused.
TEST_F(GltfTest, DamagedFilesAreRefusedOrRead) {
  document();
  const std::string good = test::read_bytes(path("a.glb"));
  for (size_t k = 0; k < good.size(); k += 7) {
    std::string cut = good.substr(0, k), changed = good;
    changed[k] = static_cast<char>(changed[k] ^ 0x15);
    for (const std::string& bytes : {cut, changed}) {
      write("b.glb", bytes);
      try {
        EXPECT_LE(read_scene_file(path("b.glb"), "b.glb").count(), 3u);
      } catch (const Error& error) {
        EXPECT_NE(error.status(), L4D_ERR_INTERNAL) << error.what();
      }
    }
  }
}

}  // namespace
}  // namespace l4d::io
