// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include "training/init/start.h"
#include "training/tests/layout_files.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using test::expect_error;
using test::kCameras;
using test::kFrames;
using test::name_of;
using test::Truth;
using test::write_colmap;
using test::write_text;
using testing::HasSubstr;

TEST(ColmapLayout, ThatIsCutOffIsNamed) {
  const Truth truth;
  const test::Folder folder;
  write_colmap(truth, folder / "c", true);
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const std::string path = folder / ("c/sparse/0/" + std::string(name));
    const std::string whole = test::bytes_of(path);
    for (size_t n = 0; n < whole.size(); n += 3) {
      write_text(path, whole.substr(0, n));
      expect_error(folder / "c", L4D_ERR_CORRUPT, name);
    }
    write_text(path, whole);
  }
  std::string cameras = test::bytes_of(folder / "c/sparse/0/cameras.bin");
  cameras[12] = 9;
  write_text(folder / "c/sparse/0/cameras.bin", cameras);
  expect_error(folder / "c", L4D_ERR_FEATURE_UNSUPPORTED, "model 9");
}

// As COLMAP makes them: of a scene at rest, or of one camera that moves.
TEST(ColmapLayout, PhotosAreOfOneInstantOrOfOneCamera) {
  const Truth truth;
  const test::Folder folder;
  write_colmap(truth, folder / "c", false);
  fs::remove_all(folder / "c/images");
  fs::create_directories(folder / "c/images");
  for (uint32_t c = 0; c < kCameras; ++c) {
    fs::copy_file(truth.image(c, c % kFrames), folder / ("c/images/" + name_of(c) + ".png"));
  }
  CaptureOptions options;
  const Capture rests = read_capture(folder / "c", options);
  EXPECT_EQ(rests.frames, 1U);
  EXPECT_EQ(rests.points.size(), 1U);
  EXPECT_THAT(rests.notes, testing::Contains(HasSubstr("of a scene at rest")));
  options.fps = 25;
  const Capture moves = read_capture(folder / "c", options);
  EXPECT_EQ(moves.frames, kCameras);
  for (const Capture* capture : {&rests, &moves}) {
    ASSERT_EQ(capture->views.size(), kCameras);
    for (uint32_t c = 0; c < kCameras; ++c) {
      const CaptureView& view = capture->views[c];
      EXPECT_EQ(view.camera, c);
      EXPECT_EQ(view.time, capture == &rests ? 0 : c / 25.0);
      EXPECT_THAT(view.file, testing::EndsWith(name_of(c) + ".png"));
      EXPECT_EQ(capture->cameras[c].split, c % 8 == 0 ? "test" : "train");
      EXPECT_NEAR(capture->cameras[c].source.camera.world_to_camera[3],
                  truth.cameras[c].world_to_camera[3], 1e-6);
    }
  }
  // All of it is there at the only instant.
  const ModelState model = start_model(rests, rests.points, {1, 1, 0, 0, 1e30});
  EXPECT_EQ(model.value.mean_t[0], 0);
  EXPECT_NEAR(model.value.log_scale[3], 0, 1e-6);
  fs::remove(folder / "c/images/cam03.png");
  expect_error(folder / "c", L4D_ERR_IO, "camera 3 (cam03.png)");
  options.tolerant = true;
  EXPECT_EQ(read_capture(folder / "c", options).views.size(), kCameras - 1);
}

// As COLMAP makes them of photos.
TEST(ColmapLayout, ModelsOfPartsAreNamed) {
  const Truth truth;
  const test::Folder folder;
  write_colmap(truth, folder / "c", false);
  fs::create_directories(folder / "c/sparse/1");
  EXPECT_THAT(read_capture(folder / "c", {}).notes, testing::Contains(HasSubstr("other models")));
  fs::remove_all(folder / "c/images");
  expect_error(folder / "c", L4D_ERR_IO, "videos/cam00.mp4");
}

}  // namespace
}  // namespace l4d::train
