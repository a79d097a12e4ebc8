// SPDX-License-Identifier: Apache-2.0
// What members of a file have in common (spec: MEMB-11), so that they are one scene.
#pragma once

#include <algorithm>

#include "l4d/l4d.h"
#include "libl4dcodec/scene/rendering.h"

namespace l4d {

// How numbers of a scene become places, colours and pictures.
struct SceneFrame {
  l4d_placement placement{};
  l4d_rendering rendering = default_rendering();
};

// What differs, null where nothing does.
inline const char* difference(const SceneFrame& a, const SceneFrame& b) {
  const l4d_placement &p = a.placement, &q = b.placement;
  if (!std::equal(p.origin, p.origin + 3, q.origin)) return "origin";
  if (p.scale != q.scale) return "scale";
  if (p.coordinate_system != q.coordinate_system) return "coordinate system";
  if (p.color_space != q.color_space) return "colour space";
  const l4d_rendering &r = a.rendering, &s = b.rendering;
  const bool same = r.dilation == s.dilation && r.cutoff == s.cutoff &&
                    r.min_alpha == s.min_alpha && r.max_alpha == s.max_alpha &&
                    r.compensation == s.compensation;
  return same ? nullptr : "rendering";
}

}  // namespace l4d
