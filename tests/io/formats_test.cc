// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstring>

#include "io/ply/read_ply.h"
#include "io/ply/scene_ply.h"
#include "tests/common/files.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

using reference::Random;
using reference::Real;

class FormatsTest : public test::IoTest {};

std::vector<std::string> numbered(const std::string& name, size_t count) {
  std::vector<std::string> names;
  for (size_t k = 0; k < count; ++k) names.push_back(name + std::to_string(k));
  return names;
}

void extend(std::vector<std::string>& names, const std::vector<std::string>& more) {
  names.insert(names.end(), more.begin(), more.end());
}

std::vector<std::string> l4d_properties(uint32_t degree) {
  std::vector<std::string> names = {"x", "y", "z", "t"};
  extend(names, numbered("scale_", 4));
  extend(names, numbered("rotor_", 8));
  extend(names, {"opacity"});
  extend(names, numbered("f_dc_", 3));
  extend(names, numbered("f_rest_", 3 * ((degree + 1) * (degree + 1) - 1)));
  return names;
}

const std::vector<std::string> kL4dComments = {"l4d_ply 1", "time_unit seconds", "time_begin 0",
                                               "time_end 5", "fps 30"};

// Values that tell their property and row, with bit patterns that conversions would lose.
std::string l4d_file(uint32_t degree, size_t count,
                     const std::vector<std::string>& comments = kL4dComments) {
  const std::vector<std::string> names = l4d_properties(degree);
  std::string file = test::ply_header("binary_little_endian", comments, count, names);
  for (size_t i = 0; i < count; ++i) {
    for (size_t p = 0; p < names.size(); ++p) {
      if (i == 1 && p == 5) {
        test::append<uint32_t>(file, 0x7fc00123U);  // a NaN with a payload
      } else {
        test::append<float>(file, static_cast<float>(i) * 100 + static_cast<float>(p) + 0.1F);
      }
    }
  }
  return file;
}

// ---- l4d_ply ----

TEST_F(FormatsTest, L4dPlyRoundTripKeepsEveryByte) {
  for (uint32_t degree = 0; degree <= 3; ++degree) {
    const std::string bytes = l4d_file(degree, 5);
    const Scene scene = read_scene_ply(write("in.ply", bytes));
    EXPECT_EQ(scene.source, "l4d_ply");
    EXPECT_EQ(scene.sh_degree, degree);
    EXPECT_TRUE(scene.notes.empty());
    write_l4d_ply(path("out.ply"), scene);
    EXPECT_TRUE(test::read_bytes(path("out.ply")) == bytes);
  }
}

TEST_F(FormatsTest, L4dPlyChannelMajorBecomesCoefficientMajor) {
  const Scene scene = read_scene_ply(write("in.ply", l4d_file(1, 3)));
  // f_rest_{3 c + k - 1} is coefficient k of channel c; property 20 is f_rest_0.
  for (size_t k = 1; k < 4; ++k) {
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_EQ(scene.sh[2 * 12 + 3 * k + c], 200 + static_cast<float>(20 + 3 * c + k - 1) + 0.1F);
    }
  }
  EXPECT_EQ(scene.mean_t[2], 203.1F);
  EXPECT_EQ(scene.rotor[2 * 8 + 7], 200 + 15 + 0.1F);
  EXPECT_EQ(scene.flags, static_cast<uint32_t>(L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT));
}

// A stream has positions at reference times: those at mean times need not be float32 numbers.
TEST_F(FormatsTest, L4dPlyKeepsPositionsFarFromTheOrigin) {
  for (const double far : {0.0, 4e6}) {
    Scene scene = test::random_scene(5, 200, 0);
    positions_to_reference_time(scene);
    for (float& x : scene.position) x += static_cast<float>(far);
    const std::vector<double> exact = positions_at_mean_time(scene);
    write_l4d_ply(path("out.ply"), scene);
    const bool is_double =
        test::read_bytes(path("out.ply")).find("property double x") != std::string::npos;
    EXPECT_EQ(is_double, far != 0);
    const Scene back = read_scene_ply(path("out.ply"));
    for (size_t i = 0; i < exact.size(); ++i) {
      const double world = back.placement.origin[i % 3] + static_cast<double>(back.position[i]);
      ASSERT_NEAR(world, exact[i], 1e-7 * std::abs(exact[i] - far)) << far;
    }
  }
}

TEST_F(FormatsTest, BasketballIsRewrittenByteForByte) {
  const std::string file = l4d::test::data_file("basketball/basketball.ply");
  if (file.empty()) GTEST_SKIP() << "no data set";
  const Scene scene = read_scene_ply(file);
  EXPECT_EQ(scene.count(), 213874U);
  EXPECT_EQ(scene.sh_degree, 3U);
  EXPECT_EQ(scene.timeline.num_frames, 150U);
  EXPECT_EQ(scene.timeline.fps_num, 30U);
  EXPECT_EQ(scene.timeline.fps_den, 1U);
  write_l4d_ply(path("out.ply"), scene);
  EXPECT_TRUE(test::read_bytes(path("out.ply")) == test::read_bytes(file));
}

TEST_F(FormatsTest, L4dPlyTimelines) {
  const auto timeline = [&](const std::string& begin, const std::string& end,
                            const std::string& fps, const ImportOptions& options = {}) {
    const std::vector<std::string> comments = {"l4d_ply 1", "time_begin " + begin,
                                               "time_end " + end, "fps " + fps};
    return read_scene_ply(write("t.ply", l4d_file(0, 1, comments)), options).timeline;
  };
  l4d_timeline t = timeline("2.5", "12.5", "29.97");
  EXPECT_EQ(t.time_begin, 2.5);
  EXPECT_EQ(t.fps_num, 30000U);
  EXPECT_EQ(t.fps_den, 1001U);
  EXPECT_EQ(t.num_frames, 300U);
  t = timeline("0", "10", "12.5");
  EXPECT_EQ(t.fps_num, 25U);
  EXPECT_EQ(t.fps_den, 2U);
  EXPECT_EQ(t.num_frames, 125U);
  t = timeline("0", "600", "60");
  EXPECT_EQ(t.num_frames, 36000U);
  ImportOptions options;
  options.fps = 25;
  options.seconds = 2;
  t = timeline("0", "5", "30", options);
  EXPECT_EQ(t.num_frames, 150U) << "the file states its end and rate";
  EXPECT_EQ(t.fps_num, 30U);
  t = read_scene_ply(write("t.ply", l4d_file(0, 1, {"l4d_ply 1", "fps 30"})), options).timeline;
  EXPECT_EQ(t.num_frames, 60U);
  t = read_scene_ply(write("t.ply", l4d_file(0, 1, {"l4d_ply 1"})), options).timeline;
  EXPECT_EQ(t.num_frames, 50U);
}

TEST_F(FormatsTest, CommentsThatDisagreeAreRefused) {
  const std::vector<std::pair<std::string, std::string>> kTwice = {
      {"fps 30", "fps 60"},
      {"time_end 2", "time_end 9"},
      {"l4d_scale 1", "l4d_scale 9"},
      {"l4d_origin 1 2 3", "l4d_origin 4 5 6"},
      {"l4d_coordinates right_up_back", "l4d_coordinates right_down_forward"}};
  for (const auto& [a, b] : kTwice) {
    std::string message;
    const auto read = [&, a = a, b = b](const std::string& last) {
      return read_scene_ply(write("t.ply", l4d_file(0, 1, {"l4d_ply 1", a, last})));
    };
    EXPECT_EQ(test::status_of([&, b = b] { read(b); }, &message), L4D_ERR_CORRUPT) << a;
    EXPECT_NE(message.find("is there twice"), std::string::npos) << message;
    EXPECT_EQ(test::status_of([&, a = a] { read(a); }), L4D_OK) << a;
  }
  for (const char* other : {"fps: 60", "FPS 60", "fps=25", "frame_rate 25"}) {
    const Scene scene = read_scene_ply(write("t.ply", l4d_file(0, 1, {"l4d_ply 1", other})));
    ASSERT_EQ(scene.notes.size(), 1U) << other;
    EXPECT_NE(scene.notes[0].find("is not known and was not read"), std::string::npos) << other;
  }
}

TEST(FrameRate, DecimalsBecomeTheFractionMeant) {
  const struct {
    double fps;
    uint32_t num, den;
  } kCases[] = {{30, 30, 1},
                {24, 24, 1},
                {60, 60, 1},
                {25, 25, 1},
                {1000, 1000, 1},
                {23.976, 24000, 1001},
                {29.97, 30000, 1001},
                {59.94, 60000, 1001},
                {119.88, 120000, 1001},
                {12.5, 25, 2},
                {0.1, 1, 10},
                {1.0 / 3, 1, 3},
                {7.5, 15, 2},
                {30000.0 / 1001, 30000, 1001}};
  for (const auto& c : kCases) {
    l4d_timeline timeline{};
    set_fps(timeline, c.fps);
    EXPECT_EQ(timeline.fps_num, c.num) << c.fps;
    EXPECT_EQ(timeline.fps_den, c.den) << c.fps;
  }
  for (const double bad : {0.0, -1.0, 1e7, std::nan("")}) {
    l4d_timeline timeline{};
    EXPECT_EQ(test::status_of([&] { set_fps(timeline, bad); }), L4D_ERR_INVALID_ARGUMENT);
  }
}

TEST_F(FormatsTest, L4dPlyKeepsOddFrameRatesAndPlacement) {
  Scene scene = read_scene_ply(write("in.ply", l4d_file(0, 2)));
  for (const auto& rate : {std::pair<uint32_t, uint32_t>{30000, 1001},
                           {24, 1},
                           {1000003, 999979},
                           {4294967291U, 4294967279U},
                           {4294967295U, 1},
                           {1, 4294967295U}}) {
    scene.timeline.fps_num = rate.first;
    scene.timeline.fps_den = rate.second;
    scene.timeline.num_frames = 1234;
    scene.timeline.time_begin = 0.1;
    scene.placement = {{500000.125, -4649776.5, 0.1},
                       0.25,
                       L4D_COORDINATES_RIGHT_DOWN_FORWARD,
                       L4D_COLOR_LINEAR_SRGB};
    write_l4d_ply(path("out.ply"), scene);
    const Scene back = read_scene_ply(path("out.ply"));
    EXPECT_EQ(back.timeline.fps_num, rate.first);
    EXPECT_EQ(back.timeline.fps_den, rate.second);
    EXPECT_EQ(back.timeline.num_frames, 1234U);
    EXPECT_EQ(back.timeline.time_begin, 0.1);
    for (size_t k = 0; k < 3; ++k) {
      EXPECT_EQ(back.placement.origin[k], scene.placement.origin[k]);
    }
    EXPECT_EQ(back.placement.scale, 0.25);
    EXPECT_EQ(back.placement.coordinate_system, scene.placement.coordinate_system);
    EXPECT_EQ(back.placement.color_space, scene.placement.color_space);
    test::expect_same_arrays(back, scene);
  }
}

TEST_F(FormatsTest, MapCoordinatesInDoubleKeepTheirMillimetres) {
  const double easting = 500123.4567, northing = 4649776.2245, up = 0.125;
  std::string file = test::ply_header("binary_big_endian", kL4dComments, 2, l4d_properties(0));
  for (const char* axis : {"x", "y", "z"}) {
    file.replace(file.find(std::string("property float ") + axis), 14, "property double");
  }
  for (int i = 0; i < 2; ++i) {
    test::append<double>(file, easting + i, true);
    test::append<double>(file, northing - 3 * i, true);
    test::append<double>(file, up + 0.5 * i, true);
    for (size_t p = 3; p < l4d_properties(0).size(); ++p) test::append<float>(file, 0.5F, true);
  }
  const Scene scene = read_scene_ply(write("utm.ply", file));
  const double* origin = scene.placement.origin;
  EXPECT_EQ(origin[2], 0);  // nothing to gain there
  for (size_t i = 0; i < 2; ++i) {
    const double* o = origin;
    const double n = static_cast<double>(i);
    EXPECT_NEAR(o[0] + static_cast<double>(scene.position[3 * i]), easting + n, 1e-6);
    EXPECT_NEAR(o[1] + static_cast<double>(scene.position[3 * i + 1]), northing - 3 * n, 1e-6);
    EXPECT_EQ(o[2] + static_cast<double>(scene.position[3 * i + 2]), up + 0.5 * n);
  }
  write_l4d_ply(path("out.ply"), scene);
  const Scene back = read_scene_ply(path("out.ply"));
  EXPECT_EQ(back.placement.origin[1], origin[1]);
  test::expect_same_arrays(back, scene);
}

TEST_F(FormatsTest, TimesInDoubleAreKept) {
  for (const bool big_endian : {false, true}) {
    std::string file = test::ply_header(big_endian ? "binary_big_endian" : "binary_little_endian",
                                        kL4dComments, 3, l4d_properties(0));
    file.replace(file.find("property float t"), 14, "property double");
    const double times[] = {1763800000.0625, 1763800001.1, 0.1};
    for (const double t : times) {
      for (size_t p = 0; p < l4d_properties(0).size(); ++p) {
        if (p == 3) {
          test::append<double>(file, t, big_endian);
        } else {
          test::append<float>(file, 0.5F, big_endian);
        }
      }
    }
    const Scene scene = read_scene_ply(write("times.ply", file));
    EXPECT_TRUE(scene.notes.empty());
    ASSERT_EQ(scene.mean_t_double.size(), 3U);
    write_l4d_ply(path("out.ply"), scene);
    const Scene back = read_scene_ply(path("out.ply"));
    for (size_t i = 0; i < 3; ++i) {
      EXPECT_EQ(scene.mean_time(i), times[i]);
      EXPECT_EQ(scene.view().mean_t_double[i], times[i]);
      EXPECT_EQ(scene.mean_t[i], static_cast<float>(times[i]));
      EXPECT_EQ(back.mean_time(i), times[i]);
      EXPECT_EQ(back.opacity[i], 0.5F);
      EXPECT_EQ(back.log_scale[4 * i], 0.5F);
    }
  }
}

TEST_F(FormatsTest, NumbersThatFloatHasSpoiltAreNoted) {
  Scene scene = read_scene_ply(write("in.ply", l4d_file(0, 4)));
  ASSERT_TRUE(scene.notes.empty());
  for (size_t i = 0; i < 4; ++i) {
    scene.mean_t[i] = 80000.0F + static_cast<float>(i);
    std::fill_n(&scene.rotor[8 * i], 8, 0.0F);
    scene.rotor[8 * i] = 1;
    scene.log_scale[4 * i + 3] = i == 0 ? -4.0F : 2.0F;  // 18 ms, and 7 s
  }
  write_l4d_ply(path("day.ply"), scene);
  const Scene day = read_scene_ply(path("day.ply"));
  ASSERT_EQ(day.notes.size(), 1U);
  EXPECT_NE(day.notes[0].find("0.0078 seconds"), std::string::npos) << day.notes[0];
  EXPECT_NE(day.notes[0].find("1 short-lived"), std::string::npos) << day.notes[0];
  for (size_t i = 0; i < 4; ++i) {
    scene.mean_t[i] = 0;
    scene.position[3 * i + 1] = 5.0e6F + static_cast<float>(i);
  }
  write_l4d_ply(path("map.ply"), scene);
  const Scene map = read_scene_ply(path("map.ply"));
  ASSERT_EQ(map.notes.size(), 1U);
  EXPECT_NE(map.notes[0].find("steps of 0.5"), std::string::npos) << map.notes[0];
}

TEST_F(FormatsTest, LinearScenesAreConvertedForTheFile) {
  Scene scene = read_scene_ply(write("in.ply", l4d_file(0, 4)));
  for (size_t i = 0; i < 16; ++i) scene.log_scale[i] = i % 4 == 3 ? 1 : -1;
  for (float& o : scene.opacity) o = 0.5F;
  scene.mean_t = {-3, 1, 2, 9};
  scene.flags = 0;
  write_l4d_ply(path("out.ply"), scene);
  Scene back = read_scene_ply(path("out.ply"));
  for (const float o : back.opacity) EXPECT_EQ(o, 0);
  EXPECT_NE(back.position[0], scene.position[0]);
  EXPECT_EQ(back.position[3], scene.position[3]);
  positions_to_reference_time(back);
  for (size_t i = 0; i < 12; ++i) EXPECT_NEAR(back.position[i], scene.position[i], 1e-4);
}

TEST_F(FormatsTest, EveryTruncationOfASceneIsRefused) {
  const std::string bytes = l4d_file(0, 2);
  for (size_t size = 0; size < bytes.size(); ++size) {
    const auto read = [&] {
      PlyReader reader(test::in_memory(bytes.substr(0, size)), "vertex");
      read_scene(reader, {});
    };
    ASSERT_EQ(test::status_of(read), L4D_ERR_CORRUPT) << size;
  }
}

TEST_F(FormatsTest, BadScenesSayWhatIsWrong) {
  const auto expect = [&](const std::string& bytes, l4d_status status, const char* text) {
    std::string message;
    const std::string file = write("bad.ply", bytes);
    EXPECT_EQ(test::status_of([&] { read_scene_ply(file); }, &message), status) << text;
    EXPECT_NE(message.find(text), std::string::npos) << message;
    EXPECT_NE(message.find("bad.ply"), std::string::npos) << message;
  };
  const auto with = [](const char* from, const char* to) {
    std::string bytes = l4d_file(1, 2);
    bytes.replace(bytes.find(from), std::strlen(from), to);
    return bytes;
  };
  expect(with("l4d_ply 1", "l4d_ply 2"), L4D_ERR_FEATURE_UNSUPPORTED, "version");
  expect(with("l4d_ply 1", "l4d_plx 1"), L4D_ERR_CORRUPT, "comment l4d_ply");
  expect(with("seconds", "minutes"), L4D_ERR_FEATURE_UNSUPPORTED, "time_unit");
  expect(with("fps 30", "fps 0"), L4D_ERR_CORRUPT, "frame rate");
  expect(with("fps 30", "fps x"), L4D_ERR_CORRUPT, "fps");
  expect(with("fps 30", "fps 1e7"), L4D_ERR_CORRUPT, "frame rate");
  expect(with("fps 30", "fps 1/0"), L4D_ERR_CORRUPT, "fps");
  expect(with("fps 30", "fps 4294967296/1"), L4D_ERR_CORRUPT, "fps");
  expect(with("fps 30", "fps nan"), L4D_ERR_CORRUPT, "fps");
  expect(with("time_end 5", "time_end 0"), L4D_ERR_CORRUPT, "duration");
  expect(with("time_end 5", "time_end 1e300"), L4D_ERR_CORRUPT, "2^24");
  expect(with("rotor_3", "rotor_x"), L4D_ERR_CORRUPT, "rotor_3");
  expect(with("f_rest_0", "f_zest_0"), L4D_ERR_CORRUPT, "8 f_rest");
  expect(with("f_rest_0", "f_rest_x"), L4D_ERR_CORRUPT, "f_rest_0");
  expect(with("float x\n", "list uchar float x\n"), L4D_ERR_FEATURE_UNSUPPORTED, "list");
  expect(test::ply_header("ascii", {"l4d_ply 1"}, 1000000000, l4d_properties(3)), L4D_ERR_CORRUPT,
         "bytes are left");
  expect("ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nend_header\n",
         L4D_ERR_FEATURE_UNSUPPORTED, "none of the Gaussian formats");
  expect("ply\nformat ascii 1.0\nelement vertex 0\nproperty uint packed_position\nend_header\n",
         L4D_ERR_CORRUPT, "no element chunk");
  EXPECT_EQ(test::status_of([&] { read_scene_ply(path("absent.ply")); }), L4D_ERR_IO);
}

TEST_F(FormatsTest, SceneOfNoGaussians) {
  const Scene scene = read_scene_ply(write("none.ply", l4d_file(2, 0)));
  EXPECT_EQ(scene.count(), 0U);
  write_l4d_ply(path("out.ply"), scene);
  EXPECT_EQ(test::read_bytes(path("out.ply")), l4d_file(2, 0));
}

// ---- 3DGS ----

TEST_F(FormatsTest, StaticPlyIsPermanentAndStill) {
  // Properties in an unusual order, one unknown, as found in the wild.
  std::vector<std::string> names = {"opacity", "rot_3", "rot_2", "rot_1", "rot_0", "label"};
  extend(names, {"scale_2", "scale_1", "scale_0", "z", "y", "x"});
  extend(names, numbered("f_dc_", 3));
  const std::string file =
      test::ply_header("ascii", {}, 2, names) +
      "1.5 0 0 0 2 9 -3 -2 -1 30 20 10 .1 .2 .3\n-1 .5 -.5 .5 .5 9 -6 -5 -4 60 50 40 .4 .5 .6\n";
  ImportOptions options;
  options.seconds = 10;
  options.fps = 25;
  const Scene scene = read_scene_ply(write("s.ply", file), options);
  EXPECT_EQ(scene.source, "3dgs_ply");
  EXPECT_EQ(scene.sh_degree, 0U);
  EXPECT_EQ(scene.timeline.num_frames, 250U);
  EXPECT_EQ(scene.position, (std::vector<float>{10, 20, 30, 40, 50, 60}));
  EXPECT_EQ(scene.opacity, (std::vector<float>{1.5F, -1}));
  EXPECT_EQ(scene.flags & L4D_OPACITY_LOGIT, static_cast<uint32_t>(L4D_OPACITY_LOGIT));
  EXPECT_EQ(scene.rotor, (std::vector<float>{1, 0, 0, 0, 0, 0, 0, 0,  //
                                             0.5F, -0.5F, -0.5F, -0.5F, 0, 0, 0, 0}));
  ASSERT_EQ(scene.notes.size(), 2U);
  EXPECT_EQ(scene.notes[0], "1 of 15 properties were not read: label.");
  EXPECT_NE(scene.notes[1].find("0.05 %"), std::string::npos);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(scene.mean_t[i], 5);
    for (size_t k = 0; k < 3; ++k) {
      EXPECT_EQ(scene.log_scale[4 * i + k], -1.0F - static_cast<float>(3 * i + k));
    }
    const double sigma_t = std::exp(static_cast<double>(scene.log_scale[4 * i + 3]));
    EXPECT_NEAR(sigma_t, 160, 1e-4);
    EXPECT_LT(1 - std::exp(-0.5 * 25 / (sigma_t * sigma_t)), 5e-4);
  }
}

TEST_F(FormatsTest, StatuesAreReadAndComeBackThroughTheExport) {
  for (const auto& [name, count] : {std::pair<const char*, size_t>{"statues/angel.ply", 71359},
                                    {"statues/trumpet.ply", 89292}}) {
    const std::string file = l4d::test::data_file(name);
    if (file.empty()) GTEST_SKIP() << "no data set";
    const Scene scene = read_scene_ply(file);
    ASSERT_EQ(scene.count(), count);
    EXPECT_EQ(scene.sh_degree, 0U);
    EXPECT_FALSE(test::has_motion(scene));
    Splats splats;
    splats.position = scene.position;
    splats.sh = scene.sh;
    std::vector<Real> covariances;
    for (size_t i = 0; i < scene.count(); ++i) {
      splats.opacity.push_back(
          static_cast<float>(1 / (1 + std::exp(-static_cast<double>(scene.opacity[i])))));
      const test::ReferenceSlice s = test::reference_slice(scene, i);
      for (const Real c : s.covariance) {
        splats.covariance.push_back(static_cast<float>(c));
        covariances.push_back(c);
      }
    }
    write_3dgs_ply(path("out.ply"), splats);
    const Scene back = read_scene_ply(path("out.ply"));
    ASSERT_EQ(back.count(), count);
    EXPECT_TRUE(test::same_bits(back.position, scene.position));
    EXPECT_TRUE(test::same_bits(back.sh, scene.sh));
    for (size_t i = 0; i < count; ++i) {
      const test::ReferenceSlice s = test::reference_slice(back, i);
      ASSERT_LT(reference::relative_error6(s.covariance, &covariances[6 * i]), 1e-6) << i;
    }
  }
}

TEST_F(FormatsTest, SplatExportKeepsCovariances) {
  Random random(11);
  Splats splats;
  splats.sh_degree = 2;
  const size_t count = 400;
  std::vector<Real> expected(6 * count);
  for (size_t i = 0; i < count; ++i) {
    float q[4], s[3];
    for (float& c : q) c = static_cast<float>(random.normal());
    for (float& c : s) c = static_cast<float>(random.uniform(-6, 0));
    test::reference_covariance3(q, s, &expected[6 * i]);
    for (size_t k = 0; k < 6; ++k) {
      splats.covariance.push_back(static_cast<float>(expected[6 * i + k]));
    }
    for (int k = 0; k < 3; ++k) splats.position.push_back(static_cast<float>(random.normal()));
    for (int k = 0; k < 27; ++k) splats.sh.push_back(static_cast<float>(random.normal()));
    splats.opacity.push_back(i == 0 ? 0.0F : i == 1 ? 1.0F : static_cast<float>(random.uniform()));
  }
  write_3dgs_ply(path("out.ply"), splats);
  const Scene back = read_scene_ply(path("out.ply"));
  EXPECT_EQ(back.sh_degree, 2U);
  EXPECT_TRUE(test::same_bits(back.sh, splats.sh));
  EXPECT_TRUE(test::same_bits(back.position, splats.position));
  for (size_t i = 0; i < count; ++i) {
    const test::ReferenceSlice s = test::reference_slice(back, i);
    ASSERT_LT(reference::relative_error6(s.covariance, &expected[6 * i]), 1e-6);
    ASSERT_TRUE(std::isfinite(back.opacity[i]));
    const double o = 1 / (1 + std::exp(-static_cast<double>(back.opacity[i])));
    ASSERT_NEAR(o, splats.opacity[i], 1e-6);
  }
}

TEST_F(FormatsTest, SplatExportFloorsDegenerateCovariances) {
  Splats splats;
  splats.covariance = {1,     0, 0, 0,     0, 0,       // a line
                       0,     0, 0, 0,     0, 0,       // a point
                       1,     1, 0, 1,     0, -1e-9F,  // rounding below zero
                       1e-4F, 0, 0, 1e-4F, 0, 1e-4F};
  splats.opacity = {0.5F, 0.5F, 0.5F, 0.5F};
  splats.position.assign(12, 0);
  splats.sh.assign(12, 0);
  write_3dgs_ply(path("out.ply"), splats);
  const Scene back = read_scene_ply(path("out.ply"));
  for (const float s : back.log_scale) EXPECT_TRUE(std::isfinite(s) && s > -24) << s;
  for (const float r : back.rotor) EXPECT_TRUE(std::isfinite(r));
  for (size_t k = 0; k < 3; ++k) EXPECT_NEAR(back.log_scale[12 + k], std::log(0.01), 1e-5);

  splats.covariance[4] = std::nanf("");
  write("old.ply", "old");
  EXPECT_EQ(test::status_of([&] { write_3dgs_ply(path("old.ply"), splats); }),
            L4D_ERR_INVALID_SCENE);
  EXPECT_EQ(test::read_bytes(path("old.ply")), "old");
}

// ---- FreeTimeGS ----

std::vector<std::string> ftgs_properties(uint32_t degree) {
  std::vector<std::string> names = {"x", "y", "z", "nx", "ny", "nz"};
  extend(names, numbered("f_dc_", 3));
  extend(names, numbered("f_rest_", 3 * ((degree + 1) * (degree + 1) - 1)));
  extend(names, {"opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"});
  extend(names, {"time", "log_duration", "velocity_0", "velocity_1", "velocity_2"});
  return names;
}

struct FtgsRow {
  float position[3], sh[12], opacity, scale[3], wxyz[4], time, log_duration, velocity[3];
};

std::string ftgs_file(const std::vector<FtgsRow>& rows, const std::vector<std::string>& comments) {
  std::string file =
      test::ply_header("binary_little_endian", comments, rows.size(), ftgs_properties(1));
  for (const FtgsRow& row : rows) {
    for (const float v : row.position) test::append(file, v);
    for (int k = 0; k < 3; ++k) test::append(file, 0.0F);
    for (const float v : row.sh) test::append(file, v);
    test::append(file, row.opacity);
    for (const float v : row.scale) test::append(file, v);
    for (const float v : row.wxyz) test::append(file, v);
    test::append(file, row.time);
    test::append(file, row.log_duration);
    for (const float v : row.velocity) test::append(file, v);
  }
  return file;
}

std::vector<FtgsRow> random_ftgs(size_t count) {
  Random random(21);
  std::vector<FtgsRow> rows(count);
  for (size_t i = 0; i < count; ++i) {
    FtgsRow& row = rows[i];
    for (float& v : row.position) v = static_cast<float>(random.normal());
    for (float& v : row.sh) v = static_cast<float>(random.normal());
    row.opacity = static_cast<float>(random.normal());
    for (float& v : row.scale) v = static_cast<float>(random.uniform(-8, -1));
    for (float& v : row.wxyz) v = static_cast<float>(random.normal());
    row.time = static_cast<float>(random.uniform(-0.2, 1.2));
    row.log_duration = static_cast<float>(random.uniform(-4, 2));
    for (float& v : row.velocity) {
      v = i % 4 == 0 ? 0 : static_cast<float>(random.normal() * random.log_uniform(1e-4, 3));
    }
  }
  return rows;
}

const std::vector<std::string> kFtgsComments = {
    "ftgs_version 1",    "time_units normalized", "sh_degree 1", "use_velocity 1",
    "min_duration 0.02", "opacity_floor 0.0001",  "n_frames 61"};

TEST_F(FormatsTest, FtgsImportIsExact) {
  const std::vector<FtgsRow> rows = random_ftgs(600);
  ImportOptions options;
  options.fps = 20;
  const Scene scene = read_scene_ply(write("a.ftgs.ply", ftgs_file(rows, kFtgsComments)), options);
  EXPECT_EQ(scene.source, "ftgs_ply");
  EXPECT_EQ(scene.timeline.num_frames, 61U);
  const double unit = 3;  // 60 frames between the first and the last
  for (size_t i = 0; i < rows.size(); ++i) {
    const FtgsRow& row = rows[i];
    const test::ReferenceSlice s = test::reference_slice(scene, i);
    const double sigma_t = std::max(std::exp(static_cast<double>(row.log_duration)), 0.02) * unit;
    Real covariance[6];
    test::reference_covariance3(row.wxyz, row.scale, covariance);
    ASSERT_NEAR(static_cast<double>(s.sigma_t) / sigma_t, 1, 2e-6);
    ASSERT_LT(reference::relative_error6(s.covariance, covariance), 1e-5) << i;
    for (size_t k = 0; k < 3; ++k) {
      const double v = static_cast<double>(row.velocity[k]) / unit;
      ASSERT_NEAR(static_cast<double>(s.velocity[k]), v, 1e-6 * (1 + std::abs(v)));
    }
    ASSERT_EQ(scene.mean_t[i], static_cast<float>(static_cast<double>(row.time) * unit));
    ASSERT_EQ(scene.opacity[i], row.opacity);
    ASSERT_EQ(scene.position[3 * i + 1], row.position[1]);
    ASSERT_EQ(scene.sh[12 * i + 3 * 2 + 1], row.sh[3 + 3 + 1]);  // coefficient 2, green
    if (i % 4 == 0) {  // at rest: no rounding of the shape at all
      for (size_t k = 0; k < 4; ++k) ASSERT_EQ(scene.rotor[8 * i + 4 + k], 0);
      for (size_t k = 0; k < 3; ++k) ASSERT_EQ(scene.log_scale[4 * i + k], row.scale[k]);
    }
  }
}

TEST_F(FormatsTest, FtgsRoundTripThroughRotors) {
  const std::vector<FtgsRow> rows = random_ftgs(400);
  ImportOptions options;
  options.fps = 20;
  const Scene scene = read_scene_ply(write("a.ftgs.ply", ftgs_file(rows, kFtgsComments)), options);
  write_ftgs_ply(path("b.ftgs.ply"), scene);
  const Scene back = read_scene_ply(path("b.ftgs.ply"), options);
  EXPECT_EQ(back.timeline.num_frames, scene.timeline.num_frames);
  EXPECT_TRUE(test::same_bits(back.position, scene.position));
  EXPECT_TRUE(test::same_bits(back.sh, scene.sh));
  EXPECT_TRUE(test::same_bits(back.opacity, scene.opacity));
  for (size_t i = 0; i < rows.size(); ++i) {
    const test::ReferenceSlice a = test::reference_slice(scene, i);
    const test::ReferenceSlice b = test::reference_slice(back, i);
    ASSERT_NEAR(back.mean_t[i], scene.mean_t[i], 1e-6);
    ASSERT_NEAR(static_cast<double>(b.sigma_t / a.sigma_t), 1, 2e-6);
    ASSERT_LT(reference::relative_error6(b.covariance, a.covariance), 1e-5);
    for (size_t k = 0; k < 3; ++k) {
      ASSERT_NEAR(static_cast<double>(b.velocity[k]), static_cast<double>(a.velocity[k]),
                  1e-6 * (1 + std::abs(static_cast<double>(a.velocity[k]))));
    }
  }
}

TEST_F(FormatsTest, FtgsOfBasketballMovesAlike) {
  const std::string file = l4d::test::data_file("basketball/basketball.ply");
  if (file.empty()) GTEST_SKIP() << "no data set";
  const Scene scene = read_scene_ply(file);
  write_ftgs_ply(path("b.ftgs.ply"), scene);
  const Scene back = read_scene_ply(path("b.ftgs.ply"));
  ASSERT_EQ(back.count(), scene.count());
  std::vector<double> position, covariance;
  for (size_t i = 0; i < scene.count(); i += 7) {
    const test::ReferenceSlice a = test::reference_slice(scene, i);
    const test::ReferenceSlice b = test::reference_slice(back, i);
    covariance.push_back(reference::relative_error6(b.covariance, a.covariance));
    double distance2 = 0;  // at the middle of the sequence
    for (size_t k = 0; k < 3; ++k) {
      const double at_a =
          static_cast<double>(scene.position[3 * i + k]) +
          static_cast<double>(a.velocity[k]) * (2.5 - static_cast<double>(scene.mean_t[i]));
      const double at_b =
          static_cast<double>(back.position[3 * i + k]) +
          static_cast<double>(b.velocity[k]) * (2.5 - static_cast<double>(back.mean_t[i]));
      distance2 += (at_a - at_b) * (at_a - at_b);
    }
    position.push_back(std::sqrt(distance2));
  }
  EXPECT_LT(reference::quantile(position, 0.99), 1e-5);
  EXPECT_LT(reference::quantile(position, 1), 1e-3);
  EXPECT_LT(reference::quantile(covariance, 0.99), 1e-4);
}

TEST_F(FormatsTest, FtgsWithoutVelocityOrFrames) {
  std::vector<FtgsRow> rows = random_ftgs(8);
  std::vector<std::string> comments = kFtgsComments;
  comments[3] = "use_velocity 0";
  comments.pop_back();
  ImportOptions options;
  options.seconds = 4;
  options.fps = 10;
  const Scene scene = read_scene_ply(write("a.ply", ftgs_file(rows, comments)), options);
  EXPECT_FALSE(test::has_motion(scene));
  EXPECT_EQ(scene.timeline.num_frames, 40U);
  EXPECT_NEAR(scene.mean_t[0], rows[0].time * 3.9F, 1e-6);
  comments[0] = "ftgs_version 2";
  const std::string newer = write("c.ply", ftgs_file(rows, comments));
  EXPECT_EQ(test::status_of([&] { read_scene_ply(newer); }), L4D_ERR_FEATURE_UNSUPPORTED);
}

TEST_F(FormatsTest, FtgsDurationsInPlaceOfLogarithmsAreNoted) {
  std::vector<FtgsRow> rows = random_ftgs(3);
  const auto is_noted = [&] {
    const Scene scene = read_scene_ply(write("a.ply", ftgs_file(rows, kFtgsComments)));
    return std::any_of(scene.notes.begin(), scene.notes.end(), [](const std::string& note) {
      return note.find("log_duration is positive") == 0;
    });
  };
  EXPECT_FALSE(is_noted());
  for (FtgsRow& row : rows) row.log_duration = 0.1F;
  EXPECT_TRUE(is_noted());
}

TEST_F(FormatsTest, FtgsGaussiansThatAreNoNumbersAreMarked) {
  std::vector<FtgsRow> rows = random_ftgs(3);
  rows[1].velocity[2] = std::nanf("");
  rows[2].scale[0] = 1e30F;
  const Scene scene = read_scene_ply(write("a.ply", ftgs_file(rows, kFtgsComments)));
  EXPECT_TRUE(std::isnan(scene.log_scale[4]));
  EXPECT_TRUE(std::isnan(scene.log_scale[8]));
  for (const float r : scene.rotor) EXPECT_TRUE(std::isfinite(r));
}

}  // namespace
}  // namespace l4d::io
