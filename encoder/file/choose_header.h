// SPDX-License-Identifier: Apache-2.0
// The scene header, from what was coded.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "encoder/layer/coded_scene.h"
#include "encoder/plan/positions.h"
#include "encoder/prepare/scene.h"
#include "libl4dcodec/scene/color_errors.h"

namespace l4d {

// What the header follows from besides what was coded.
struct HeaderSource {
  const EncoderInput& input;
  const EncoderScene& scene;
  const std::vector<std::pair<std::string, std::string>>& metadata;
  const PositionPlan& positions;
  const ErrorBounds& bounds;
  ColorErrors colors;  // the largest of all Gaussians
  bool lossless = false;
  int threads = 0;
};

// The whole header but for what only the file's chunks tell (file_builder.h). Chooses how positions
// and opacities are coded, with which the errors are known that it states.
// worst: the largest errors of all Gaussians against what was to be coded. stated: against the
// scene, where its opacities were fitted.
SceneHeader choose_header(const HeaderSource& source, const CodedScene& coded,
                          GaussianErrors* worst, GaussianErrors* stated);

}  // namespace l4d
