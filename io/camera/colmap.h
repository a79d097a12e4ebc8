// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "io/camera/cameras.h"

namespace l4d::io {

struct ColmapPoint {
  float position[3];
  float rgb[3];  // [0, 1]
};

// The folder that has a model of COLMAP: `folder`, `folder`/sparse/0 or `folder`/0, the first that
// has cameras and images as .bin or .txt; "" = none.
std::string find_colmap_model(const std::string& folder);

// The cameras of a model's folder, one for each image, by the names of the images. Their files are
// not set. names: the name of each camera's image. Throws Error: CORRUPT, and FEATURE_UNSUPPORTED
// for lenses of models other than those of pinholes, radial, OPENCV and OPENCV_FISHEYE.
CameraSet read_colmap_cameras(const std::string& model, std::vector<std::string>* names,
                              const Hold& holder);

// Its points; none if it has no file of them.
std::vector<ColmapPoint> read_colmap_points(const std::string& model, const Hold& holder);

}  // namespace l4d::io
