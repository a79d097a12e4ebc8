// SPDX-License-Identifier: Apache-2.0
// Each adds its verb to the command line.
#pragma once

#include "cli/command/context.h"

namespace l4d::cli {

void add_version(Registry& registry);
void add_encode(Registry& registry);
void add_decode(Registry& registry);
void add_convert(Registry& registry);
void add_info(Registry& registry);
void add_slice(Registry& registry);
void add_validate(Registry& registry);
void add_compare(Registry& registry);
void add_render(Registry& registry);
void add_sensitivity(Registry& registry);
void add_synth(Registry& registry);
void add_cameras(Registry& registry);
void add_concat(Registry& registry);
void add_cut(Registry& registry);
void add_repair(Registry& registry);
void add_remux(Registry& registry);
void add_manifest(Registry& registry);
void add_sign(Registry& registry);
void add_keygen(Registry& registry);
// In a build without the HTTP library both say so.
void add_serve(Registry& registry);
void add_view(Registry& registry);

}  // namespace l4d::cli
