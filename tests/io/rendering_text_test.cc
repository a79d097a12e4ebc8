// SPDX-License-Identifier: Apache-2.0
#include "io/scene/rendering_text.h"

#include <gtest/gtest.h>

#include "io/scene/scene.h"
#include "libl4dcodec/scene/rendering.h"

namespace l4d::io {
namespace {

TEST(RenderingText, ComesBack) {
  EXPECT_EQ(rendering_text(default_rendering()), "");
  EXPECT_EQ(presentation_text(default_presentation()), "");
  l4d_rendering r = default_rendering(), back = default_rendering();
  r.dilation = 0.1f;
  r.cutoff = 3;
  r.min_alpha = 1.0f / 254;
  r.max_alpha = 0.99f;
  r.compensation = 1;
  parse_rendering(rendering_text(r), &back);
  EXPECT_EQ(back.dilation, r.dilation);
  EXPECT_EQ(back.cutoff, r.cutoff);
  EXPECT_EQ(back.min_alpha, r.min_alpha);
  EXPECT_EQ(back.max_alpha, r.max_alpha);
  EXPECT_EQ(back.compensation, 1u);

  l4d_presentation p = default_presentation();
  parse_presentation(
      "playback=ping-pong,bounds=-1:-2:-3:1:2:3e5,camera=0:0:4:0:0:0:0:1:0:60,metres_per_unit=0.01",
      &p);
  EXPECT_EQ(p.playback, uint32_t{L4D_PLAYBACK_PING_PONG});
  EXPECT_EQ(p.bounds_max[2], 3e5);
  EXPECT_NEAR(p.camera_fov, 3.14159265358979 / 3, 1e-12);
  l4d_presentation same = default_presentation();
  parse_presentation(presentation_text(p), &same);
  EXPECT_EQ(presentation_text(same), presentation_text(p));
  EXPECT_EQ(same.camera_position[2], 4);
  EXPECT_EQ(same.metres_per_unit, 0.01);
}

TEST(RenderingText, KeepsWhatIsNotNamed) {
  l4d_rendering r = default_rendering();
  parse_rendering("dilation=1", &r);
  parse_rendering("cutoff=2", &r);
  EXPECT_EQ(r.dilation, 1);
  EXPECT_EQ(r.cutoff, 2);
}

TEST(RenderingText, RefusesWhatItCannotMean) {
  for (const char* bad :
       {"", "dilation", "dilation=", "dilation=x", "dilation=1x", "dilation=17", "dilation=-1",
        "cutoff=0.5", "min_alpha=0", "max_alpha=1", "size=1", "compensation=2", "dilation=nan",
        "dilation=1,", "dilation=1;cutoff=2", "dilation=1,dilation=2"}) {
    l4d_rendering r = default_rendering();
    EXPECT_THROW(parse_rendering(bad, &r), Error) << bad;
    EXPECT_TRUE(is_default(r)) << bad;
  }
  for (const char* bad :
       {"", "playback=twice", "playback=unstated", "bounds=1:1:1:0:0:0", "bounds=0:0:0:1:1",
        "camera=0:0:0:0:0:0:0:1:0:60", "camera=0:0:1:0:0:0:0:0:1:60",
        "camera=0:0:1:0:0:0:0:1:0:180", "metres_per_unit=-1", "metres_per_unit=inf",
        "playback=loop,playback=once"}) {
    l4d_presentation p = default_presentation();
    EXPECT_THROW(parse_presentation(bad, &p), Error) << bad;
    EXPECT_TRUE(is_default(p)) << bad;
  }
}

}  // namespace
}  // namespace l4d::io
