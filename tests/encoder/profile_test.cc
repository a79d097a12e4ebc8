// SPDX-License-Identifier: Apache-2.0
// Profiles and levels that an encoder is asked to declare.
#include <gtest/gtest.h>

#include <string>

#include "tests/common/codec.h"

namespace l4d {
namespace {

using namespace test;

l4d_info info_of(const Bytes& bytes) {
  DecoderHandle d;
  d.open_memory(bytes.data(), bytes.size());
  return d.info();
}

EncodeOptions with(const char* preset, double profile, double level) {
  EncodeOptions options = small_options();
  options.preset = preset;
  if (std::string(preset) == "lossless") options.stages.clear();
  options.settings.push_back({L4D_ENC_PROFILE, profile});
  options.settings.push_back({L4D_ENC_LEVEL, level});
  return options;
}

TEST(Profile, DeclaredAsAskedFor) {
  const TestScene scene = make_scene({});
  struct Case {
    const char* preset;
    double profile, level;
    uint32_t want_profile, want_level;
  };
  for (const Case& c :
       {Case{"default", -1, -1, L4D_PROFILE_MAIN, 1}, Case{"default", 0, 0, 0, 0},
        Case{"default", 2, 4, L4D_PROFILE_MAIN, 4}, Case{"indexed", -1, 1, L4D_PROFILE_INDEXED, 1},
        Case{"indexed", 2, -1, L4D_PROFILE_MAIN, 1}, Case{"indexed", 1, 0, L4D_PROFILE_INDEXED, 0},
        Case{"lossless", -1, -1, L4D_PROFILE_LOSSLESS, 1},
        Case{"lossless", 3, 2, L4D_PROFILE_LOSSLESS, 2}}) {
    SCOPED_TRACE(std::string(c.preset) + " " + std::to_string(c.profile));
    const Bytes bytes = encode(scene, with(c.preset, c.profile, c.level)).bytes;
    EXPECT_EQ(info_of(bytes).profile, c.want_profile);
    EXPECT_EQ(info_of(bytes).level, c.want_level);
    EXPECT_TRUE(validate(bytes).empty());
  }
}

std::string refusal(const TestScene& scene, const EncodeOptions& options, l4d_status status) {
  try {
    encode(scene, options);
  } catch (const Error& e) {
    EXPECT_EQ(l4d_status_name(e.status()), std::string(l4d_status_name(status)));
    return e.what();
  }
  ADD_FAILURE() << "not refused";
  return "";
}

TEST(Profile, SettingsThatBreakItAreRefused) {
  const TestScene scene = make_scene({});
  const auto expect = [&](const EncodeOptions& options, const char* text) {
    EXPECT_NE(refusal(scene, options, L4D_ERR_INVALID_ARGUMENT).find(text), std::string::npos)
        << text;
  };
  expect(with("lossless", 1, -1), "indexed does not allow lossless = 1");
  expect(with("lossless", 2, -1), "main does not allow lossless = 1");
  expect(with("indexed", 3, -1), "lossless needs lossless = 1");
  expect(with("default", 1, -1), "does not allow coding = 1, transforms, of sh");
  EncodeOptions options = with("indexed", 1, -1);
  options.settings.push_back({L4D_ENC_CODING ".scale", 1});
  expect(options, "of scale");
  options = with("indexed", 1, -1);
  options.settings.push_back({L4D_ENC_FIXED_POSITIONS, 1});
  expect(options, "fixed-positions");
}

TEST(Profile, ALevelThatIsNotKeptIsRefused) {
  SceneOptions large;
  large.count = 110000;
  large.sh_degree = 0;
  large.permanent = 0;
  large.outside = 1;  // needed at all times
  const TestScene scene = make_scene(large);
  const std::string why = refusal(scene, with("lossless", 3, 1), L4D_ERR_LIMIT_EXCEEDED);
  EXPECT_NE(
      why.find("level 1 (phone): Gaussians needed at 0 s: 110000, which is 10000 more than the "
               "limit of 100000"),
      std::string::npos)
      << why;
  const Bytes bytes = encode(scene, with("lossless", -1, -1)).bytes;
  EXPECT_EQ(info_of(bytes).level, 2u);
}

}  // namespace
}  // namespace l4d
