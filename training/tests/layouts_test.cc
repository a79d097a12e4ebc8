// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <set>

#include "io/file/memory.h"
#include "io/image/video.h"
#include "tests/common/ffmpeg.h"
#include "tests/common/jpeg.h"
#include "training/capture/opencv_yaml.h"
#include "training/capture/tolerance.h"
#include "training/images/loader.h"
#include "training/init/start.h"
#include "training/tests/layout_files.h"

// One capture, written in each of the layouts: the same cameras, times and images, and a training
// on each gives the same bits.
namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::copy_images;
using test::digits;
using test::expect_error;
using test::kCameras;
using test::kFrames;
using test::name_of;
using test::put;
using test::Truth;
using test::write_colmap;
using test::write_text;
using testing::HasSubstr;
using Layout = std::string;

json matrix_of(const double* m, size_t rows, size_t columns, size_t stride) {
  json out = json::array();
  for (size_t r = 0; r < rows; ++r)
    out.push_back(std::vector<double>(m + stride * r, m + stride * r + columns));
  return out;
}

void write_ours(const Truth& truth, const std::string& folder) {
  copy_images(truth, folder, "%04u.png");
  json cameras = json::array();
  for (uint32_t c = 0; c < kCameras; ++c) {
    const l4d_camera& k = truth.cameras[c];
    json w2c = matrix_of(k.world_to_camera, 3, 4, 4);
    w2c.push_back({0, 0, 0, 1});
    cameras.push_back({{"id", c},
                       {"split", c == 0 ? "test" : "train"},
                       {"images", "images/" + name_of(c) + "/%04d.png"},
                       {"K", {{k.fx, 0, k.cx}, {0, k.fy, k.cy}, {0, 0, 1}}},
                       {"w2c", w2c}});
  }
  write_text(
      folder + "/cameras.json",
      json{{"fps", 10}, {"frames", kFrames}, {"width", 64}, {"height", 48}, {"cameras", cameras}}
          .dump());
}

void write_dnerf(const Truth& truth, const std::string& folder) {
  for (const bool is_test : {false, true}) {
    json frames = json::array();
    for (uint32_t f = 0; f < kFrames; ++f) {
      for (uint32_t c = is_test ? 0 : 1; c < (is_test ? 1 : kCameras); ++c) {
        const double* m = truth.cameras[c].world_to_camera;
        double center[3];
        camera_center(truth.cameras[c], center);
        json c2w = json::array();
        for (size_t r = 0; r < 3; ++r) c2w.push_back({m[r], -m[4 + r], -m[8 + r], center[r]});
        c2w.push_back({0, 0, 0, 1});
        frames.push_back(
            {{"file_path", truth.image(c, f)}, {"time", f / 10.0}, {"transform_matrix", c2w}});
      }
    }
    const l4d_camera& k = truth.cameras[0];
    write_text(folder + (is_test ? "/transforms_test.json" : "/transforms_train.json"),
               json{{"fl_x", k.fx},
                    {"fl_y", k.fy},
                    {"cx", k.cx},
                    {"cy", k.cy},
                    {"w", 64},
                    {"h", 48},
                    {"frames", frames}}
                   .dump());
  }
}

std::string yaml_matrix(const std::string& key, const std::vector<double>& values, size_t rows) {
  std::string text = key + ": !!opencv-matrix\n  rows: " + std::to_string(rows) +
                     "\n  cols: " + std::to_string(values.size() / rows) + "\n  dt: d\n  data: [";
  for (size_t i = 0; i < values.size(); ++i) {
    text += (i == 0 ? "" : i % 4 == 0 ? ",\n      " : ", ") + digits(values[i]);
  }
  return text + "]\n";
}

void write_selfcap(const Truth& truth, const std::string& folder) {
  copy_images(truth, folder, "%06u.png");
  std::string intri = "%YAML:1.0\n---\nnames:\n", extri = "%YAML:1.0\n---\n";
  for (uint32_t c = 0; c < kCameras; ++c) intri += "  - \"" + name_of(c) + "\"\n";
  for (uint32_t c = 0; c < kCameras; ++c) {
    const l4d_camera& k = truth.cameras[c];
    const double* m = k.world_to_camera;
    intri += yaml_matrix("K_" + name_of(c), {k.fx, 0, k.cx, 0, k.fy, k.cy, 0, 0, 1}, 3);
    intri += "H_" + name_of(c) + ": 48.\nW_" + name_of(c) + ": 64\n";
    intri += yaml_matrix("D_" + name_of(c), {0, 0, 0, 0, 0}, 5);
    extri += yaml_matrix("Rot_" + name_of(c),
                         {m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]}, 3);
    extri += yaml_matrix("T_" + name_of(c), {m[3], m[7], m[11]}, 3);
  }
  write_text(folder + "/intri.yml", intri);
  write_text(folder + "/extri.yml", extri);
}

void write_hypernerf(const Truth& truth, const std::string& folder) {
  json ids = json::array(), tests = json::array(), metadata = json::object();
  for (uint32_t f = 0; f < kFrames; ++f) {
    for (uint32_t c = 0; c < kCameras; ++c) {
      const std::string id = name_of(c) + "_" + std::to_string(f);
      const l4d_camera& k = truth.cameras[c];
      ids.push_back(id);
      if (c == 0) tests.push_back(id);
      metadata[id] = {{"warp_id", f}, {"camera_id", c}};
      fs::create_directories(folder + "/rgb/2x");
      fs::copy_file(truth.image(c, f), folder + "/rgb/2x/" + id + ".png");
      double center[3];
      camera_center(k, center);
      // The scene is larger by 4 and elsewhere: scale and centre undo that.
      json position = json::array();
      for (size_t i = 0; i < 3; ++i) position.push_back(4 * center[i] + (i == 1 ? 2.0 : 0.0));
      write_text(folder + "/camera/" + id + ".json",
                 json{{"focal_length", 2 * k.fx},
                      {"pixel_aspect_ratio", k.fy / k.fx},
                      {"image_size", {128, 96}},
                      {"principal_point", {2 * k.cx, 2 * k.cy}},
                      {"orientation", matrix_of(k.world_to_camera, 3, 3, 4)},
                      {"position", position},
                      {"radial_distortion", {0, 0, 0}},
                      {"tangential_distortion", {0, 0}}}
                     .dump());
    }
  }
  write_text(folder + "/dataset.json", json{{"ids", ids}, {"val_ids", tests}}.dump());
  write_text(folder + "/scene.json", json{{"scale", 0.25}, {"center", {0, 2, 0}}}.dump());
  write_text(folder + "/metadata.json", metadata.dump());
}

void write_dynamic3dgs(const Truth& truth, const std::string& folder) {
  for (const bool is_test : {false, true}) {
    json k = json::array(), w2c = json::array(), names = json::array(), ids = json::array();
    for (uint32_t f = 0; f < kFrames; ++f) {
      json ks = json::array(), poses = json::array(), files = json::array(), of = json::array();
      for (uint32_t c = is_test ? 0 : 1; c < (is_test ? 1 : kCameras); ++c) {
        const l4d_camera& camera = truth.cameras[c];
        ks.push_back({{camera.fx, 0, camera.cx}, {0, camera.fy, camera.cy}, {0, 0, 1}});
        json pose = matrix_of(camera.world_to_camera, 3, 4, 4);
        pose.push_back({0, 0, 0, 1});
        poses.push_back(pose);
        char name[40];
        std::snprintf(name, sizeof(name), "%u/%06u.png", c, f);
        files.push_back(name);
        of.push_back(c);
        fs::create_directories(folder + "/ims/" + std::to_string(c));
        fs::copy_file(truth.image(c, f), folder + "/ims/" + name);
      }
      k.push_back(ks);
      w2c.push_back(poses);
      names.push_back(files);
      ids.push_back(of);
    }
    write_text(
        folder + (is_test ? "/test_meta.json" : "/train_meta.json"),
        json{{"w", 64}, {"h", 48}, {"k", k}, {"w2c", w2c}, {"fn", names}, {"cam_id", ids}}.dump());
  }
}

void write_panoptic(const Truth& truth, const std::string& folder) {
  json cameras = {{{"name", "01_01"}, {"type", "vga"}}};
  for (uint32_t c = 0; c < kCameras; ++c) {
    const l4d_camera& k = truth.cameras[c];
    const double* m = k.world_to_camera;
    const std::string name = "00_0" + std::to_string(c);
    cameras.push_back({{"name", name},
                       {"type", "hd"},
                       {"resolution", {64, 48}},
                       {"K", {{k.fx, 0, k.cx}, {0, k.fy, k.cy}, {0, 0, 1}}},
                       {"distCoef", {0, 0, 0, 0, 0}},
                       {"R", matrix_of(m, 3, 3, 4)},
                       {"t", {{m[3]}, {m[7]}, {m[11]}}}});
    fs::create_directories(folder + "/hdImgs/" + name);
    for (uint32_t f = 0; f < kFrames; ++f) {
      fs::copy_file(truth.image(c, f), folder + "/hdImgs/" + name + "/" + name + "_0000000" +
                                           std::to_string(f) + ".png");
    }
  }
  write_text(folder + "/calibration_tiny.json", json{{"cameras", cameras}}.dump());
}

struct Case {
  const char* layout;
  void (*write)(const Truth&, const std::string&);
};
const Case kCases[] = {
    {"cameras", write_ours},
    {"dnerf", write_dnerf},
    {"selfcap", write_selfcap},
    {"hypernerf", write_hypernerf},
    {"colmap", [](const Truth& t, const std::string& folder) { write_colmap(t, folder, true); }},
    {"colmap", [](const Truth& t, const std::string& folder) { write_colmap(t, folder, false); }},
    {"dynamic3dgs", write_dynamic3dgs},
    {"panoptic", write_panoptic},
};

CaptureOptions options_of(const Layout& layout) {
  CaptureOptions options;
  const bool names_tests = layout == "dnerf" || layout == "hypernerf" || layout == "dynamic3dgs";
  options.test = names_tests ? "" : "0";
  options.fps = 10;
  options.any_path = layout == "dnerf";  // write_dnerf() names images by absolute paths
  return options;
}

// Cameras in the order of the capture, of which HyperNeRF has one for each image.
TEST(Layouts, HaveTheSameCamerasTimesAndImages) {
  const Truth truth;
  for (const Case& item : kCases) {
    const test::Folder folder;
    item.write(truth, folder / "capture");
    const Capture capture = read_capture(folder / "capture", options_of(item.layout));
    EXPECT_EQ(capture.layout, item.layout);
    EXPECT_EQ(capture.frames, kFrames);
    ASSERT_EQ(capture.views.size(), kCameras * kFrames) << item.layout;
    const ImageLoader loader(capture, 1);
    size_t tests = 0, found = 0;
    std::map<uint32_t, Pixels> images;
    std::vector<uint32_t> views;
    for (uint32_t k = 0; k < capture.views.size(); ++k) views.push_back(k);
    loader.load(views, 1, [&](uint32_t view, Pixels pixels) { images[view] = std::move(pixels); });
    for (uint32_t k = 0; k < capture.views.size(); ++k) {
      const CaptureView& view = capture.views[k];
      const CaptureCamera& camera = capture.cameras[view.camera];
      EXPECT_NEAR(view.time, 0.1 * view.frame, 1e-9) << item.layout;
      tests += camera.split == "test" ? 1U : 0U;
      for (uint32_t c = 0; c < kCameras; ++c) {
        const l4d_camera& a = camera.source.camera;
        const l4d_camera& b = truth.cameras[c];
        double apart = std::abs(a.fx - b.fx) + std::abs(a.fy - b.fy) + std::abs(a.cx - b.cx);
        for (size_t i = 0; i < 12; ++i) {
          apart += std::abs(a.world_to_camera[i] - b.world_to_camera[i]);
        }
        if (apart > 1e-9) continue;
        ++found;
        EXPECT_EQ(camera.split, c == 0 ? "test" : "train") << item.layout;
        const io::Image image = io::read_image(truth.image(c, view.frame));
        std::vector<uint8_t> bytes(image.rgb.size());
        io::to_bytes(image.rgb.data(), bytes.size(), bytes.data());
        EXPECT_EQ(images[k].rgb, bytes) << item.layout;
      }
    }
    EXPECT_EQ(found, capture.views.size()) << item.layout;
    EXPECT_EQ(tests, kFrames) << item.layout;
    if (item.layout == std::string("colmap")) {
      ASSERT_EQ(capture.points.size(), 1U);
      EXPECT_EQ(capture.points[0].position[1], 0.25f);
      EXPECT_EQ(capture.points[0].rgb[0], 1);
    }
  }
}

// Endings and numbers as other programs write them.
TEST(Layouts, TakeJpegsAndImagesFromOneOn) {
  const Truth truth;
  for (const bool from_one : {false, true}) {
    const test::Folder folder;
    write_colmap(truth, folder / "capture", false, from_one ? "%u.JPEG" : "%05u.jpg");
    for (uint32_t c = 0; from_one && c < kCameras; ++c) {
      const std::string images = folder / "capture/images/" + name_of(c) + "/";
      for (uint32_t f = kFrames; f > 0; --f) {
        fs::rename(images + std::to_string(f - 1) + ".JPEG", images + std::to_string(f) + ".JPEG");
      }
    }
    const auto read = [&](bool tolerant) {
      CaptureOptions options = options_of("colmap");
      options.tolerant = tolerant;
      return read_capture(folder / "capture", options);
    };
    const Capture capture = read(true);
    ASSERT_EQ(capture.views.size(), kCameras * kFrames);
    EXPECT_EQ(std::count(capture.notes.begin(), capture.notes.end(), "Images are numbered from 1."),
              from_one ? 1 : 0);
    check_image_files(capture);
    const ImageLoader loader(capture, 1);
    loader.load({7}, 1, [&](uint32_t view, const Pixels& pixels) {
      const CaptureView& of = capture.views[view];
      const io::Image image = io::read_image(truth.image(of.camera, of.frame));
      double apart = 0;
      for (size_t i = 0; i < image.rgb.size(); ++i) {
        apart += std::abs(255.0 * image.rgb[i] - pixels.rgb[i]);
      }
      EXPECT_LT(apart / static_cast<double>(image.rgb.size()), 3);
    });
    // PNGs beside them, as of pictures that were converted, are taken.
    const std::string own = folder / "capture/images/" + name_of(1);
    for (uint32_t f = 0; f < kFrames; ++f) {
      fs::copy_file(truth.image(1, f), own + "/" + std::to_string(from_one ? f + 1 : f) + ".png");
    }
    EXPECT_EQ(fs::path(read(false).views[1].file).extension(), ".png");
    // What is cut off ends its camera, as a PNG does.
    const std::string file = capture.views[kCameras].file;  // frame 1 of camera 0
    fs::resize_file(file, fs::file_size(file) - 40);
    EXPECT_EQ(read(true).frames, 1U);
    write_text(file, l4d::test::jpeg_of(8, 8, std::vector<uint8_t>(192)));
    EXPECT_THROW(check_image_files(read(false)), io::Error);
  }
}

TEST(Layouts, TakeExrsAsTheirPngs) {
  if (!l4d::test::ffmpeg_available()) GTEST_SKIP() << "no ffmpeg";
  const Truth truth;
  const test::Folder folder;
  write_colmap(truth, folder / "capture", false, "%05u.exr");
  CaptureOptions options = options_of("colmap");
  options.tolerant = true;
  const Capture capture = read_capture(folder / "capture", options);
  ASSERT_EQ(capture.views.size(), kCameras * kFrames);
  check_image_files(capture);
  ImageLoader(capture, 1).load({1, 7}, 1, [&](uint32_t view, const Pixels& pixels) {
    const CaptureView& of = capture.views[view];
    const io::Image image = io::read_image(truth.image(of.camera, of.frame));
    std::vector<uint8_t> bytes(image.rgb.size());
    io::to_bytes(image.rgb.data(), bytes.size(), bytes.data());
    EXPECT_EQ(pixels.rgb, bytes);
    EXPECT_TRUE(pixels.alpha.empty());
  });
  const std::string file = capture.views[kCameras].file;  // frame 1 of camera 0
  fs::resize_file(file, fs::file_size(file) - 1);
  EXPECT_EQ(read_capture(folder / "capture", options).frames, 1U);
  l4d::test::ExrForm luminance;
  luminance.channels = {{"Y", {0}}};
  write_text(file, l4d::test::exr_of(luminance));
  options.tolerant = false;
  try {
    check_image_files(read_capture(folder / "capture", options));
    ADD_FAILURE();
  } catch (const io::Error& error) {
    EXPECT_THAT(error.what(), HasSubstr(file + ": an EXR with the channels Y"));
  }
}

std::string npy_of(const std::vector<double>& values, size_t rows) {
  std::string header = "{'descr': '<f8', 'fortran_order': False, 'shape': (" +
                       std::to_string(rows) + ", " + std::to_string(values.size() / rows) +
                       "), }\n";
  std::string out("\x93NUMPY\x01\x00", 8);
  put<uint16_t>(&out, static_cast<uint16_t>(header.size()));
  out += header;
  for (const double value : values) put(&out, value);
  return out;
}

void write_n3dv(const Truth& truth, const std::string& folder) {
  std::vector<double> rows;
  for (const l4d_camera& k : truth.cameras) {
    const double* m = k.world_to_camera;
    double center[3];
    camera_center(k, center);
    for (size_t r = 0; r < 3; ++r) {
      // Columns: down, right, back.
      rows.insert(rows.end(), {m[4 + r], m[r], -m[8 + r], center[r],
                               r == 0   ? 48.0
                               : r == 1 ? 64.0
                                        : k.fx});
    }
    rows.insert(rows.end(), {1, 100});
  }
  write_text(folder + "/poses_bounds.npy", npy_of(rows, kCameras));
}

// Videos of all cameras in `folder`, under cam00.mp4 and so on.
void copy_videos(const std::string& from, const std::string& to) {
  fs::create_directories(to);
  for (uint32_t c = 0; c < kCameras; ++c) {
    fs::copy_file(from + "/" + name_of(c) + ".mp4", to + "/" + name_of(c) + ".mp4");
  }
}

// Makes videos of the truth's images, and takes their frames as the truth from then on. Cameras get
// numbers that all layouts hold without rounding.
void make_videos(Truth* truth, const std::string& videos, const std::string& frames) {
  fs::create_directories(videos);
  for (uint32_t c = 0; c < kCameras; ++c) {
    l4d_camera& k = truth->cameras[c];
    k.fx = k.fy = 64;
    k.cx = 32;
    k.cy = 24;
    const double pose[12] = {1, 0, 0, 0.5 * c - 1, 0, 1, 0, 0.25 * (c % 2), 0, 0, 1, 4};
    std::copy_n(pose, 12, k.world_to_camera);
    io::VideoOptions options;
    options.fps = 10;
    const std::string file = videos + "/" + name_of(c) + ".mp4";
    io::VideoWriter writer(file, 64, 48, options);
    for (uint32_t f = 0; f < kFrames; ++f) writer.write(io::read_image(truth->image(c, f)));
    writer.finish();
    io::VideoReader reader(file, 64, 48);
    io::Image image;
    fs::create_directories(frames + "/" + name_of(c));
    for (uint32_t f = 0; f < kFrames; ++f) {
      ASSERT_TRUE(reader.next(&image));
      char name[40];
      std::snprintf(name, sizeof(name), "/%04u.png", f);
      io::write_png(frames + "/" + name_of(c) + name, image);
    }
  }
  truth->frames = frames;
}

// Such a truth and its videos, made once.
struct Videos {
  test::Folder folder;
  std::string path = folder / "videos";
  Truth truth;
  Videos() { make_videos(&truth, path, folder / "frames"); }
};
const Videos& made_videos() {
  static const Videos made;
  return made;
}

void write_toml(const Truth& truth, const std::string& folder) {
  std::string text = "[metadata]\nadjusted = false\n";
  for (uint32_t c = 0; c < kCameras; ++c) {
    const l4d_camera& k = truth.cameras[c];
    const double* m = k.world_to_camera;
    text += "[cam_" + std::to_string(c) + "]\nname = \"" + name_of(c) +
            "\"\nsize = [64, 48]\nmatrix = [[" + digits(k.fx) + ", 0.0, " + digits(k.cx - 0.5) +
            "], [0.0, " + digits(k.fy) + ", " + digits(k.cy - 0.5) +
            "], [0.0, 0.0, 1.0]]\ndistortions = [0.0, 0.0, 0.0, 0.0]\nrotation = [0.0, 0.0, 0.0]\n"
            "translation = [" +
            digits(m[3]) + ", " + digits(m[7]) + ", " + digits(m[11]) + "]\n";
  }
  write_text(folder + "/calibration/Calib.toml", text);
}

// A training has the same bits whatever the layout.
TEST(Layouts, TrainToTheSameBits) {
  if (!l4d::test::ffmpeg_available()) GTEST_SKIP() << "no ffmpeg";
  const test::Folder folder;
  const Truth& truth = made_videos().truth;
  const std::string& videos = made_videos().path;
  std::vector<Case> cases(std::begin(kCases), std::end(kCases));
  cases.push_back({"n3dv", write_n3dv});
  cases.push_back({"toml", write_toml});
  std::string first;
  for (const Case& item : cases) {
    const std::string layout = item.layout, capture = folder / (layout + "-capture");
    fs::remove_all(capture);
    item.write(truth, capture);
    if (layout == "n3dv") copy_videos(videos, capture);
    if (layout == "selfcap" || layout == "colmap" || layout == "toml") {
      fs::remove_all(capture + "/images");
      copy_videos(videos, capture + "/videos");
    }
    RunOptions options;
    options.folder = folder / (layout + "-run");
    options.force = true;
    options.settings.capture = capture;
    options.settings.reading = options_of(layout);
    options.settings.gaussians = 150;
    options.settings.sh_degree = 0;
    options.settings.steps = 6;
    options.settings.views = 2;
    options.settings.init = "frustum";
    options.settings.exposure = "off";
    test::Listener listener;
    const RunReport report = train(options, &listener);
    EXPECT_EQ(report.layout, layout);
    const std::string scene = test::bytes_of(options.folder + "/scene.ply");
    if (first.empty()) first = scene;
    EXPECT_TRUE(scene == first) << layout;
  }
}

struct Damage {
  Case layout;
  std::string file;      // that is missing, then damaged
  std::string named;     // in the note
  uint32_t cameras = 0;  // that are left
  uint32_t frames = kFrames;
  size_t views = 0;
};

enum class Trouble { kMissing, kCutOff, kOtherSize };

void make_trouble(Trouble trouble, const std::string& path) {
  const std::string whole = test::bytes_of(path);
  fs::remove(path);
  if (trouble == Trouble::kCutOff) write_text(path, whole.substr(0, whole.size() / 2));
  if (trouble == Trouble::kOtherSize) io::write_png(path, io::Image(32, 24));
}

// What `inspect` and a training say of the first image that is not of its camera's size.
void expect_other_size(const Capture& capture, const std::string& what) {
  const ImageLoader loader(capture, 1);
  std::vector<uint32_t> views(capture.views.size());
  for (uint32_t k = 0; k < views.size(); ++k) views[k] = k;
  std::set<std::string> said;
  for (const bool reads : {false, true}) {
    try {
      if (reads) loader.load(views, 2, [](uint32_t, const Pixels&) {});
      if (!reads) check_image_files(capture);
      ADD_FAILURE() << what << reads;
    } catch (const io::Error& error) {
      EXPECT_EQ(error.status(), L4D_ERR_CORRUPT) << what;
      EXPECT_THAT(error.what(), HasSubstr("png has 32 x 24 pixels, and the camera has 64 x 48"));
      said.insert(error.what());
    }
  }
  EXPECT_EQ(said.size(), 1U) << what;
}

// What --tolerant makes of a file that is missing, of one that is cut off, and of an image of
// another size than its camera.
TEST(Layouts, TolerateFilesThatAreMissingOrDamaged) {
  const Truth truth;
  const auto dnerf = [](const Truth& t, const std::string& folder) {
    Truth own = t;
    copy_images(t, folder, "%04u.png");
    own.frames = folder + "/images";
    write_dnerf(own, folder);
  };
  const std::vector<Damage> all = {
      {{"cameras", write_ours}, "images/cam02/0000.png", "camera 2", 4, kFrames, 16},
      {{"cameras", write_ours}, "images/cam02/0003.png", "camera 2", 5, 3, 15},
      {{"dnerf", dnerf}, "images/cam02/0003.png", "cam02/0003.png", 5, kFrames, 19},
      {{"selfcap", write_selfcap}, "images/cam02/000000.png", "camera 2", 4, kFrames, 16},
      {{"selfcap", write_selfcap}, "images/cam02/000003.png", "camera 2", 5, 3, 15},
      {{"hypernerf", write_hypernerf}, "rgb/2x/cam02_3.png", "cam02_3", 5, kFrames, 19},
      {{"hypernerf", write_hypernerf}, "camera/cam02_3.json", "cam02_3", 5, kFrames, 19},
      {kCases[4], "images/cam02/0000.png", "camera 2", 4, kFrames, 16},
      {kCases[5], "images/cam02/0003.png", "camera 2", 5, 3, 15},
  };
  for (const Damage& item : all) {
    for (const Trouble trouble : {Trouble::kMissing, Trouble::kCutOff, Trouble::kOtherSize}) {
      const std::string what = item.layout.layout + (" " + item.file) + " trouble " +
                               std::to_string(static_cast<int>(trouble));
      if (trouble == Trouble::kOtherSize && fs::path(item.file).extension() != ".png") continue;
      const test::Folder folder;
      item.layout.write(truth, folder / "c");
      make_trouble(trouble, folder / ("c/" + item.file));
      CaptureOptions options = options_of(item.layout.layout);
      // What is missing is found without the option, too; damaged images when they are read.
      if (trouble == Trouble::kMissing) {
        EXPECT_THROW(read_capture(folder / "c", options), io::Error) << what;
      }
      if (trouble == Trouble::kOtherSize) {
        expect_other_size(read_capture(folder / "c", options), what);
      }
      options.tolerant = true;
      const Capture capture = read_capture(folder / "c", options);
      EXPECT_EQ(capture.cameras.size(), item.cameras) << what;
      EXPECT_EQ(capture.frames, item.frames) << what;
      EXPECT_EQ(capture.views.size(), item.views) << what;
      EXPECT_THAT(capture.notes, testing::Contains(HasSubstr(item.named))) << what;
      const ImageLoader loader(capture, 1);
      std::vector<uint32_t> views(capture.views.size());
      for (uint32_t k = 0; k < views.size(); ++k) views[k] = k;
      size_t loaded = 0;
      loader.load(views, 1, [&](uint32_t, const Pixels&) { ++loaded; });
      EXPECT_EQ(loaded, item.views) << what;
    }
  }
}

// Videos of all names pair with rows in their order.
TEST(Layouts, N3dvTakesVideosOfAnyName) {
  if (!l4d::test::ffmpeg_available()) GTEST_SKIP() << "no ffmpeg";
  const test::Folder folder;
  const Truth& truth = made_videos().truth;
  const auto video_of = [](uint32_t c) { return made_videos().path + "/" + name_of(c) + ".mp4"; };
  write_n3dv(truth, folder / "c");
  const char* const names[kCameras] = {"GX01.MP4", "GX02.mkv", "a.mp4", "b 1.mov", "cam00.mp4"};
  for (uint32_t c = 0; c < kCameras; ++c) {
    fs::copy_file(video_of(c), folder / (std::string("c/") + names[c]));
  }
  write_text(folder / "c/._GX01.MP4", "what some systems leave behind");
  const Capture capture = read_capture(folder / "c", {});
  ASSERT_EQ(capture.cameras.size(), kCameras);
  for (uint32_t c = 0; c < kCameras; ++c) {
    const CaptureCamera& camera = capture.cameras[c];
    EXPECT_EQ(fs::path(camera.source.video).filename(), names[c]);
    EXPECT_EQ(camera.source.camera.world_to_camera[3], truth.cameras[c].world_to_camera[3]);
    EXPECT_EQ(camera.split, c == 4 ? "test" : "train");  // cam00, wherever it is
  }
  const auto of_tests = testing::HasSubstr("for testing");
  EXPECT_THAT(capture.notes, testing::Contains(HasSubstr("Camera 4 is for testing")));
  EXPECT_THAT(capture.notes, testing::Contains(of_tests).Times(1));
  CaptureOptions chosen;
  chosen.test = "0,2";
  EXPECT_THAT(read_capture(folder / "c", chosen).notes, testing::Not(testing::Contains(of_tests)));
  // One that is damaged is left out, one that is missing would move the others.
  write_text(folder / "c/a.mp4", "no video");
  CaptureOptions options;
  EXPECT_THROW(read_capture(folder / "c", options), io::Error);
  options.tolerant = true;
  const Capture four = read_capture(folder / "c", options);
  EXPECT_EQ(four.cameras.size(), 4U);
  EXPECT_EQ(four.cameras[2].source.id, 3);
  EXPECT_THAT(four.notes, testing::Contains(HasSubstr("camera 2")));
  fs::remove(folder / "c/cam00.mp4");
  write_text(folder / "c/a.mp4", "");
  fs::copy_file(video_of(0), folder / "c/a0.mp4");
  EXPECT_EQ(read_capture(folder / "c", options).cameras.front().split, "test");
  fs::remove(folder / "c/a0.mp4");
  EXPECT_THROW(read_capture(folder / "c", options), io::Error);
  expect_error(folder / "c", L4D_ERR_IO, "another number of videos");
}

TEST(Layouts, YamlOfOpenCv) {
  const test::Folder folder;
  const auto read = [&](const std::string& text) {
    write_text(folder / "a.yml", text);
    return read_opencv_yaml(folder / "a.yml");
  };
  const YamlFile file = read(
      "%YAML:1.0\n---\nnames:\n   - \"00\"\n   - b\nfps: 59.94\n"
      "K: !!opencv-matrix\n   rows: 2\n   cols: 2\n   dt: d\n   data: [ 1., -2.5e3,\n       3, .5 "
      "]\n");
  EXPECT_EQ(file.texts.at("names"), (std::vector<std::string>{"00", "b"}));
  EXPECT_EQ(file.numbers.at("fps"), std::vector<double>{59.94});
  EXPECT_EQ(file.numbers.at("K"), (std::vector<double>{1, -2500, 3, 0.5}));
  for (const char* bad : {"K: !!opencv-matrix\n  rows: 2\n  cols: 2\n  data: [1, 2, 3]\n",
                          "K: !!opencv-matrix\n  rows: 1\n  cols: 1\n  data: [.nan]\n",
                          "K: !!opencv-matrix\n  rows: 1\n  cols: 1\n", "K: [1, 2\n", "no key\n",
                          "  indented: 1\n", "fps: 1\nfps: 2\n", "K: [1]\nK:\n  - a\n"}) {
    EXPECT_THROW(read(bad), io::Error) << bad;
  }
}

// What a camera would otherwise silently lack.
TEST(Layouts, SelfcapIsReadAsItIsOrRefused) {
  const Truth truth;
  const test::Folder folder;
  write_selfcap(truth, folder / "s");
  const std::string whole = test::bytes_of(folder / "s/intri.yml");
  const auto change = [&](const std::string& from, const std::string& to) {
    std::string text = whole;
    text.replace(text.find(from), from.size(), to);
    write_text(folder / "s/intri.yml", text);
  };
  const std::string lens = yaml_matrix("D_cam02", {0, 0, 0, 0, 0}, 5);
  change(lens, yaml_matrix("D_cam02", {0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8}, 8));
  const io::Distortion read = read_capture(folder / "s", {}).cameras[2].source.distortion;
  EXPECT_THAT(read.k, testing::ElementsAre(0.1, 0.2, 0.5, 0.6, 0.7, 0.8));
  EXPECT_THAT(read.p, testing::ElementsAre(0.3, 0.4));
  change(lens, yaml_matrix("D_cam02", {0.1, 0.2}, 1));
  expect_error(folder / "s", L4D_ERR_CORRUPT, "D_cam02: 2 numbers");
  change(lens, yaml_matrix("dist_cam02", std::vector<double>(12, 0.1), 1));
  expect_error(folder / "s", L4D_ERR_FEATURE_UNSUPPORTED, "dist_cam02: a thin prism");
  change("W_cam00: 64\n", "W_cam00: 64.5\n");
  expect_error(folder / "s", L4D_ERR_CORRUPT, "W_cam00: no whole number");
  change("- \"cam04\"", "- \"cam03\"");
  expect_error(folder / "s", L4D_ERR_CORRUPT, "cam03 twice");
  change(", 0, ", ", 3, ");
  expect_error(folder / "s", L4D_ERR_FEATURE_UNSUPPORTED, "K_cam00: a skew");
}

TEST(Layouts, SelfcapMayStateOneRotationTwiceButNotTwo) {
  const Truth truth;
  const test::Folder folder;
  write_selfcap(truth, folder / "s");
  const std::string whole = test::bytes_of(folder / "s/extri.yml");
  const std::string matrix = yaml_matrix("Rot_cam02", {0, -1, 0, 1, 0, 0, 0, 0, 1}, 3);
  const auto turn_by = [&](double angle) {
    std::string text = whole;
    text.replace(text.find("Rot_cam02"), text.find("T_cam02") - text.find("Rot_cam02"), matrix);
    write_text(folder / "s/extri.yml", text + yaml_matrix("R_cam02", {0, 0, angle}, 3));
  };
  turn_by(1.5708);  // a quarter
  EXPECT_EQ(read_capture(folder / "s", {}).cameras[2].source.camera.world_to_camera[4], 1);
  turn_by(1.5723);
  expect_error(folder / "s", L4D_ERR_CORRUPT,
               "camera cam02: Rot_cam02 and R_cam02 are different rotations");
}

TEST(Layouts, WrongSelfcapAndHypernerf) {
  const Truth truth;
  const test::Folder folder;
  write_selfcap(truth, folder / "s");
  std::string text = test::bytes_of(folder / "s/extri.yml");
  text.replace(text.find("T_cam02"), 7, "T_other");
  write_text(folder / "s/extri.yml", text);
  expect_error(folder / "s", L4D_ERR_CORRUPT, "camera cam02");
  write_hypernerf(truth, folder / "h");
  const std::string one = folder / "h/camera/cam02_1.json", whole = test::bytes_of(one);
  const auto with = [&](const char* key, const json& value) {
    json camera = json::parse(whole);
    camera[key] = value;
    write_text(one, camera.dump());
  };
  // Images of one place are of one camera, but not where the lens has changed.
  EXPECT_EQ(read_capture(folder / "h", {}).cameras.size(), kCameras);
  with("radial_distortion", {0.1, 0, 0});
  EXPECT_EQ(read_capture(folder / "h", {}).cameras.size(), kCameras + 1);
  with("skew", 2);
  expect_error(folder / "h", L4D_ERR_FEATURE_UNSUPPORTED, "cam02_1: the camera has a skew");
  with("skew", 0);
  write_text(one, "{\"skew\": 1, " + test::bytes_of(one).substr(1));
  expect_error(folder / "h", L4D_ERR_CORRUPT, "cam02_1.json: an object has a key twice");
  write_text(one, whole);
  fs::remove(folder / "h/rgb/2x/cam03_1.png");
  expect_error(folder / "h", L4D_ERR_IO, "cam03_1");
  fs::remove(folder / "h/camera/cam02_1.json");
  expect_error(folder / "h", L4D_ERR_IO, "cam02_1");
}

// Offsets of cameras move times by parts of a frame.
TEST(Layouts, SelfcapOffsets) {
  const Truth truth;
  const test::Folder folder;
  write_selfcap(truth, folder / "s");
  write_text(folder / "s/sync.json", R"({"cam02": -0.03, "cam01": 0.2, "cam20": 1})");
  CaptureOptions options;
  options.fps = 10;
  const Capture capture = read_capture(folder / "s", options);
  for (const CaptureView& view : capture.views) {
    const double plain = 0.1 * view.frame;
    const double wanted = view.camera == 2 ? plain + 0.03 : view.camera == 1 ? plain - 0.2 : plain;
    EXPECT_NEAR(view.time, std::max(0.0, wanted), 1e-9);
  }
  EXPECT_THAT(capture.notes, testing::Contains(HasSubstr("does not name: \"cam20\"")));
  EXPECT_THAT(capture.notes, testing::Contains(HasSubstr("no offset of \"cam00\"")));
  write_text(folder / "s/sync.json", R"({"cam02": -0.03, "cam02": 0.2})");
  expect_error(folder / "s", L4D_ERR_CORRUPT, "sync.json: an object has a key twice");
}

// What calibrations become is counted before they are parsed.
TEST(Layouts, CalibrationsAreCounted) {
  const test::Folder folder;
  write_text(folder / "calib.toml", "x = [" + std::string(2000, ' ') + "]\n");
  write_text(folder / "s/intri.yml", "a:" + std::string(2000, '\n'));
  write_text(folder / "s/extri.yml", "a:\n");
  CaptureOptions options;
  for (const auto& [path, file] :
       {std::make_pair("calib.toml", "calib.toml"), {"s", "intri.yml"}}) {
    for (const uint64_t limit : {uint64_t{100000}, uint64_t{1} << 20}) {
      const io::MemoryBudget budget("--limit-memory", limit);
      options.holder = budget.holder();
      try {
        read_capture(folder / path, options);
        ADD_FAILURE() << "it has no camera";
      } catch (const io::Error& error) {
        EXPECT_EQ(error.status(), limit < (1 << 20) ? L4D_ERR_LIMIT_EXCEEDED : L4D_ERR_CORRUPT);
        EXPECT_THAT(error.what(), HasSubstr(file));
      }
      EXPECT_EQ(budget.held(), 0U);
    }
  }
}

TEST(Layouts, TomlIsNamedWhereItIsWrong) {
  const test::Folder folder;
  const std::string good =
      "[a]\nsize = [64, 48]\nmatrix = [[60, 0, 32], [0, 60, 24], [0, 0, 1]]\ndistortions = [0.1, "
      "0, 0, 0, "
      "0.2]\nrotation = [0.0, 1.5, 0.0]\ntranslation = [0, 0, 3]\n";
  const auto expect = [&](const std::string& text, l4d_status status, const std::string& word) {
    write_text(folder / "calib.toml", text);
    expect_error(folder / "calib.toml", status, word);
  };
  expect("[a\n", L4D_ERR_CORRUPT, "line 1");
  std::string deep = "\n";
  for (int k = 0; k < 500; ++k) deep += "a.";
  expect(deep + "a = 1\n", L4D_ERR_CORRUPT, "it has no camera");
  expect(deep + "a.a = 1\n", L4D_ERR_CORRUPT, "line 2: it has more than 500 dots");
  expect("x = 1\n", L4D_ERR_CORRUPT, "it has no camera");
  expect("[a]\nmatrix = 3\n", L4D_ERR_CORRUPT, "camera a: size is no list");
  expect(good + "fisheye = true\n", L4D_ERR_CORRUPT, "camera a: distortions has 5 numbers, not 4");
  expect(good, L4D_ERR_IO, "camera a: the names of 0 of 0 videos");
  std::string twice = good;
  twice.insert(4, "name = \"b\"\n");
  expect(twice + "[c]\nname = \"b\"" + good.substr(3), L4D_ERR_CORRUPT,
         "two of its cameras have the name b");
}

// Names that are in each other's, or only partly those of videos.
TEST(Layouts, VideosOfTomlAreThoseOfTheirNames) {
  if (!l4d::test::ffmpeg_available()) GTEST_SKIP() << "no ffmpeg";
  const test::Folder folder;
  const Videos& made = made_videos();
  const auto capture_of = [&](const std::vector<std::string>& names,
                              const std::vector<std::string>& videos) {
    fs::remove_all(folder / "c");
    std::string text;
    for (size_t c = 0; c < names.size(); ++c) {
      text += "[" + std::string(1, static_cast<char>('a' + c)) + "]\nname = \"" + names[c] +
              "\"\nsize = [64, 48]\nmatrix = [[64, 0, 31.5], [0, 64, 23.5], [0, 0, 1]]\n"
              "distortions = [0, 0, 0, 0]\nrotation = [0, 0, 0]\ntranslation = [" +
              digits(0.5 * static_cast<double>(c)) + ", 0, 4]\n";
      fs::create_directories(folder / "c/videos");
      fs::copy_file(made.path + "/" + name_of(0) + ".mp4",
                    folder / ("c/videos/" + videos[c] + ".mp4"));
    }
    write_text(folder / "c/Config.toml", "[project]\nframe_rate = 10\n");
    write_text(folder / "c/calibration/Calib.toml", text);
    return read_capture(folder / "c", {});
  };
  const std::vector<std::pair<std::vector<std::string>, std::vector<std::string>>> cases = {
      {{"cam1", "cam2", "cam10", "cam11"}, {"cam1", "cam2", "cam10", "cam11"}},
      {{"cam1", "cam2", "cam10", "cam11"}, {"s_cam1", "s_cam2", "s_cam10", "s_cam11"}},
      {{"2", "1", "3", "10"}, {"s1-cam2", "s1-cam1", "s1-cam3", "s1-cam10"}},
      {{"B", "A", "C", "D"}, {"apr-B-cam", "mon-A-cam", "jun-C-cam", "dec-D-cam"}}};
  for (const auto& [names, videos] : cases) {
    const Capture capture = capture_of(names, videos);
    ASSERT_EQ(capture.cameras.size(), 4U);
    for (size_t c = 0; c < 4; ++c) {
      EXPECT_THAT(capture.cameras[c].source.video, testing::EndsWith("/" + videos[c] + ".mp4"));
      EXPECT_EQ(capture.cameras[c].source.camera.cx, 32);
    }
    EXPECT_THAT(capture.notes, testing::Not(testing::Contains(HasSubstr("by the order"))));
  }
  const Capture by_order = capture_of({"a", "b", "c"}, {"1", "2", "3"});
  EXPECT_THAT(by_order.notes, testing::Contains(HasSubstr("by the order of their names")));
  try {
    capture_of({"cam1", "cam2", "cam3"}, {"cam1", "one", "two"});
    ADD_FAILURE() << "which is of cam2?";
  } catch (const io::Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("camera cam2: the names of 0 of 3 videos"));
  }
}

}  // namespace
}  // namespace l4d::train
