// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "render/importance/sensitivity.h"

namespace l4d::render {

// l4d_measure_importance, with arguments checked for NULL.
Status measure(Renderer& renderer, const l4d_camera* cameras, uint32_t num_cameras,
               const l4d_view* views, size_t num_views, const l4d_measure_options& options,
               l4d_measure_report* report, std::unique_ptr<Sensitivity>* out);

}  // namespace l4d::render
