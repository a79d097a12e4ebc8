// SPDX-License-Identifier: Apache-2.0
// Files whose Gaussians change over time in a way that no reader takes: to read them as a static
// scene would lose that without a word.
#include <algorithm>
#include <filesystem>
#include <iterator>
#include <system_error>

#include "io/ply/read_ply.h"

namespace l4d::io {
namespace {

struct Layout {
  const char* column;  // that no other layout has
  const char* name;
};
constexpr Layout kLayouts[] = {
    {"scale_t_0",
     "a model of a variant of Real-time-4DGS, whose activations the file does not state"},
    {"rot_r_0",
     "a Real-time-4DGS model, but not all of its columns t, scale_t, rot_0 .. rot_3 and "
     "rot_r_0 .. rot_r_3 are there"},
    {"xyz_disp_0", "the static part of an Ex4DGS model"},
    {"motion_xyz_0_0", "the dynamic part of an Ex4DGS model"},
    {"velocity_0", "a FreeTimeGS model, but its column log_duration is missing"},
    {"log_duration", "a FreeTimeGS model, but its columns velocity_0 .. velocity_2 are missing"},
    {"trbf_scale", "a SpacetimeGaussians model, but its column trbf_center is missing"},
    {"quats1_0", "a 4D-Rotor Gaussians model"},
    {"scales_t", "a 4D-Rotor Gaussians model"}};

constexpr const char* kNextStep =
    "write its Gaussians as an l4d_ply, whose columns docs/formats.md lists, or each frame as a "
    "3DGS PLY";

bool begins(const std::string& text, const char* with) { return text.rfind(with, 0) == 0; }

// Whether a column of this name is about time in all likelihood.
bool speaks_of_time(std::string name) {
  static constexpr const char* kWhole[] = {"t",     "time",  "mu_t", "duration", "lifetime",
                                           "birth", "death", "vx",   "vy",       "vz"};
  static constexpr const char* kBegin[] = {
      "t_",         "time_",     "timestamp",   "temporal", "velocity",     "linear_velocity",
      "motion",     "omega",     "trbf",        "scale_t",  "scaling_t",    "angular_velocity",
      "rot_r_",     "duration_", "cov_t",       "keyframe", "log_duration", "frame_index",
      "marginal_t", "opacity_t", "visible_from"};
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) {
    return static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  });
  return std::any_of(std::begin(kWhole), std::end(kWhole),
                     [&](const char* whole) { return name == whole; }) ||
         std::any_of(std::begin(kBegin), std::end(kBegin),
                     [&](const char* begin) { return begins(name, begin); });
}

}  // namespace

void refuse_unread_time(const PlyReader& reader) {
  for (const Layout& layout : kLayouts) {
    if (!reader.element().has(layout.column)) continue;
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, std::string(layout.name) + "; " + kNextStep);
  }
  std::vector<std::string> names;
  for (const PlyProperty& property : reader.element().properties) {
    if (speaks_of_time(property.name)) names.push_back(property.name);
    // A fourth scale, or a second quaternion.
    if (property.name == "scale_3" || property.name == "rot_4") names.push_back(property.name);
  }
  if (names.empty()) return;
  reader.fail(L4D_ERR_FEATURE_UNSUPPORTED,
              "a model of an unknown kind, whose Gaussians change over time by its columns " +
                  list_of_names(names) + "; " + kNextStep +
                  ", or leave these columns out for a static scene");
}

void refuse_unread_time(const PlyReader& reader, const std::vector<std::string>& left_over) {
  std::vector<std::string> names;
  std::copy_if(left_over.begin(), left_over.end(), std::back_inserter(names), speaks_of_time);
  if (names.empty()) return;
  reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "Gaussians also change over time by the columns " +
                                               list_of_names(names) +
                                               ", which this layout does not have; " + kNextStep +
                                               ", or leave these columns out");
}

void refuse_deformed(const PlyReader& reader) {
  const std::filesystem::path path(reader.path());
  const std::filesystem::path folder = path.has_parent_path() ? path.parent_path() : ".";
  // Where the two trainers write a network, and where the PLY.
  struct Network {
    std::filesystem::path file;
    const char* name;
  };
  const Network networks[] = {{folder / "deformation.pth", "4DGaussians"},
                              {folder / "../../deform", "Deformable 3D Gaussians"}};
  if (path.filename() != "point_cloud.ply") return;
  for (const Network& network : networks) {
    std::error_code error;
    if (!std::filesystem::exists(network.file, error)) continue;
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED,
                std::string("the Gaussians of a ") + network.name +
                    " model, which the network in " + network.file.lexically_normal().string() +
                    " moves; write each frame as a 3DGS PLY, or rename this file to read it as a "
                    "static scene");
  }
}

}  // namespace l4d::io
