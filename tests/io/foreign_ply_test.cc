// SPDX-License-Identifier: Apache-2.0
// PLY of other trainers: what they have that no reader takes is named, and never lost in silence.
#include <algorithm>
#include <cmath>

#include "io/ply/scene_ply.h"
#include "tests/io/support.h"

namespace l4d::io {
namespace {

using reference::Random;
using reference::Real;

class ForeignPlyTest : public test::IoTest {
 protected:
  // A file of one Gaussian of 3DGS, with zeros in further properties.
  std::string with(const std::vector<std::string>& more, const std::string& tail = "") const {
    std::vector<std::string> names = {"x",       "y",       "z",       "f_dc_0", "f_dc_1",
                                      "f_dc_2",  "rot_0",   "rot_1",   "rot_2",  "rot_3",
                                      "scale_0", "scale_1", "scale_2", "opacity"};
    names.insert(names.end(), more.begin(), more.end());
    std::string header = test::ply_header("ascii", {}, 1, names);
    const std::string end = "end_header\n";
    if (!tail.empty()) header.insert(header.find(end), tail);
    std::string text = header + "0 0 0 0 0 0 1 0 0 0 -3 -3 -3 0";
    for (size_t k = 0; k < more.size(); ++k) text += " 0";
    return text + "\n";
  }
};

TEST_F(ForeignPlyTest, UnreadPropertiesAndElementsAreNamed) {
  const Scene scene = read_scene_ply(
      write("a.ply", with({"nx", "ny", "nz", "segment_0", "segment_1", "segment_2", "segment_3"},
                          "element camera 7\nproperty float px\n") +
                         "0\n0\n0\n0\n0\n0\n0\n"));
  ASSERT_GE(scene.notes.size(), 3U);
  EXPECT_EQ(scene.notes[1], "4 of 21 properties were not read: segment_0 .. segment_3.");
  EXPECT_EQ(scene.notes[2], "Elements that were not read: camera (7 rows).");
}

TEST_F(ForeignPlyTest, RotationsThatAreNoneAreNotTakenForSome) {
  std::string text = with({});
  const size_t rotation = text.find(" 1 0 0 0 -3");
  text.replace(rotation, 8, " nan 0 0 0");
  EXPECT_TRUE(std::isnan(read_scene_ply(write("nan.ply", text)).rotor[0]));
  text.replace(rotation, 10, " 0 0 0 0");
  const Scene scene = read_scene_ply(write("none.ply", text));
  EXPECT_EQ(scene.rotor[0], 1);
  EXPECT_EQ(std::count(scene.notes.begin(), scene.notes.end(),
                       "Rotations of length 0, which are taken as none: 1."),
            1);
}

TEST_F(ForeignPlyTest, ListsOfNamesAreBounded) {
  std::vector<std::string> names;
  for (int k = 0; k < 1000; ++k) names.push_back("c" + std::to_string(2 * k));
  const std::string text = list_of_names(names);
  EXPECT_LT(text.size(), 200U);
  EXPECT_NE(text.find("and 980 more"), std::string::npos) << text;
  EXPECT_EQ(list_of_names({"a", "b_9", "b_10", "b_11", "b_99999999999"}),
            "a, b_9 .. b_11, b_99999999999");
}

TEST_F(ForeignPlyTest, ModelsThatChangeOverTimeAreNeverTakenForStatic) {
  const auto refused = [&](const std::vector<std::string>& more, const char* words) {
    std::string message;
    const std::string file = write("t.ply", with(more));
    EXPECT_EQ(test::status_of([&] { read_scene_ply(file); }, &message), L4D_ERR_FEATURE_UNSUPPORTED)
        << words;
    EXPECT_NE(message.find(words), std::string::npos) << message;
    EXPECT_NE(message.find("docs/formats.md"), std::string::npos) << message;
  };
  refused({"t", "scale_t_0", "rot_r_0", "rot_r_1", "rot_r_2", "rot_r_3"},
          "variant of Real-time-4DGS");
  refused({"t", "rot_r_0", "rot_r_1", "rot_r_2", "rot_r_3"}, "a Real-time-4DGS model, but not all");
  refused({"xyz_disp_0", "xyz_disp_1", "xyz_disp_2"}, "Ex4DGS");
  refused({"motion_xyz_0_0"}, "Ex4DGS");
  refused({"velocity_0", "velocity_1", "velocity_2", "time"}, "FreeTimeGS");
  refused({"time", "log_duration"}, "FreeTimeGS");
  refused({"trbf_scale"}, "SpacetimeGaussians");
  refused({"t", "scales_t", "quats1_0"}, "4D-Rotor");
  refused({"t"}, "columns t;");
  refused({"mu_t", "motion_0", "motion_1", "motion_2"}, "columns mu_t, motion_0 .. motion_2;");
  refused({"scale_t", "motion_0", "motion_1", "motion_2"}, "columns scale_t, motion_0");
  refused({"trbf_center"}, "columns trbf_center;");
  // Names that only begin alike.
  EXPECT_EQ(read_scene_ply(write("s.ply", with({"texture", "tag", "timber"}))).count(), 1U);
}

TEST_F(ForeignPlyTest, GaussiansThatANetworkMovesAreRefused) {
  namespace fs = std::filesystem;
  std::string message;
  fs::create_directories(path("a/point_cloud/iteration_3"));
  const std::string file = write("a/point_cloud/iteration_3/point_cloud.ply", with({}));
  EXPECT_EQ(read_scene_ply(file).count(), 1U);
  write("a/point_cloud/iteration_3/deformation.pth", "x");
  EXPECT_EQ(test::status_of([&] { read_scene_ply(file); }, &message), L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_NE(message.find("4DGaussians"), std::string::npos) << message;
  EXPECT_EQ(read_scene_ply(write("a/point_cloud/iteration_3/other.ply", with({}))).count(), 1U);
  fs::create_directories(path("b/point_cloud/iteration_3"));
  fs::create_directories(path("b/deform"));
  const std::string deformable = write("b/point_cloud/iteration_3/point_cloud.ply", with({}));
  EXPECT_EQ(test::status_of([&] { read_scene_ply(deformable); }, &message),
            L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_NE(message.find("Deformable"), std::string::npos) << message;
}

bool has_note(const Scene& scene, const std::string& part) {
  return std::any_of(scene.notes.begin(), scene.notes.end(),
                     [&](const std::string& note) { return note.find(part) != std::string::npos; });
}

// A file of columns of float, or of another type, in rows.
std::string table(const std::vector<std::string>& names,
                  const std::vector<std::vector<double>>& rows, const char* type = "float") {
  std::string text = "ply\nformat ascii 1.0\nelement vertex " + std::to_string(rows.size()) + "\n";
  for (const std::string& name : names) {
    text += std::string("property ") + (name.find(' ') == std::string::npos ? type : "") + " " +
            name + "\n";
  }
  text += "end_header\n";
  for (const std::vector<double>& row : rows) {
    for (const double x : row) text += std::to_string(x) + " ";
    text += "\n";
  }
  return text;
}

const std::vector<std::string> kStatic = {"x",       "y",       "z",       "f_dc_0", "f_dc_1",
                                          "f_dc_2",  "rot_0",   "rot_1",   "rot_2",  "rot_3",
                                          "scale_0", "scale_1", "scale_2", "opacity"};
const std::vector<double> kRow = {1, 2, 3, 0.5, 0, -0.5, 1, 0, 0, 0, -3, -4, -5, 0.25};

TEST_F(ForeignPlyTest, RowsOfZerosAreLeftOutWithTheirNumber) {
  const std::vector<double> zeros(kRow.size(), 0);
  std::vector<double> second = kRow;
  second[0] = 7;
  const Scene scene =
      read_scene_ply(write("z.ply", table(kStatic, {zeros, kRow, zeros, second, zeros})));
  ASSERT_EQ(scene.count(), 2U);
  EXPECT_EQ(scene.position, (std::vector<float>{1, 2, 3, 7, 2, 3}));
  EXPECT_TRUE(has_note(scene, "3 of 5 rows are nothing but zeros and were left out."));
  EXPECT_EQ(read_scene_ply(write("n.ply", table(kStatic, {zeros}))).count(), 0U);
}

TEST_F(ForeignPlyTest, InfiniteLogitsAreOpacitiesOfOneAndZero) {
  std::string text = table(kStatic, {kRow, kRow, kRow});
  for (const char* value : {"inf", "-inf"})
    text.replace(text.find(" 0.250000"), 9, std::string(" ") + value);
  const Scene scene = read_scene_ply(write("i.ply", text));
  EXPECT_EQ(scene.opacity, (std::vector<float>{18, -104, 0.25F}));
  EXPECT_TRUE(has_note(scene, "Infinite logits, which are taken as opacity 1 or 0: 2."));
}

TEST_F(ForeignPlyTest, ValuesThatLookActivatedAreSaidToAndReadSo) {
  std::vector<double> row = kRow;
  row[10] = 0.1, row[11] = 0.01, row[12] = 0.5, row[13] = 0.75;
  const std::string file = write("a.ply", table(kStatic, {row, row}));
  EXPECT_TRUE(has_note(read_scene_ply(file), "--activated reads them so"));
  ImportOptions options;
  options.activated = true;
  const Scene scene = read_scene_ply(file, options);
  EXPECT_FALSE(has_note(scene, "--activated"));
  EXPECT_NEAR(scene.log_scale[4], std::log(0.1), 1e-6);
  EXPECT_NEAR(scene.opacity[1], std::log(3), 1e-6);
  EXPECT_FALSE(has_note(read_scene_ply(write("b.ply", table(kStatic, {kRow}))), "--activated"));
  EXPECT_EQ(test::status_of([&] { read_scene_ply(path("b.ply"), options); }),
            L4D_ERR_INVALID_SCENE);
}

// One broken row hides nothing, and each of the two columns is judged.
TEST_F(ForeignPlyTest, MostValuesDecideWhetherTheyLookActivated) {
  std::vector<double> activated = kRow;
  activated[10] = 0.1, activated[11] = 0.01, activated[12] = 0.5, activated[13] = 0.75;
  const auto notes_of = [&](std::vector<std::vector<double>> rows, size_t column, double value) {
    rows[7][column] = value;
    return read_scene_ply(write("m.ply", table(kStatic, rows)));
  };
  const std::vector<std::vector<double>> all(100, activated);
  EXPECT_TRUE(has_note(notes_of(all, 11, 0), "--activated reads them so"));
  EXPECT_TRUE(has_note(notes_of(all, 13, 1.0000001), "--activated reads them so"));
  std::vector<double> half = kRow;
  half[13] = 0.75;
  EXPECT_TRUE(has_note(notes_of(std::vector<std::vector<double>>(100, half), 13, 0.5),
                       "they were read as logits"));
  half = activated;
  half[13] = -3;
  EXPECT_TRUE(has_note(notes_of(std::vector<std::vector<double>>(100, half), 13, -2),
                       "they were read as logarithms"));
}

TEST_F(ForeignPlyTest, IntegersUnknownCommentsAndFarTimesAreNamed) {
  std::string text = table(kStatic, {kRow});
  text = test::replaced(text, "property float opacity", "property uchar opacity");
  text = test::replaced(text, " 0.250000", " 200");
  text = test::replaced(text, "element vertex", "comment l4d_orgin 1 2 3\nelement vertex");
  const Scene scene = read_scene_ply(write("i.ply", text));
  EXPECT_TRUE(has_note(scene, "an integer type, whose numbers are taken as they are: opacity."));
  EXPECT_TRUE(has_note(scene, "The comment l4d_orgin is not known and was not read."));
  std::vector<std::string> names = kStatic;
  names.insert(names.end(), {"trbf_center", "trbf_scale"});
  std::vector<double> row = kRow;
  row.insert(row.end(), {500, -1});
  EXPECT_TRUE(has_note(read_scene_ply(write("t.ply", table(names, {row}))),
                       "the sequence lasts from 0 to 1 s"));
}

// Milliseconds are far from the sequence, and times around 0 half before it.
TEST_F(ForeignPlyTest, TimesOutsideTheSequenceAreNamed) {
  std::vector<std::string> names = kStatic;
  for (const char* name : {"t", "scale_3", "rot_4", "rot_5", "rot_6", "rot_7"})
    names.push_back(name);
  for (const double last : {0.5, 1.5}) {
    std::vector<std::vector<double>> rows;
    for (int k = 0; k < 20; ++k) {
      rows.push_back(kRow);
      rows.back().insert(rows.back().end(), {last - 0.05 * k, -4, 1, 0, 0, 0});
    }
    EXPECT_TRUE(has_note(read_scene_ply(write("t.ply", table(names, rows))),
                         "the sequence lasts from 0 to 1 s"))
        << last;
  }
}

TEST_F(ForeignPlyTest, ColumnsOfTimeThatALayoutLeavesAreRefused) {
  for (const char* more : {"lifetime", "velocity_0", "keyframe_0"}) {
    std::vector<std::string> names = kStatic;
    std::vector<double> row = kRow;
    for (const char* name : {"t", "scale_t", more}) names.push_back(name);
    row.insert(row.end(), {0.25, -2, 1});
    std::string message;
    EXPECT_EQ(
        test::status_of([&] { read_scene_ply(write("t.ply", table(names, {row}))); }, &message),
        L4D_ERR_FEATURE_UNSUPPORTED);
    EXPECT_NE(message.find(more), std::string::npos) << message;
  }
}

TEST_F(ForeignPlyTest, BytesInPlaceOfLogitsAndCoefficientsAreNamed) {
  std::vector<double> row = kRow;
  row[3] = row[4] = row[5] = 200;
  EXPECT_TRUE(has_note(read_scene_ply(write("b.ply", table(kStatic, {row, row}))),
                       "Base colours (f_dc) are from 0 to 200"));
  for (size_t k = 0; k < kStatic.size(); ++k) {
    if (kStatic[k] != "opacity") continue;
    row = kRow;
    row[k] = 255;
    EXPECT_TRUE(has_note(read_scene_ply(write("b.ply", table(kStatic, {row, row}))),
                         "Opacities are from 0 to 255"));
  }
}

TEST_F(ForeignPlyTest, ColoursMayBeRedGreenAndBlue) {
  std::vector<std::string> names = kStatic;
  std::vector<double> row = kRow;
  const auto with_type = [&](const std::string& type, double red) {
    names[3] = type + " red", names[4] = type + " green", names[5] = type + " blue";
    row[3] = red, row[4] = 0, row[5] = red;
    std::string text = table(names, {row});
    if (type == "uchar") {  // whole numbers
      for (size_t at = text.find(" 207.0"); at != std::string::npos; at = text.find(" 207.0"))
        text.erase(at + 4, 7);
      text.replace(text.find(" 0.000000"), 9, " 0");
    }
    return read_scene_ply(write("c.ply", text));
  };
  const Scene bytes = with_type("uchar", 207);
  EXPECT_NEAR(bytes.sh[0], (207 / 255.0 - 0.5) / 0.28209479177387814, 1e-6);
  EXPECT_NEAR(bytes.sh[1], -0.5 / 0.28209479177387814, 1e-6);
  EXPECT_TRUE(has_note(bytes, "from 0 to 255"));
  EXPECT_NEAR(with_type("float", 0.75).sh[0], 0.25 / 0.28209479177387814, 1e-6);
}

TEST_F(ForeignPlyTest, SixteenBitColumnsHoldBinary16) {
  std::string file = test::ply_header("binary_little_endian", {}, 1, kStatic);
  for (size_t at = file.find("float"); at != std::string::npos; at = file.find("float")) {
    file.replace(at, 5, "ushort");
  }
  // 1, 2, -3, ...
  for (const int bits :
       {0x3c00, 0x4000, 0xc200, 0, 0, 0, 0x3c00, 0, 0, 0, 0xc200, 0xc200, 0xc200, 0x3400}) {
    test::append(file, static_cast<uint16_t>(bits));
  }
  const Scene scene = read_scene_ply(write("h.ply", file));
  EXPECT_EQ(scene.position, (std::vector<float>{1, 2, -3}));
  EXPECT_EQ(scene.opacity[0], 0.25F);
  EXPECT_TRUE(has_note(scene, "14 properties are of a 16-bit integer type"));
  std::string message;
  EXPECT_EQ(test::status_of(
                [&] { read_scene_ply(write("s.ply", table(kStatic, {kRow}, "short"))); }, &message),
            L4D_ERR_FEATURE_UNSUPPORTED);
  EXPECT_NE(message.find("16-bit integer type"), std::string::npos) << message;
}

TEST_F(ForeignPlyTest, DegreeFourIsCutToThree) {
  std::vector<std::string> names = kStatic;
  std::vector<double> row = kRow;
  for (int k = 0; k < 72; ++k) {
    names.push_back("f_rest_" + std::to_string(k));
    row.push_back(k);
  }
  const Scene scene = read_scene_ply(write("d.ply", table(names, {row})));
  ASSERT_EQ(scene.sh_degree, 3U);
  for (size_t k = 1; k < 16; ++k) {
    for (size_t channel = 0; channel < 3; ++channel) {
      EXPECT_EQ(scene.sh[3 * k + channel], static_cast<float>(24 * channel + k - 1));
    }
  }
  EXPECT_TRUE(has_note(scene, "degree 4 were cut to degree 3"));
}

// Spacetime Gaussians under the names t, scale_t and motion_*: sigma = exp(scale_t), p + m (s - t).
TEST_F(ForeignPlyTest, TimesScalesAndMotionsMove) {
  std::vector<std::string> names = kStatic;
  for (const char* name : {"t", "scale_t", "motion_0", "motion_1", "motion_2"})
    names.push_back(name);
  std::vector<double> row = kRow;
  row.insert(row.end(), {0.25, std::log(0.1), 0.1, 0, -0.2});
  std::vector<double> still = kRow;
  still.insert(still.end(), {0.75, std::log(0.1), 0, 0, 0});
  ImportOptions options;
  options.seconds = 2;
  const Scene scene = read_scene_ply(write("t.ply", table(names, {row, still})), options);
  ASSERT_EQ(scene.count(), 2U);
  EXPECT_EQ(scene.mean_t, (std::vector<float>{0.5F, 1.5F}));
  EXPECT_NEAR(scene.log_scale[7], std::log(0.2), 1e-6);
  EXPECT_TRUE(has_note(scene, "parts of the sequence"));
  Rotor rotor;
  Vec4 scale;
  for (size_t k = 0; k < 8; ++k) rotor[k] = static_cast<double>(scene.rotor[k]);
  for (size_t k = 0; k < 4; ++k) scale[k] = std::exp(static_cast<double>(scene.log_scale[k]));
  const auto moving = slice(rotor, scale);
  EXPECT_NEAR(moving.sigma_t, 0.2, 1e-6);
  EXPECT_NEAR(moving.velocity[0], 0.1 / 2, 1e-6);  // 0.1 in the sequence, which is 2 s
  // Beyond 1, times are seconds.
  row[14] = 1.5;
  const Scene seconds = read_scene_ply(write("s.ply", table(names, {row})), options);
  EXPECT_EQ(seconds.mean_t[0], 1.5F);
  EXPECT_TRUE(has_note(seconds, "seconds from the beginning"));
}

TEST_F(ForeignPlyTest, SpacetimeModelsHaveTheFramesOfTheirTraining) {
  namespace fs = std::filesystem;
  std::vector<std::string> names = kStatic;
  for (const char* name : {"t", "scale_t"}) names.push_back(name);
  std::vector<double> row = kRow;
  row.insert(row.end(), {0.25, -2});
  fs::create_directories(path("m/point_cloud/iteration_3"));
  const std::string file = write("m/point_cloud/iteration_3/point_cloud.ply", table(names, {row}));
  EXPECT_EQ(read_scene_ply(file).timeline.num_frames, 30U);
  for (const char* arguments :
       {"Namespace(sh_degree=3, duration=50, loader='colmap')",
        "Namespace(max_duration=300, duration=50)", "Namespace(duration=50, sh_degree=3)",
        "Namespace(\nduration=50)"}) {
    write("m/cfg_args", arguments);
    EXPECT_EQ(read_scene_ply(file).timeline.num_frames, 50U) << arguments;
  }
  EXPECT_EQ(read_scene_ply(file).mean_t[0], static_cast<float>(0.25 * 50 / 30));
}

TEST_F(ForeignPlyTest, HeadersAreReadInLinearTime) {
  std::string text = "ply\nformat ascii 1.0\n";
  for (int k = 0; k < 60000; ++k) text += "element e" + std::to_string(k) + " 0\n";
  std::string message;
  EXPECT_EQ(test::status_of([&] { read_scene_ply(write("h.ply", text)); }, &message),
            L4D_ERR_CORRUPT);
  EXPECT_NE(message.find("too many elements"), std::string::npos) << message;
}

// Real-time-4DGS: the product of two matrices of quaternions whose rows and columns are then in
// reverse order, and scales x y z t along its columns.
void real_time_covariance(const float* l, const float* r, const float* log_scale,
                          Real (*sigma)[4]) {
  Real a[4], p[4], left = 0, right = 0;
  for (int k = 0; k < 4; ++k) {
    left += Real(l[k]) * l[k];
    right += Real(r[k]) * r[k];
  }
  for (int k = 0; k < 4; ++k) {
    a[k] = l[k] / std::sqrt(left);
    p[k] = r[k] / std::sqrt(right);
  }
  const Real ml[4][4] = {{a[0], -a[1], -a[2], -a[3]},
                         {a[1], a[0], -a[3], a[2]},
                         {a[2], a[3], a[0], -a[1]},
                         {a[3], -a[2], a[1], a[0]}};
  const Real mr[4][4] = {{p[0], p[1], p[2], p[3]},
                         {-p[1], p[0], -p[3], p[2]},
                         {-p[2], p[3], p[0], -p[1]},
                         {-p[3], -p[2], p[1], p[0]}};
  Real m[4][4];
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      m[3 - i][3 - j] = 0;
      for (int k = 0; k < 4; ++k) m[3 - i][3 - j] += ml[i][k] * mr[k][j];
    }
  }
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) {
      sigma[i][j] = 0;
      for (int k = 0; k < 4; ++k) {
        sigma[i][j] += m[i][k] * std::exp(2 * Real(log_scale[k])) * m[j][k];
      }
    }
  }
}

TEST_F(ForeignPlyTest, RealTime4dgsKeepsCovariances) {
  struct Layout {
    const char *time, *scale, *left;
  };
  for (const Layout& layout : {Layout{"t", "scale_t", "rot_"}, Layout{"mu_t", "t_scale", "rot_l_"},
                               Layout{"t", "scale_3", "rot_"}}) {
    std::vector<std::string> names = {"x", "y", "z", layout.time, "scale_0", "scale_1", "scale_2"};
    names.push_back(layout.scale);
    for (int k = 0; k < 4; ++k) names.push_back(layout.left + std::to_string(k));
    const bool one_name = layout.scale == std::string("scale_3");
    for (int k = 0; k < 4; ++k) {
      names.push_back(one_name ? "rot_" + std::to_string(4 + k) : "rot_r_" + std::to_string(k));
    }
    for (const char* name : {"opacity", "f_dc_0", "f_dc_1", "f_dc_2"}) names.push_back(name);
    constexpr size_t kCount = 50;
    std::string file = test::ply_header("binary_little_endian", {}, kCount, names);
    std::vector<float> rows;
    Random random(5);
    for (size_t i = 0; i < kCount * names.size(); ++i) {
      rows.push_back(static_cast<float>(random.uniform(-1.5, 1.5)));
      test::append(file, rows.back());
    }
    ImportOptions options;
    options.seconds = 10;
    const Scene scene = read_scene_ply(write("r.ply", file), options);
    EXPECT_EQ(scene.source, "rt4dgs_ply");
    EXPECT_EQ(scene.timeline.num_frames, 300U);
    EXPECT_EQ(scene.flags, static_cast<uint32_t>(L4D_POSITION_AT_MEAN_TIME | L4D_OPACITY_LOGIT));
    ASSERT_EQ(scene.count(), kCount);
    for (size_t i = 0; i < kCount; ++i) {
      const float* row = &rows[i * names.size()];
      EXPECT_EQ(scene.position[3 * i + 2], row[2]);
      EXPECT_EQ(scene.mean_t[i], row[3]);
      EXPECT_EQ(scene.opacity[i], row[16]);
      Real expected[4][4], found[4][4], largest = 0, error = 0;
      real_time_covariance(row + 8, row + 12, row + 4, expected);
      reference::covariance4(&scene.rotor[8 * i], &scene.log_scale[4 * i], found);
      for (int k = 0; k < 16; ++k) {
        largest = std::max(largest, std::abs(expected[k / 4][k % 4]));
        error = std::max(error, std::abs(expected[k / 4][k % 4] - found[k / 4][k % 4]));
      }
      EXPECT_LT(error, 1e-6 * largest) << i;
    }
  }
}

}  // namespace
}  // namespace l4d::io
