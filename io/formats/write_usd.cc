// SPDX-License-Identifier: Apache-2.0
#include "io/formats/write_usd.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <string_view>

#include "io/file/file.h"
#include "io/scene/shape3.h"
#include "io/scene/statements.h"

namespace l4d::io {
namespace {

// What lies further out than this many standard deviations is next to invisible.
constexpr double kExtentSigmas = 3;

// Text that goes out in large pieces.
class UsdText {
 public:
  UsdText(const std::string& path, const Check& check) : file_(path, check) {}

  void add(std::string_view text) {
    text_ += text;
    constexpr size_t kPiece = size_t{1} << 20;
    if (text_.size() > kPiece) flush();
  }
  // The shortest number that reads back as this one.
  void add(float value) {
    char digits[32];
    add(std::string_view(
        digits,
        static_cast<size_t>(std::to_chars(digits, digits + sizeof(digits), value).ptr - digits)));
  }
  // "(1, 2, 3)", or a bare number
  void add_tuple(const float* values, size_t count) {
    if (count > 1) add("(");
    for (size_t k = 0; k < count; ++k) {
      if (k > 0) add(", ");
      add(values[k]);
    }
    if (count > 1) add(")");
  }
  // An attribute with `rows` tuples; `row` gives one of them at a time.
  void add_array(std::string_view type_and_name, size_t rows, size_t numbers,
                 const std::function<void(size_t i, float* out)>& row,
                 std::string_view metadata = "") {
    add("    ");
    add(type_and_name);
    add(" = [");
    for (size_t i = 0; i < rows; ++i) {
      float values[4];
      row(i, values);
      if (i > 0) add(", ");
      add_tuple(values, numbers);
    }
    add("]");
    add(metadata);
    add("\n");
  }
  void commit() {
    flush();
    file_.commit();
  }

 private:
  void flush() {
    file_.write(text_.data(), text_.size());
    text_.clear();
  }

  OutputFile file_;
  std::string text_;
};

std::string triple(double x, double y, double z) {
  return "(" + text_of_number(x) + ", " + text_of_number(y) + ", " + text_of_number(z) + ")";
}

// What turns positions into the coordinates of the placement, in axes with y up.
std::string transform_of(const l4d_placement& p) {
  const bool is_turned = p.coordinate_system == L4D_COORDINATES_RIGHT_DOWN_FORWARD;
  std::string text, order;
  const auto add = [&](const std::string& type, const std::string& name, const std::string& value) {
    text += "    " + type + " xformOp:" + name + " = " + value + "\n";
    order += (order.empty() ? "" : ", ") + ("\"xformOp:" + name + "\"");
  };
  if (p.origin[0] != 0 || p.origin[1] != 0 || p.origin[2] != 0) {
    const double sign = is_turned ? -1 : 1;
    add("double3", "translate", triple(p.origin[0], sign * p.origin[1], sign * p.origin[2]));
  }
  if (is_turned) add("float", "rotateX", "180");
  if (p.scale != 1) add("float3", "scale", triple(p.scale, p.scale, p.scale));
  if (order.empty()) return "";
  return text + "    uniform token[] xformOpOrder = [" + order + "]\n";
}

// A box around the Gaussians, in their own coordinates.
void add_extent(const Splats& splats, UsdText* text) {
  constexpr size_t kVariance[3] = {0, 3, 5};
  float box[2][3] = {};
  for (size_t i = 0; i < splats.count(); ++i) {
    for (size_t k = 0; k < 3; ++k) {
      const double variance = static_cast<double>(splats.covariance[6 * i + kVariance[k]]);
      const float reach = static_cast<float>(kExtentSigmas * std::sqrt(std::max(variance, 0.0)));
      const float x = splats.position[3 * i + k];
      box[0][k] = i == 0 ? x - reach : std::min(box[0][k], x - reach);
      box[1][k] = i == 0 ? x + reach : std::max(box[1][k], x + reach);
    }
  }
  text->add_array("float3[] extent", 2, 3,
                  [&](size_t i, float* out) { std::copy_n(box[i], 3, out); });
}

void add_gaussians(const Splats& splats, bool is_linear, UsdText* text) {
  const size_t n = splats.count();
  const size_t coefficients = (size_t{splats.sh_degree} + 1) * (splats.sh_degree + 1);
  std::vector<Shape3> shapes(n);
  for (size_t i = 0; i < n; ++i) shapes[i] = shape_of_covariance(&splats.covariance[6 * i]);
  text->add_array("point3f[] positions", n, 3,
                  [&](size_t i, float* out) { std::copy_n(&splats.position[3 * i], 3, out); });
  text->add_array("quatf[] orientations", n, 4, [&](size_t i, float* out) {  // w x y z
    for (size_t k = 0; k < 4; ++k) out[k] = static_cast<float>(shapes[i].wxyz[k]);
  });
  text->add_array("float3[] scales", n, 3, [&](size_t i, float* out) {
    for (size_t k = 0; k < 3; ++k) out[k] = static_cast<float>(shapes[i].scale[k]);
  });
  text->add_array("float[] opacities", n, 1,
                  [&](size_t i, float* out) { *out = std::clamp(splats.opacity[i], 0.0F, 1.0F); });
  text->add("    uniform int radiance:sphericalHarmonicsDegree = " +
            std::to_string(splats.sh_degree) + "\n");
  text->add_array("float3[] radiance:sphericalHarmonicsCoefficients", n * coefficients, 3,
                  [&](size_t i, float* out) { std::copy_n(&splats.sh[3 * i], 3, out); });
  text->add_array(
      "color3f[] primvars:displayColor", n, 3,
      [&](size_t i, float* out) { linear_base_color(splats, is_linear, i, out); },
      " (\n        interpolation = \"vertex\"\n    )");
}

}  // namespace

WriteNotes write_usd(const std::string& path, Splats splats, const InstantSetting& setting) {
  require_finite(splats, path);
  WriteNotes notes;
  const l4d_placement& placement = setting.placement;
  if (placement.coordinate_system == L4D_COORDINATES_UNKNOWN) {
    notes.emplace("the axes of the scene are not known; they are taken for those of USD, with y up",
                  0);
  }
  const double metres = setting.metres_per_unit > 0 ? setting.metres_per_unit / placement.scale : 1;
  UsdText text(path, setting.check);
  text.add("#usda 1.0\n(\n    defaultPrim = \"Splats\"\n    metersPerUnit = ");
  text.add(text_of_number(metres));
  text.add("\n    upAxis = \"Y\"\n)\n\ndef ParticleField3DGaussianSplat \"Splats\"\n{\n");
  add_extent(splats, &text);
  add_gaussians(splats, placement.color_space == L4D_COLOR_LINEAR_SRGB, &text);
  text.add("    uniform token projectionModeHint = \"perspective\"\n");
  text.add("    uniform token sortingModeHint = \"zDepth\"\n");
  text.add(transform_of(placement));
  text.add("}\n");
  text.commit();
  return notes;
}

}  // namespace l4d::io
