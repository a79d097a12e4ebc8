// SPDX-License-Identifier: Apache-2.0
#include "io/camera/colmap.h"

#include <algorithm>
#include <filesystem>

#include "io/camera/read_cameras.h"
#include "training/capture/video_capture.h"

// COLMAP: sparse/0/{cameras,images,points3D}.{bin,txt}, videos/NAME.mp4 or images/NAME/%04d.png
// or .jpg, where NAME is that of the image without its extension.
namespace l4d::train {

namespace {

namespace fs = std::filesystem;

// Models of photos are common, and have one instant: none of their images is a folder or a video.
void check_time(const fs::path& root, const std::vector<std::string>& names,
                const io::CameraSet& set) {
  std::error_code error;
  const auto has_frames = [&](const io::Camera& camera) {
    return !camera.images.empty() || fs::exists(camera.video, error);
  };
  if (std::any_of(set.cameras.begin(), set.cameras.end(), has_frames)) return;
  for (const std::string& name : names) {
    const fs::path photo = root / "images" / name;
    if (!fs::is_regular_file(photo, error)) continue;
    const std::string stem = fs::path(name).replace_extension("").string();
    throw io::Error(L4D_ERR_FEATURE_UNSUPPORTED,
                    root.string() + ": a COLMAP model of one instant: " + photo.string() +
                        " is the only image of its camera. What the camera of " + name +
                        " saw over time is expected in videos/" + stem + ".mp4 or images/" + stem +
                        "/0000.png and so on; photos of a scene at rest are read from a "
                        "transforms.json");
  }
}

}  // namespace

void add_colmap_points(const std::string& model, const CaptureOptions& options, Capture* capture) {
  for (const io::ColmapPoint& p : io::read_colmap_points(model, options.holder)) {
    Point point{};
    std::copy_n(p.position, 3, point.position);
    std::copy_n(p.rgb, 3, point.rgb);
    capture->points.push_back(point);
  }
}

Capture read_colmap_capture(const std::string& folder, const CaptureOptions& options) {
  const fs::path root(folder);
  const std::string model = (root / "sparse" / "0").string();
  std::vector<std::string> names;
  io::CameraSet set = io::read_colmap_cameras(model, &names, options.holder);
  std::error_code error;
  for (size_t k = 0; k < names.size(); ++k) {
    io::Camera& camera = set.cameras[k];
    if (io::leaves_folder(names[k])) {
      io::CameraPlace{model, "image " + names[k]}.fail("its name leaves the folder");
    }
    const std::string stem = fs::path(names[k]).replace_extension("").string();
    if (fs::is_directory(root / "images" / stem, error)) {
      camera.images = numbered_images_in(root / "images" / stem);
    } else {
      camera.video = (root / "videos" / (stem + ".mp4")).string();
    }
  }
  check_time(root, names, set);
  Capture capture = make_video_capture(folder, set, options);
  capture.layout = "colmap";
  // COLMAP writes one for each part of the photos that it cannot join.
  if (fs::exists(root / "sparse" / "1", error)) {
    capture.notes.push_back("There are other models beside sparse/0, which are not read.");
  }
  add_colmap_points(model, options, &capture);
  return capture;
}

}  // namespace l4d::train
