// SPDX-License-Identifier: Apache-2.0
// glTF 2.0 with KHR_gaussian_splatting: y is up, scales are lengths and opacities from 0 to 1. What
// is no splats is not read.
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "io/formats/gltf_document.h"
#include "io/formats/readers.h"
#include "io/ply/static_scene.h"
#include "io/scene/shape3.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;

constexpr uint32_t kMostDegree = 3;
constexpr size_t kMostParts = 65536;
constexpr double kLeastScale = 1.1253517471925912e-7;  // e^-16
constexpr double kSame = 1e-5;                         // of lengths and angles of axes

constexpr Matrix3 kIdentity = {1, 0, 0, 0, 1, 0, 0, 0, 1};
// Half a turn around x: of scenes whose y is down.
constexpr Matrix3 kHalfTurn = {1, 0, 0, 0, -1, 0, 0, 0, -1};

// Scales along the axes, and then a rotation.
struct Turn {
  Vec3 scale{1, 1, 1};
  Matrix3 rotation = kIdentity;

  bool is(const Matrix3& other) const {
    for (size_t k = 0; k < 9; ++k) {
      if (!(std::abs(rotation[k] - other[k]) <= kSame)) return false;
    }
    return true;
  }
  bool is_even() const {
    return std::abs(scale[1] - scale[0]) <= kSame * scale[0] &&
           std::abs(scale[2] - scale[0]) <= kSame * scale[0];
  }
};

Turn turn_of(const GltfDocument& document, const Matrix3& m) {
  const auto column = [&](size_t j) { return Vec3{m[j], m[3 + j], m[6 + j]}; };
  Turn turn;
  bool is_turn = dot(cross(column(0), column(1)), column(2)) > 0;
  for (size_t j = 0; j < 3; ++j) {
    turn.scale[j] = std::sqrt(dot(column(j), column(j)));
    is_turn = is_turn && turn.scale[j] > 0 && std::isfinite(turn.scale[j] * turn.scale[j]);
    for (size_t k = 0; k < j; ++k) {
      is_turn =
          is_turn && std::abs(dot(column(j), column(k))) <= kSame * turn.scale[j] * turn.scale[k];
    }
  }
  if (!is_turn) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                document.path() + ": a node shears splats, or mirrors them");
  }
  for (size_t k = 0; k < 9; ++k) turn.rotation[k] = m[k] / turn.scale[k % 3];
  return turn;
}

// What turns coefficients of SH: the colours in many directions, as those of the turned ones.
Eigen::MatrixXd turn_of_harmonics(const Matrix3& rotation, uint32_t degree) {
  constexpr int kDirections = 64;
  const int terms = static_cast<int>(sh_terms(degree));
  Eigen::MatrixXd turned(kDirections, terms), still(kDirections, terms);
  for (int i = 0; i < kDirections; ++i) {  // points of a spiral
    const double z = 1 - (2 * i + 1.0) / kDirections, r = std::sqrt(1 - z * z);
    const double angle = 2.399963229728653 * i;
    const Vec3 d = {r * std::cos(angle), r * std::sin(angle), z};
    const Vec3 back = {rotation[0] * d[0] + rotation[3] * d[1] + rotation[6] * d[2],
                       rotation[1] * d[0] + rotation[4] * d[1] + rotation[7] * d[2],
                       rotation[2] * d[0] + rotation[5] * d[1] + rotation[8] * d[2]};
    std::array<double, kMaxShTerms> basis{};
    sh_basis(degree, d[0], d[1], d[2], basis.data());
    for (int k = 0; k < terms; ++k) turned(i, k) = basis[static_cast<size_t>(k)];
    sh_basis(degree, back[0], back[1], back[2], basis.data());
    for (int k = 0; k < terms; ++k) still(i, k) = basis[static_cast<size_t>(k)];
  }
  return turned.colPivHouseholderQr().solve(still);
}

// A primitive of splats, and where it is.
struct Part {
  const Json* attributes;
  GltfPlace place;
  size_t count = 0;
  uint32_t degree = 0;
};

class GltfReader {
 public:
  GltfReader(InputFile* input, const ImportOptions& options)
      : options_(options), document_(input, options) {}

  Scene read() {
    check_extensions();
    find_parts();
    if (parts_.empty()) {
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED, document_.path() + ": there are no splats in it (" +
                                                   std::string(kGltfSplats) + ")");
    }
    uint32_t degree = 0;
    for (const Part& part : parts_) degree = std::max(degree, part.degree);
    std::shared_ptr<void> memory =
        hold(options_.holder, static_scene_bytes(count_, degree), document_.path());
    rows_ = StaticRows(static_cast<size_t>(count_), degree);
    choose_placement();
    for (const Part& part : parts_) add(part);
    Scene scene = static_scene(std::move(rows_), "gltf", options_);
    scene.memory = std::move(memory);
    scene.placement = placement_;
    if (others_ > 0) {
      scene.notes.push_back(
          "Meshes of the glTF that are no splats were not read: " + std::to_string(others_) + ".");
    }
    if (is_draft_) {
      scene.notes.push_back(
          "Scales of the glTF below 0 are taken for logarithms, as an earlier draft of " +
          std::string(kGltfSplats) + " has them.");
    }
    return scene;
  }

 private:
  void check_extensions() const {
    const auto required = document_.root().find("extensionsRequired");
    if (required == document_.root().end() || !required->is_array()) return;
    for (const Json& name : *required) {
      // Integers are read anyway, as of positions and of other attributes.
      if (name == kGltfSplats || name == "KHR_mesh_quantization") continue;
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                  document_.path() + ": it needs the extension " + name.dump() + " of glTF");
    }
  }

  // The parts of each mesh once, and then where nodes show them.
  void find_parts() {
    std::map<size_t, std::vector<Part>> meshes;
    for (const GltfPlace& place : document_.places()) {
      const auto [mesh, is_new] = meshes.try_emplace(place.mesh);
      if (is_new) mesh->second = parts_of(document_.entry("meshes", Json(place.mesh)));
      for (Part part : mesh->second) {
        count_ += part.count;
        // A splat takes 32 bytes at least, and nodes may show it again.
        if (count_ > document_.bytes() || parts_.size() == kMostParts) {
          throw Error(L4D_ERR_LIMIT_EXCEEDED, document_.path() +
                                                  ": nodes show more splats than the file has "
                                                  "bytes, or more than 65,536 parts");
        }
        part.place = place;
        parts_.push_back(part);
      }
    }
  }

  std::vector<Part> parts_of(const Json& mesh) {
    const auto primitives = mesh.find("primitives");
    if (primitives == mesh.end() || !primitives->is_array()) document_.fail("a mesh is empty");
    std::vector<Part> parts;
    for (const Json& primitive : *primitives) add_part(primitive, &parts);
    return parts;
  }

  void add_part(const Json& primitive, std::vector<Part>* parts) {
    const auto extensions = primitive.find("extensions");
    if (!primitive.is_object() || extensions == primitive.end() ||
        !extensions->contains(kGltfSplats)) {
      ++others_;
      return;
    }
    const Json& extension = (*extensions)[kGltfSplats];
    const auto attributes = primitive.find("attributes");
    if (!extension.is_object() || attributes == primitive.end() || !attributes->is_object()) {
      document_.fail("a primitive of splats has no attributes");
    }
    check_form(extension);
    Part part{&*attributes, {}};
    part.count = document_.count(accessor(part, "POSITION"), 3);
    while (part.degree < kMostDegree && has_degree(part, part.degree + 1)) ++part.degree;
    parts->push_back(part);
  }

  // How it is meant to be drawn.
  void check_form(const Json& extension) {
    const auto text = [&](const char* key, const char* otherwise) -> std::string {
      const auto found = extension.find(key);
      if (found == extension.end()) return otherwise;
      if (!found->is_string()) document_.fail(std::string(key) + " is no text");
      return found->get<std::string>();
    };
    const std::string kernel = text("kernel", "ellipse");
    const std::string space = text("colorSpace", "srgb_rec709_display");
    const bool is_linear = space == "lin_rec709_display";
    if (kernel != "ellipse" || (!is_linear && space != "srgb_rec709_display")) {
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                  document_.path() + ": splats of the kernel " + kernel + " in " + space);
    }
    const uint32_t color_space = is_linear ? L4D_COLOR_LINEAR_SRGB : L4D_COLOR_SRGB;
    if (has_splats_ && color_space != placement_.color_space) {
      throw Error(L4D_ERR_FEATURE_UNSUPPORTED, document_.path() + ": splats in two colour spaces");
    }
    placement_.color_space = color_space;
    has_splats_ = true;
  }

  static std::string harmonic(uint32_t degree, uint32_t k) {
    return std::string(kGltfSplats) + ":SH_DEGREE_" + std::to_string(degree) + "_COEF_" +
           std::to_string(k);
  }

  bool has_degree(const Part& part, uint32_t degree) const {
    uint32_t there = 0;
    for (uint32_t k = 0; k <= 2 * degree; ++k)
      there += part.attributes->contains(harmonic(degree, k));
    if (there != 0 && there != 2 * degree + 1) {
      document_.fail("coefficients of degree " + std::to_string(degree) + " are missing");
    }
    return there != 0;
  }

  const Json& accessor(const Part& part, const std::string& name) const {
    const auto found = part.attributes->find(name);
    if (found == part.attributes->end()) document_.fail("splats without " + name);
    return document_.entry("accessors", *found);
  }

  std::vector<float> numbers(const Part& part, const std::string& name, size_t width,
                             std::shared_ptr<void>* memory) const {
    std::vector<float> out = document_.numbers(accessor(part, name), width, memory);
    if (out.size() != width * part.count) document_.fail(name + " is of another number of splats");
    return out;
  }

  // One place for all, that differs in nothing but what a scene can state, is stated: positions
  // stay as they are.
  void choose_placement() {
    placement_.scale = 1;
    placement_.coordinate_system = L4D_COORDINATES_RIGHT_UP_BACK;
    if (parts_.size() != 1) return;
    GltfPlace& place = parts_[0].place;
    const Turn turn = turn_of(document_, place.linear);
    const bool is_down = turn.is(kHalfTurn);
    if (!turn.is_even() || (!is_down && !turn.is(kIdentity))) return;
    const double sign = is_down ? -1 : 1;
    const Vec3& t = place.translation;
    const Vec3 origin = {t[0], sign * t[1], sign * t[2]};
    std::copy(origin.begin(), origin.end(), placement_.origin);
    placement_.scale = turn.scale[0];
    if (is_down) placement_.coordinate_system = L4D_COORDINATES_RIGHT_DOWN_FORWARD;
    place.linear = kIdentity;
    place.translation = {};
  }

  void add(const Part& part) {
    const Turn turn = turn_of(document_, part.place.linear);
    add_positions(part);
    add_shapes(part, turn);
    add_opacities(part);
    add_colors(part, turn);
    begin_ += part.count;
  }

  void add_positions(const Part& part) {
    std::shared_ptr<void> memory;
    const std::vector<float> position = numbers(part, "POSITION", 3, &memory);
    for (size_t i = 0; i < part.count; ++i) {
      const float* p = &position[3 * i];
      const Vec3 own = {static_cast<double>(p[0]), static_cast<double>(p[1]),
                        static_cast<double>(p[2])};
      const Vec3 at = product(part.place.linear, own);
      for (size_t k = 0; k < 3; ++k) {
        rows_.position[3 * (begin_ + i) + k] =
            static_cast<float>(at[k] + part.place.translation[k]);
      }
    }
  }

  void add_shapes(const Part& part, const Turn& turn) {
    const std::string prefix = std::string(kGltfSplats) + ":";
    std::shared_ptr<void> memory, more;
    const std::vector<float> xyzw = numbers(part, prefix + "ROTATION", 4, &memory);
    const std::vector<float> scale = numbers(part, prefix + "SCALE", 3, &more);
    const bool are_logs = std::any_of(scale.begin(), scale.end(), [](float s) { return s < 0; });
    const bool is_turned = !turn.is(kIdentity);
    is_draft_ = is_draft_ || are_logs;
    for (size_t i = 0; i < part.count; ++i) {
      Vec3 log_scale{};
      for (size_t k = 0; k < 3; ++k) {
        const double s = static_cast<double>(scale[3 * i + k]);
        log_scale[k] = are_logs ? s : std::log(std::max(s, kLeastScale));
      }
      const float* q = &xyzw[4 * i];
      const auto as_double = [&](size_t k) { return static_cast<double>(q[k]); };
      Vec4 wxyz = {as_double(3), as_double(0), as_double(1), as_double(2)};
      if (!turn.is_even()) {
        stretch(part.place.linear, &wxyz, &log_scale);
      } else {
        if (is_turned) {
          wxyz = matrix_to_quaternion(product(turn.rotation, quaternion_to_matrix(wxyz)));
        }
        for (double& s : log_scale) s += std::log(turn.scale[0]);
      }
      for (size_t k = 0; k < 4; ++k) {
        rows_.rotation[4 * (begin_ + i) + k] = static_cast<float>(wxyz[k]);
      }
      for (size_t k = 0; k < 3; ++k) {
        rows_.log_scale[3 * (begin_ + i) + k] = static_cast<float>(log_scale[k]);
      }
    }
  }

  // Another ellipsoid, whose axes are not where those of the first go.
  static void stretch(const Matrix3& linear, Vec4* wxyz, Vec3* log_scale) {
    const Matrix3 axes = product(linear, quaternion_to_matrix(*wxyz));
    std::array<Vec4, 3> rows{};
    for (size_t j = 0; j < 3; ++j) {
      for (size_t k = 0; k < 3; ++k) rows[j][k] = axes[3 * j + k] * std::exp((*log_scale)[k]);
    }
    const Shape3 shape = shape_of_rows(rows);
    *wxyz = shape.wxyz;
    for (size_t k = 0; k < 3; ++k)
      (*log_scale)[k] = std::log(std::max(shape.scale[k], kLeastScale));
  }

  void add_opacities(const Part& part) {
    std::shared_ptr<void> memory;
    const std::vector<float> opacity =
        numbers(part, std::string(kGltfSplats) + ":OPACITY", 1, &memory);
    for (size_t i = 0; i < part.count; ++i) {
      if (opacity[i] < 0 || opacity[i] > 1) {
        document_.fail("an opacity of " + std::to_string(opacity[i]) + "; it is from 0 to 1");
      }
      rows_.opacity[begin_ + i] = opacity[i];
    }
  }

  void add_colors(const Part& part, const Turn& turn) {
    const size_t terms = sh_terms(part.degree), all = sh_terms(rows_.sh_degree);
    uint32_t at = 0;
    for (uint32_t degree = 0; degree <= part.degree; ++degree) {
      for (uint32_t k = 0; k <= 2 * degree; ++k, ++at) {
        std::shared_ptr<void> memory;
        const std::vector<float> values = numbers(part, harmonic(degree, k), 3, &memory);
        for (size_t i = 0; i < part.count; ++i) {
          std::copy_n(&values[3 * i], 3, &rows_.sh[3 * ((begin_ + i) * all + at)]);
        }
      }
    }
    if (part.degree == 0 || turn.is(kIdentity)) return;
    const Eigen::MatrixXd matrix = turn_of_harmonics(turn.rotation, part.degree);
    Eigen::MatrixXd before(static_cast<Eigen::Index>(terms), 3), after(before);
    for (size_t i = 0; i < part.count; ++i) {
      float* sh = &rows_.sh[3 * (begin_ + i) * all];
      for (size_t k = 0; k < 3 * terms; ++k) {
        before(static_cast<Eigen::Index>(k / 3), static_cast<Eigen::Index>(k % 3)) =
            static_cast<double>(sh[k]);
      }
      after.noalias() = matrix * before;
      for (size_t k = 0; k < 3 * terms; ++k) {
        sh[k] = static_cast<float>(
            after(static_cast<Eigen::Index>(k / 3), static_cast<Eigen::Index>(k % 3)));
      }
    }
  }

  const ImportOptions& options_;
  GltfDocument document_;
  std::vector<Part> parts_;
  StaticRows rows_{0, 0};
  l4d_placement placement_{{0, 0, 0}, 1, L4D_COORDINATES_RIGHT_UP_BACK, L4D_COLOR_SRGB};
  uint64_t count_ = 0;
  bool has_splats_ = false;
  size_t begin_ = 0;   // of the rows of the part that is added
  size_t others_ = 0;  // primitives that are no splats
  bool is_draft_ = false;
};

}  // namespace

Scene read_gltf(InputFile file, const ImportOptions& options) {
  return GltfReader(&file, options).read();
}

}  // namespace l4d::io
