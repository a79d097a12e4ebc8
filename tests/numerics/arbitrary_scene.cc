// SPDX-License-Identifier: Apache-2.0
#include "tests/numerics/arbitrary_scene.h"

#include <algorithm>
#include <cmath>
#include <ostream>

#include "l4d/experimental/parameters.h"

namespace l4d::numerics {
namespace {

using test::Setting;

struct Clock {
  uint32_t frames, fps_num, fps_den;
};
// Simple ones first: that is where shrinking leads.
constexpr Clock kClocks[] = {{60, 30, 1},   {1, 30, 1},     {7, 24000, 1001},     {300, 60, 1},
                             {1000, 25, 1}, {36000, 60, 1}, {35964, 60000, 1001}, {5184000, 60, 1}};

int draw(int end) { return *rc::gen::inRange(0, end); }

}  // namespace

test::TestScene ArbitraryScene::make() const {
  test::TestScene s = test::make_scene(scene);
  s.flags = flags;
  if ((flags & L4D_OPACITY_LOGIT) != 0) {
    for (float& o : s.opacity) o = std::log(o / (1.001f - o));
  }
  return s;
}

ArbitraryScene draw_scene(bool lossy) {
  ArbitraryScene out;
  // The sizes of rapidcheck are too small for layers and pages.
  out.scene.count = static_cast<uint64_t>(1 + draw(600));
  out.scene.seed = static_cast<uint64_t>(draw(1000000));
  const Clock& clock = kClocks[draw(static_cast<int>(std::size(kClocks)))];
  out.scene.num_frames = clock.frames;
  out.scene.fps_num = clock.fps_num;
  out.scene.fps_den = clock.fps_den;
  out.scene.time_begin = draw(2) * 3600.25;
  out.scene.sh_degree = static_cast<uint32_t>(draw(4));
  out.scene.permanent = draw(3) * 0.4;
  out.scene.outside = draw(3) * 0.1;
  out.scene.moving = draw(4) != 1;
  out.scene.speed = 0.02 * draw(8);
  out.flags = static_cast<uint32_t>(draw(4));  // both flags
  if (!lossy) {
    out.encode.preset = "lossless";
  } else {
    const auto set = [&](const char* name, double value) {
      out.encode.settings.push_back({name, value});
    };
    // What follows no quality: errors are those of what is set below.
    set(L4D_ENC_CODEBOOKS_BY_COST, 0);
    set(L4D_ENC_MEAN_T_SHIFT, 0);
    set(L4D_ENC_PRUNE_COST, 0);
    set(L4D_ENC_CODEBOOK_SIZE, 1 << draw(9));
    set(L4D_ENC_KMEANS_ITERATIONS, draw(6));
    set(L4D_ENC_GAUGE, 3 - draw(4));
    set(L4D_ENC_CLOSED_LOOP, draw(2));
    set(L4D_ENC_OPACITY_BITS, 16 - draw(16));
    set(L4D_ENC_MAX_OPACITY_ERROR, 0);  // few bits keep no bound
    set(L4D_ENC_SCALE_FACTOR_BITS, 16 - draw(16));
    set(L4D_ENC_RCQ, draw(3));
    if (draw(2) == 1) out.encode.stages = {{L4D_ENC_STAGES, {1.0f, 0.5f, 0.25f}}};
  }
  out.encode.settings.push_back({L4D_ENC_MERGE_COUNT, 10.0 * draw(10)});
  out.encode.settings.push_back({L4D_ENC_MERGE_FRACTION, 0});
  out.encode.settings.push_back({L4D_ENC_PAGE_SIZE, static_cast<double>(64 << draw(4))});
  out.encode.settings.push_back({L4D_ENC_ZSTD_LEVEL, 1});
  out.encode.seed = static_cast<uint64_t>(draw(100));
  return out;
}

}  // namespace l4d::numerics
