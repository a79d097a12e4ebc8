// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

#include "io/scene/scene.h"

namespace l4d::io {

// Makes the first of the cameras that a .splatv file lists the first view of the scene, if it sees
// the middle of the Gaussians: programs that write such files put cameras of their own there where
// they know none of the scene. A note says which cameras were not read; nothing fails.
void state_splatv_view(const nlohmann::json& cameras, Scene* scene);

}  // namespace l4d::io
