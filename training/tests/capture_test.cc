// SPDX-License-Identifier: Apache-2.0
#include "training/capture/capture.h"

#include <gmock/gmock.h>

#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "io/file/file.h"
#include "io/image/video.h"
#include "tests/common/ffmpeg.h"
#include "training/images/loader.h"
#include "training/images/store.h"
#include "training/run/report/inspect.h"
#include "training/run/setup/settings.h"
#include "training/run/train/evaluate.h"
#include "training/tests/tiny_capture.h"

namespace l4d::train {
namespace {

using nlohmann::json;
using test::Folder;
using testing::HasSubstr;

// Expects that reading fails with the status and a message that names all of `words`.
void expect_error(const std::string& path, const CaptureOptions& options, l4d_status status,
                  const std::vector<std::string>& words) {
  try {
    read_capture(path, options);
    FAIL() << path;
  } catch (const io::Error& error) {
    EXPECT_EQ(error.status(), status) << error.what();
    for (const std::string& word : words) EXPECT_THAT(error.what(), HasSubstr(word));
  }
}

json tiny_document() { return json::parse(test::bytes_of(test::tiny_capture() + "/cameras.json")); }

// A file of cameras beside that of the tiny capture, so that its images are found.
std::string write_document(const json& document) {
  static int number = 0;
  const std::string folder = test::tiny_capture() + "/variant" + std::to_string(number++);
  std::filesystem::create_directories(folder);
  std::filesystem::create_directory_symlink(test::tiny_capture() + "/images", folder + "/images");
  std::ofstream(folder + "/cameras.json") << document;
  return folder;
}

TEST(Captures, Ours) {
  const Capture capture = read_capture(test::tiny_capture(), {});
  EXPECT_EQ(capture.layout, "cameras");
  EXPECT_EQ(capture.frames, 20U);
  EXPECT_EQ(capture.fps, 10);
  ASSERT_EQ(capture.cameras.size(), 16U);
  EXPECT_EQ(capture.cameras[8].split, "test");
  EXPECT_EQ(capture.views.size(), 320U);
  EXPECT_EQ(capture.views[17].camera, 1U);
  EXPECT_NEAR(capture.views[17].time, 0.1, 1e-12);
}

TEST(Captures, OptionsChooseFramesAndTests) {
  CaptureOptions options;
  options.frames = "4:16:2";
  options.test = "1,3-5";
  options.seconds = 3;
  const Capture capture = read_capture(test::tiny_capture(), options);
  EXPECT_EQ(capture.views.size(), 6U * 16);
  EXPECT_EQ(capture.frames, 12U);
  EXPECT_EQ(capture.views.front().frame, 4U);
  EXPECT_EQ(capture.views.front().time, 0);
  EXPECT_EQ(capture.cameras[4].split, "test");
  EXPECT_EQ(capture.cameras[0].split, "train");
  EXPECT_THAT(capture.notes, testing::Contains(HasSubstr("--seconds (3) changes nothing")));
  options.test = "99";
  expect_error(test::tiny_capture(), options, L4D_ERR_INVALID_ARGUMENT, {"99"});
  options.test = "1-";
  expect_error(test::tiny_capture(), options, L4D_ERR_INVALID_ARGUMENT, {"1-"});
  options.test = "";
  options.frames = "9:3";
  expect_error(test::tiny_capture(), options, L4D_ERR_INVALID_ARGUMENT, {"9:3"});
}

TEST(Captures, BadCameras) {
  json document = tiny_document();
  document["cameras"][2]["w2c"][0][0] = document["cameras"][2]["w2c"][0][0].get<double>() + 0.1;
  expect_error(write_document(document), {}, L4D_ERR_CORRUPT, {"camera 2"});
  document = tiny_document();
  document["cameras"][3]["K"][0][0] = -5;
  expect_error(write_document(document), {}, L4D_ERR_CORRUPT, {"camera 3", "focal"});
  document = tiny_document();
  document["cameras"][3]["w2c"][1][3] = nullptr;  // as JSON has NaN
  expect_error(write_document(document), {}, L4D_ERR_CORRUPT, {"camera 3", "w2c"});
  document = tiny_document();
  document["cameras"].erase(1);
  for (json& camera : document["cameras"]) camera["split"] = "test";
  expect_error(write_document(document), {}, L4D_ERR_INVALID_ARGUMENT, {"at least 3"});
  document["cameras"][3]["split"] = "val";
  const std::string folder = write_document(document);
  expect_error(folder, {}, L4D_ERR_CORRUPT, {"camera 4", "\"val\"", "train or test", "--test"});
  CaptureOptions options;
  options.test = "0";
  const Capture chosen = read_capture(folder, options);
  for (size_t k = 0; k < chosen.cameras.size(); ++k) {
    EXPECT_EQ(chosen.cameras[k].split, k == 0 ? "test" : "train");
  }
  expect_error(test::tiny_capture() + "/images", {}, L4D_ERR_FEATURE_UNSUPPORTED, {"layout"});
  expect_error("/nonexistent", {}, L4D_ERR_IO, {"/nonexistent"});
}

// A camera would otherwise silently lack what a misspelt key says.
TEST(Captures, UnknownKeysAreNamed) {
  json document = tiny_document();
  document["frame_rate"] = 30;
  document["cameras"][3]["time_ofset"] = 0.1;
  document["cameras"][5]["time_ofset"] = 0.2;
  document["cameras"][5]["near"] = 0.1;
  const Capture capture = read_capture(write_document(document), {});
  size_t named = 0;
  for (const std::string& note : capture.notes) named += note.find("is not known") < note.size();
  EXPECT_EQ(named, 2U);
  EXPECT_THAT(
      capture.notes,
      testing::Contains("The key \"time_ofset\" of camera 3 is not known, and is ignored."));
  EXPECT_THAT(capture.notes, testing::Contains(HasSubstr("\"frame_rate\" of the file")));
}

TEST(Captures, CamerasOfTheSameImagesAreNamed) {
  json document = tiny_document();
  document["cameras"][3]["images"] = "./" + document["cameras"][1]["images"].get<std::string>();
  EXPECT_THAT(read_capture(write_document(document), {}).notes,
              testing::Contains(HasSubstr("camera 1 and camera 3 have the same images")));
}

// Maps have such coordinates.
TEST(Captures, CamerasFarFromTheOriginAreNamed) {
  const auto moved = [](double by) {
    json document = tiny_document();
    for (json& camera : document["cameras"]) {
      for (size_t r = 0; r < 3; ++r) {
        const double turned = camera["w2c"][r][1].get<double>() * by;
        camera["w2c"][r][3] = camera["w2c"][r][3].get<double>() - turned;
      }
    }
    return write_document(document);
  };
  expect_error(moved(1e8), {}, L4D_ERR_FEATURE_UNSUPPORTED,
               {"camera ", " is 1e+08 units away from the origin", "are 12 apart"});
  const auto far = testing::Contains(HasSubstr("Positions are coarse: camera "));
  EXPECT_THAT(read_capture(moved(2e5), {}).notes, far);
  EXPECT_THAT(read_capture(moved(1e4), {}).notes, testing::Not(far));
}

// A frame that was taken outside the sequence shows nothing of it.
TEST(Captures, FramesOfAnotherTimeAreLeftOut) {
  json document = tiny_document();
  document["cameras"][3]["time_offset"] = 0.57;
  const Capture capture = read_capture(write_document(document), {});
  EXPECT_EQ(capture.views.size(), 315U);
  for (const CaptureView& view : capture.views) {
    const double offset = view.camera == 3 ? 0.57 : 0;
    EXPECT_NEAR(view.time, std::min(0.1 * view.frame + offset, 2.0), 1e-9);
  }
  EXPECT_THAT(capture.notes,
              testing::Contains(HasSubstr("5 frames are left out: by its time_offset of 0.57 s")));
  // Those of the sequence are trained with the images nearest to them, each at its own time.
  const std::vector<Instant> instants = instants_of(capture, "train");
  ASSERT_EQ(instants.size(), 20U);
  EXPECT_EQ(instants[6].views.size(), instants[5].views.size() + 1);
  EXPECT_DOUBLE_EQ(instants[6].time, 0.57);
  EXPECT_DOUBLE_EQ(instants[6].last, 0.6);
  document["cameras"][3]["time_offset"] = 1e6;
  expect_error(write_document(document), {}, L4D_ERR_CORRUPT, {"camera 3", "1e+06 s", "no frame"});
}

// Whatever the clocks of cameras say.
TEST(Captures, SheetsAreInTheOrderOfCameras) {
  json document = tiny_document();
  document["cameras"][0]["time_offset"] = 0.04;
  const std::string folder = write_document(document);
  inspect(folder, {}, folder + "/sheet.png", "", 1);
  const io::Image sheet = io::read_image(folder + "/sheet.png");
  const io::Image first = io::read_image(folder + "/images/cam00/0000.png");
  for (size_t y = 0; y < first.height; ++y) {
    EXPECT_TRUE(std::equal(&first.rgb[3 * y * first.width],
                           &first.rgb[3 * (y + 1) * first.width - 1],
                           &sheet.rgb[3 * y * sheet.width]))
        << y;
  }
}

TEST(Captures, MissingFrames) {
  json document = tiny_document();
  document["frames"] = 25;
  const std::string folder = write_document(document);
  expect_error(folder, {}, L4D_ERR_IO, {"camera 0", "frame 20 of 25", "images/cam00/0020.png"});
  CaptureOptions options;
  options.tolerant = true;
  const Capture capture = read_capture(folder, options);
  EXPECT_EQ(capture.frames, 20U);
  EXPECT_THAT(capture.notes, testing::Contains(HasSubstr("cut to 20 frames")));
  document["cameras"][3]["images"] = "pictures/cam03/%04d.png";
  expect_error(write_document(document), {}, L4D_ERR_IO,
               {"camera 3", "frame 0 of 25", "pictures/cam03/0000.png"});
  // A training reads masks when it begins; `inspect` names them, too.
  document = tiny_document();
  document["cameras"][2]["mask"] = "mask.png";
  const std::string masked = write_document(document);
  const auto inspected = [&] {
    try {
      return inspect(masked, {}, "", "", 1).text;
    } catch (const io::Error& error) {
      return std::string(error.what());
    }
  };
  EXPECT_EQ(inspected(), "camera 2: its mask: cannot open " + masked + "/mask.png");
  io::write_png(masked + "/mask.png", io::Image(48, 64));
  EXPECT_THAT(inspected(), HasSubstr("camera 2: its mask: " + masked + "/mask.png has 48 x 64"));
  io::write_png(masked + "/mask.png", io::Image(64, 48));
  EXPECT_THAT(inspected(), HasSubstr("camera 2: by its mask, " + masked + "/mask.png, none of"));
  io::Image white(64, 48);
  std::fill(white.rgb.begin(), white.rgb.end(), 1.0f);
  io::write_png(masked + "/mask.png", white);
  EXPECT_THAT(inspected(), HasSubstr("cameras    16"));
  // It decodes the first image of each camera, whose first bytes may be right.
  std::filesystem::copy(masked + "/images/cam03", masked + "/cut");
  std::filesystem::resize_file(masked + "/cut/0000.png", 200);
  document["cameras"][3]["images"] = "cut/%04d.png";
  std::ofstream(masked + "/cameras.json") << document;
  EXPECT_THAT(inspected(), HasSubstr("camera 3, frame 0: " + masked + "/cut/0000.png: bad PNG"));
}

// Workers render several views at a time, each with a renderer of its own.
TEST(Captures, ThreadsDoNotChangeRenderedImages) {
  const Folder folder;
  RenderCaptureOptions options;
  options.cameras = 3;
  options.width = 40;
  options.height = 30;
  options.first_frame = 4;
  options.frames = 5;
  options.threads = 1;
  render_capture(folder / "one", test::tiny_truth(), options);
  options.threads = 4;
  render_capture(folder / "four", test::tiny_truth(), options);
  std::set<std::vector<uint8_t>> images;
  for (const char* camera : {"cam00", "cam01", "cam02"}) {
    for (int frame = 0; frame < 5; ++frame) {
      const std::string name =
          std::string("/images/") + camera + "/000" + std::to_string(frame) + ".png";
      const std::vector<uint8_t> image = io::read_whole_file(folder / ("one" + name));
      EXPECT_EQ(image, io::read_whole_file(folder / ("four" + name))) << name;
      images.insert(image);
    }
  }
  EXPECT_EQ(images.size(), 15U) << "images of other cameras or frames are equal";
}

// An image that is not scaled takes a shorter path, with the bytes of an average of one pixel each.
TEST(Captures, ImagesOfTheirOwnSizeAreRounded) {
  io::Image image(37, 29);
  std::vector<float> alpha(size_t{37} * 29);
  std::mt19937 random(3);
  std::uniform_real_distribution<float> any(-0.1F, 1.1F);
  for (size_t i = 0; i < image.rgb.size(); ++i) {
    image.rgb[i] = i < 256 ? static_cast<float>(i) / 255 : any(random);
    if (i % 7 == 3) image.rgb[i] = (static_cast<float>(i % 255) + 0.5F) / 255;  // about half-way
  }
  for (float& a : alpha) a = any(random);
  const auto rounded = [](float value) {
    return std::clamp(std::lround(static_cast<double>(value) * 255), 0L, 255L);
  };
  const Pixels pixels = resized(image, alpha, 37, 29);
  ASSERT_EQ(pixels.rgb.size(), image.rgb.size());
  ASSERT_EQ(pixels.alpha.size(), alpha.size());
  for (size_t i = 0; i < image.rgb.size(); ++i) {
    ASSERT_EQ(pixels.rgb[i], rounded(image.rgb[i])) << image.rgb[i];
  }
  for (size_t i = 0; i < alpha.size(); ++i) ASSERT_EQ(pixels.alpha[i], rounded(alpha[i]));
  EXPECT_TRUE(resized(image, {}, 37, 29).alpha.empty());
}

// What a mask leaves out neither adds to the error nor dilutes it.
TEST(Scores, MasksScoreByTheirOwnPixels) {
  Pixels captured{40, 30, std::vector<uint8_t>(size_t{3} * 40 * 30, 128), {}};
  io::Image rendered(40, 30);
  std::vector<uint8_t> mask(size_t{40} * 30);
  for (size_t i = 0; i < mask.size(); ++i) {
    mask[i] = i % 40 < 10 ? 1 : 0;
    for (size_t c = 0; c < 3; ++c) {
      rendered.rgb[3 * i + c] = mask[i] != 0 ? 128.0F / 255 + 0.1F : 1.0F;
    }
  }
  Scorer scorer;
  scorer.add(captured, mask, rendered, 1);
  EXPECT_NEAR(scorer.score().plain.mean_psnr, 20, 1e-4);
  EXPECT_GT(scorer.score().psnr_affine, 60);  // one colour becomes another one
}

// A camera that is far below the others is named; a rig whose cameras differ is not.
TEST(Scores, NameCamerasThatFitTheOthersBadly) {
  const auto notes = [](const std::vector<double>& decibels) {
    Score score;
    for (size_t k = 0; k < decibels.size(); ++k) {
      score.cameras.push_back({"camera " + std::to_string(k), 10, 30, 20, decibels[k]});
    }
    return notes_of_cameras(score);
  };
  EXPECT_THAT(notes({36, 35.2, 37, 24.5, 36.3, 35.8}),
              testing::ElementsAre(HasSubstr("Camera 3 is shown at 24.5 dB")));
  EXPECT_TRUE(notes({36, 35.2, 37, 33, 36.3, 35.8}).empty());
  EXPECT_TRUE(notes({36, 30, 33, 24.5, 39, 27}).empty());
  EXPECT_TRUE(notes({36, 24, 35, 36}).empty());
}

// Images with alpha are compared on a background.
TEST(Scores, AreThoseOnABackground) {
  const Pixels captured{16, 16, std::vector<uint8_t>(size_t{3} * 256, 0),
                        std::vector<uint8_t>(256, 0)};
  io::Image white(16, 16);
  std::fill(white.rgb.begin(), white.rgb.end(), 1.0F);
  Scorer on_black, on_white(nullptr, {1, 1, 1});
  on_black.add(captured, {}, white, 1);
  on_white.add(captured, {}, white, 1);
  EXPECT_EQ(on_black.score().plain.psnr, 0);
  EXPECT_GT(on_white.score().plain.psnr, 100);
}

// A render whose colours are an affine map of the captured ones is as good as these.
TEST(Scores, FitColours) {
  constexpr uint32_t kWidth = 300, kHeight = 170;  // several pieces of sums
  Pixels captured{kWidth, kHeight, std::vector<uint8_t>(size_t{3} * kWidth * kHeight), {}};
  std::mt19937 random(5);
  for (uint8_t& value : captured.rgb) value = static_cast<uint8_t>(random() % 256);
  io::Image rendered(kWidth, kHeight);
  for (size_t i = 0; i < rendered.rgb.size(); i += 3) {
    const auto value = [&](size_t c) { return static_cast<float>(captured.rgb[i + c]) / 255; };
    rendered.rgb[i] = 0.2F + 0.5F * value(1) + 0.1F * value(2);
    rendered.rgb[i + 1] = 0.6F * value(0);
    rendered.rgb[i + 2] = 0.9F - 0.7F * value(2);
  }
  const auto score_with = [&](uint32_t threads, const io::Image& image) {
    Scorer scorer;
    scorer.add(captured, {}, image, threads);
    return scorer.score();
  };
  const Score one = score_with(1, rendered), four = score_with(4, rendered);
  EXPECT_LT(one.plain.mean_psnr, 12);
  EXPECT_GT(one.psnr_affine, 90);
  EXPECT_EQ(one.psnr_affine, four.psnr_affine);
  // What no map can tell stays: of a grey image, the variance of each channel.
  const io::Image grey = [&] {
    io::Image image(kWidth, kHeight);
    std::fill(image.rgb.begin(), image.rgb.end(), 0.5F);
    return image;
  }();
  EXPECT_NEAR(score_with(2, grey).psnr_affine, 10 * std::log10(12.0 * 255 * 255 / (256 * 256 - 1)),
              0.05);
}

class VideoCaptures : public testing::Test {
 protected:
  void SetUp() override {
    if (!l4d::test::ffmpeg_available()) GTEST_SKIP() << "no ffmpeg";
    path_ = folder_ / "capture";
    test::render_videos(path_);
  }
  Folder folder_;
  std::string path_;
};

TEST_F(VideoCaptures, FramesAreThoseOfTheVideo) {
  const Capture capture = read_capture(path_, {});
  EXPECT_TRUE(capture.cameras[0].is_video());
  EXPECT_EQ(capture.frames, 12U);
  const ImageLoader loader(capture, 1), half(capture, 0.5);
  EXPECT_EQ(half.camera(0).width, 32U);
  EXPECT_NEAR(half.camera(0).fx, loader.camera(0).fx / 2, 1e-9);
  std::map<uint32_t, Pixels> all, some, small;
  std::vector<uint32_t> views, late;
  for (uint32_t k = 0; k < capture.views.size(); ++k) {
    if (capture.views[k].camera != 1) continue;
    views.push_back(k);
    if (capture.views[k].frame >= 7) late.push_back(k);
  }
  loader.load(views, 1, [&](uint32_t view, Pixels p) { all[view] = std::move(p); });
  // The same frames where reading begins in the middle of the video.
  loader.load(late, 1, [&](uint32_t view, Pixels p) { some[view] = std::move(p); });
  half.load(late, 1, [&](uint32_t view, Pixels p) { small[view] = std::move(p); });
  ASSERT_EQ(some.size(), 5U);
  for (const auto& [view, pixels] : some) {
    EXPECT_EQ(pixels.rgb, all[view].rgb) << view;
    const Pixels wanted = halved(all[view]);
    double difference = 0;
    for (size_t i = 0; i < wanted.rgb.size(); ++i) {
      difference += std::abs(int{wanted.rgb[i]} - int{small[view].rgb[i]});
    }
    EXPECT_LT(difference / static_cast<double>(wanted.rgb.size()), 3) << view;
  }
}

// Cameras around a scene look at one place; cameras side by side, and cameras that look away from
// each other, do not.
TEST_F(VideoCaptures, CamerasThatLookAtOnePlaceHaveANearPlane) {
  Capture capture = read_capture(path_, {});
  EXPECT_TRUE(look_at_one_place(capture));
  Settings settings;
  EXPECT_EQ(near_of(settings, capture), 0.2);
  EXPECT_EQ(opacity_weight_of(settings, false), 0.015);
  EXPECT_EQ(opacity_weight_of(settings, true), 0.005);
  settings.opacity_weight = 0;
  EXPECT_EQ(opacity_weight_of(settings, true), 0);
  settings.near = 0.5;
  EXPECT_EQ(near_of(settings, capture), 0.5);
  const double radius = frame_of(capture).radius;
  const ImageLoader loader(capture, 1, 0.5), without(capture, 1);
  EXPECT_EQ(loader.camera(1).near_plane, 0.5 * radius);
  EXPECT_EQ(without.camera(1).near_plane, 0.02);

  settings.near = kAuto;
  for (CaptureCamera& camera : capture.cameras) {
    double* m = camera.source.camera.world_to_camera;
    const double back[12] = {-m[0], -m[1], -m[2], -m[3], m[4],   m[5],
                             m[6],  m[7],  -m[8], -m[9], -m[10], -m[11]};
    std::copy_n(back, 12, m);
  }
  EXPECT_FALSE(look_at_one_place(capture));
  EXPECT_EQ(near_of(settings, capture), 0);
  for (size_t c = 0; c < capture.cameras.size(); ++c) {
    const double side[12] = {1, 0, 0, static_cast<double>(c), 0, 1, 0, 0, 0, 0, 1, 0};
    std::copy_n(side, 12, capture.cameras[c].source.camera.world_to_camera);
  }
  EXPECT_FALSE(look_at_one_place(capture));
}

// The views that are scored while a training runs take all cameras, whatever their number and that
// of the frames have in common.
TEST_F(VideoCaptures, WatchedViewsTakeAllCameras) {
  Capture capture = read_capture(path_, {});
  for (CaptureCamera& camera : capture.cameras) camera.split = "test";
  const std::vector<uint32_t> views = views_to_watch(capture, "test", 6);
  ASSERT_EQ(views.size(), 6U);
  std::map<uint32_t, int> of_camera;
  std::set<uint32_t> frames;
  for (const uint32_t view : views) {
    ++of_camera[capture.views[view].camera];
    frames.insert(capture.views[view].frame);
  }
  EXPECT_EQ(of_camera.size(), 4U);
  EXPECT_EQ(frames.size(), 6U);
  EXPECT_EQ(views_to_watch(capture, "test", 1000).size(), capture.views.size());
}

// As phones record: frames are left out, and those that are there have their times.
TEST_F(VideoCaptures, TimesOfPacketsCount) {
  const std::string video = path_ + "/cam01.mp4", whole = path_ + "/whole.mp4";
  std::filesystem::rename(video, whole);
  const std::string drop = "ffmpeg -v error -i '" + whole +
                           "' -vf \"select='not(between(n,3,4))'\" -vsync passthrough -c:v libx264 "
                           "-crf 0 '" +
                           video + "'";
  ASSERT_EQ(std::system(drop.c_str()), 0);
  const auto frames_of_one = [](const Capture& capture) {
    std::map<uint32_t, double> times;
    for (const CaptureView& view : capture.views) {
      if (view.camera == 1) times[view.frame] = std::round(1e6 * view.time) / 1e6;
    }
    return times;
  };
  const Capture capture = read_capture(path_, {});
  EXPECT_EQ(capture.frames, 12U);
  EXPECT_THAT(capture.notes, testing::Contains(HasSubstr("camera 1 come at uneven times, which "
                                                         "count: frame 3 at 0.5 s, where 10 ")));
  EXPECT_EQ(frames_of_one(capture), (std::map<uint32_t, double>{{0, 0},
                                                                {1, .1},
                                                                {2, .2},
                                                                {3, .5},
                                                                {4, .6},
                                                                {5, .7},
                                                                {6, .8},
                                                                {7, .9},
                                                                {8, 1},
                                                                {9, 1.1}}));
  CaptureOptions options;
  options.frames = "2:8";
  EXPECT_EQ(frames_of_one(read_capture(path_, options)),
            (std::map<uint32_t, double>{{2, 0}, {3, .3}, {4, .4}, {5, .5}}));
  // The pictures are those of their times.
  io::VideoReader reader(whole, 64, 48);
  io::Image image;
  reader.read(7, &image);
  std::vector<uint8_t> wanted(image.rgb.size());
  io::to_bytes(image.rgb.data(), image.rgb.size(), wanted.data());
  for (uint32_t k = 0; k < capture.views.size(); ++k) {
    if (capture.views[k].camera != 1 || capture.views[k].frame != 5) continue;
    ImageLoader(capture, 1).load({k}, 1, [&](uint32_t, const Pixels& pixels) {
      EXPECT_EQ(pixels.rgb, wanted);
    });
  }
}

// A capture may name a rate that is a little off: as 30 for 29.97, a frame in half a minute.
TEST_F(VideoCaptures, FramesOfASteadyVideoCountAtAboutItsRate) {
  const std::string looped = path_ + "/looped.mp4";
  const std::string loop =
      "ffmpeg -v error -stream_loop 4 -i '" + path_ + "/cam00.mp4' -c copy '" + looped + "'";
  ASSERT_EQ(std::system(loop.c_str()), 0);
  json document = json::parse(test::bytes_of(path_ + "/cameras.json"));
  json camera = document["cameras"][0];
  camera["video"] = "looped.mp4";
  camera["split"] = "train";
  document["cameras"] = json::array({camera});
  document["frames"] = 60;
  document["fps"] = 9.91;
  std::ofstream(path_ + "/cameras.json") << document;
  const Capture capture = read_capture(path_, {});
  ASSERT_EQ(capture.views.size(), 60U);
  EXPECT_FALSE(capture.cameras[0].is_uneven);
  EXPECT_NEAR(capture.views.back().time, 59 / 9.91, 1e-9);
}

TEST_F(VideoCaptures, WrongVideosAreNamed) {
  json document = json::parse(test::bytes_of(path_ + "/cameras.json"));
  const auto write = [&] { std::ofstream(path_ + "/cameras.json") << document; };
  document["frames"] = 40;
  write();
  expect_error(path_, {}, L4D_ERR_IO, {"camera 0", "frame 12 of 40", "cam00.mp4 has 12 frames"});
  document["frames"] = 12;
  document["fps"] = 12.5;
  write();
  expect_error(path_, {}, L4D_ERR_CORRUPT, {"camera 0", "synchronised"});
  document["fps"] = 10;
  document["width"] = 66;
  write();
  expect_error(path_, {}, L4D_ERR_CORRUPT, {"camera 0", "64 x 48", "66 x 48"});
  document["width"] = 64;
  write();
  std::filesystem::remove(path_ + "/cam02.mp4");
  expect_error(path_, {}, L4D_ERR_IO, {"camera 2", "cam02.mp4"});
  CaptureOptions options;
  options.tolerant = true;
  EXPECT_EQ(read_capture(path_, options).cameras.size(), 3U);
}

// D-NeRF: one image and one camera for each frame, alpha, and a test camera in both files.
TEST(Captures, Dnerf) {
  const Folder folder;
  const io::Scene truth = test::tiny_truth();
  const Capture source = read_capture(test::tiny_capture(), {});
  const auto write = [&](const std::string& split, const std::vector<uint32_t>& cameras) {
    json frames = json::array();
    for (const CaptureView& view : source.views) {
      if (view.frame % 5 != 0 ||
          std::find(cameras.begin(), cameras.end(), view.camera) == cameras.end()) {
        continue;
      }
      const double* m = source.cameras[view.camera].source.camera.world_to_camera;
      double center[3];
      camera_center(source.cameras[view.camera].source.camera, center);
      json matrix = json::array();
      for (size_t r = 0; r < 3; ++r) matrix.push_back({m[r], -m[4 + r], -m[8 + r], center[r]});
      matrix.push_back({0, 0, 0, 1});
      frames.push_back(
          {{"file_path", view.file}, {"time", view.time / 2}, {"transform_matrix", matrix}});
    }
    const l4d_camera& c = source.cameras[0].source.camera;
    std::ofstream(folder / ("transforms_" + split + ".json"))
        << json{{"fl_x", c.fx}, {"fl_y", c.fy},  {"cx", c.cx},      {"cy", c.cy},
                {"w", c.width}, {"h", c.height}, {"frames", frames}};
  };
  write("train", {1, 2, 3, 4});
  write("test", {4});
  CaptureOptions options;
  options.seconds = 2;
  // The images lie in another folder.
  expect_error(folder / "transforms_train.json", options, L4D_ERR_INVALID_ARGUMENT, {"--any-path"});
  options.any_path = true;
  const Capture capture = read_capture(folder / "transforms_train.json", options);
  EXPECT_EQ(capture.layout, "dnerf");
  EXPECT_EQ(capture.cameras.size(), 4U);
  EXPECT_EQ(capture.views.size(), 16U);
  EXPECT_EQ(capture.fps, 2);
  EXPECT_EQ(capture.frames, 4U);
  size_t tests = 0;
  for (const CaptureView& view : capture.views) {
    tests += capture.cameras[view.camera].split == "test" ? 1U : 0U;
  }
  EXPECT_EQ(tests, 4U);
  EXPECT_THAT(capture.notes, testing::Contains(HasSubstr("used for tests alone")));
  EXPECT_THAT(capture.notes,
              testing::Contains("Times of images are multiplied by --seconds (2): the last one is "
                                "at 1.5 s, and the sequence lasts 2 s."));
  // An image of another lens is of another camera.
  json changed = json::parse(test::bytes_of(folder / "transforms_train.json"));
  changed["frames"][0]["k1"] = 0.1;
  std::ofstream(folder / "transforms_train.json") << changed;
  EXPECT_EQ(read_capture(folder / "transforms_train.json", options).cameras.size(), 5U);
  // So is one of another mask. Training begins at the points that the file names.
  changed["frames"][1]["mask_path"] = "mask.png";
  changed["ply_file_path"] = "points.ply";
  std::ofstream(folder / "transforms_train.json") << changed;
  test::write_true_points(folder / "points.ply");
  const Capture masked = read_capture(folder / "transforms_train.json", options);
  ASSERT_EQ(masked.cameras.size(), 6U);
  const auto with_mask = [](const CaptureCamera& camera) { return !camera.source.mask.empty(); };
  EXPECT_EQ(std::count_if(masked.cameras.begin(), masked.cameras.end(), with_mask), 1);
  Settings settings;
  EXPECT_EQ(resolved(settings, masked, 64, 48).init, folder / "points.ply");
  settings.init = "frustum";
  EXPECT_EQ(resolved(settings, masked, 64, 48).init, "frustum");
  // Cameras are where they were.
  const l4d_camera& a = capture.cameras[0].source.camera;
  const l4d_camera& b = source.cameras[4].source.camera;
  for (size_t k = 0; k < 12; ++k) EXPECT_NEAR(a.world_to_camera[k], b.world_to_camera[k], 1e-9);
  std::filesystem::remove(folder / "transforms_train.json");
  expect_error(folder / "transforms_test.json", {}, L4D_ERR_FEATURE_UNSUPPORTED, {"layout"});
}

// A straight line stays where the pinhole camera has it: distort, then undistort.
TEST(Undistortion, UndoesTheLens) {
  l4d_camera camera =
      scaled_camera(read_capture(test::tiny_capture(), {}).cameras[0].source.camera, 1);
  camera.width = 120;
  camera.height = 90;
  camera.fx = camera.fy = 100;
  camera.cx = 60;
  camera.cy = 45;
  for (const auto model : {io::Distortion::Model::kRadial, io::Distortion::Model::kFisheye}) {
    io::Distortion lens;
    lens.model = model;
    lens.k[0] = -0.2;
    lens.k[1] = 0.05;
    if (model == io::Distortion::Model::kRadial) lens.p[0] = 0.01;
    // Each pixel of the distorted image tells the direction that it sees: found by iteration.
    io::Image image(120, 90);
    for (size_t y = 0; y < 90; ++y) {
      for (size_t x = 0; x < 120; ++x) {
        const double u = (static_cast<double>(x) + 0.5 - 60) / 100;
        const double v = (static_cast<double>(y) + 0.5 - 45) / 100;
        double at[2] = {u, v}, seen[2];
        for (int i = 0; i < 60; ++i) {
          distort(lens, at[0], at[1], seen);
          at[0] += u - seen[0];
          at[1] += v - seen[1];
        }
        image.rgb[3 * (y * 120 + x)] = static_cast<float>(0.5 + 0.5 * at[0]);
        image.rgb[3 * (y * 120 + x) + 1] = static_cast<float>(0.5 + 0.5 * at[1]);
      }
    }
    const Undistortion undistortion(camera, lens);
    const io::Image out = undistortion.apply(image);
    double worst = 0;
    size_t counted = 0;
    for (size_t y = 0; y < 90; ++y) {
      for (size_t x = 0; x < 120; ++x) {
        const size_t i = y * 120 + x;
        if (undistortion.mask()[i] == 0) continue;
        ++counted;
        const double u = 0.5 + 0.5 * (static_cast<double>(x) + 0.5 - 60) / 100;
        const double v = 0.5 + 0.5 * (static_cast<double>(y) + 0.5 - 45) / 100;
        if (x < 2 || y < 2 || x > 117 || y > 87) continue;
        worst = std::max(worst, std::abs(static_cast<double>(out.rgb[3 * i]) - u));
        worst = std::max(worst, std::abs(static_cast<double>(out.rgb[3 * i + 1]) - v));
      }
    }
    EXPECT_LT(worst, 0.002) << static_cast<int>(model);
    EXPECT_GT(counted, 120U * 90 * 9 / 10);
  }
}

}  // namespace
}  // namespace l4d::train
