// SPDX-License-Identifier: Apache-2.0
#include "io/camera/colmap.h"

#include <algorithm>
#include <filesystem>
#include <numeric>

#include "io/camera/read_cameras.h"
#include "training/capture/tolerance.h"
#include "training/capture/video_capture.h"

// COLMAP: sparse/0/{cameras,images,points3D}.{bin,txt}, videos/NAME.mp4 or images/NAME/%04d.png
// or .jpg, where NAME is that of the image without its extension; or photos, images/NAME.png.
namespace l4d::train {

namespace {

namespace fs = std::filesystem;

// Photos: each camera has an image of its own, and no folder or video.
bool has_photos(const fs::path& root, const std::vector<std::string>& names,
                const io::CameraSet& set) {
  std::error_code error;
  const auto has_frames = [&](const io::Camera& camera) {
    return !camera.images.empty() || fs::exists(camera.video, error);
  };
  if (std::any_of(set.cameras.begin(), set.cameras.end(), has_frames)) return false;
  return std::any_of(names.begin(), names.end(), [&](const std::string& name) {
    return fs::is_regular_file(root / "images" / name, error);
  });
}

// Of a scene at rest, or, where there is a frame rate, the frames of one camera that moves, in the
// order of their names.
Capture read_photos(const fs::path& root, const std::vector<std::string>& names,
                    const io::CameraSet& set, const CaptureOptions& options) {
  std::vector<size_t> order(names.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::sort(order.begin(), order.end(), [&](size_t a, size_t b) { return names[a] < names[b]; });
  const bool moves = options.fps > 0;
  Capture capture;
  capture.fps = moves ? options.fps : 1;
  LeftOut left_out;
  for (const size_t k : order) {
    const auto index = static_cast<uint32_t>(capture.cameras.size());
    CaptureCamera camera;
    camera.source = set.cameras[k];
    camera.source.id = static_cast<int>(index);
    camera.source.video.clear();
    camera.source.image = (root / "images" / names[k]).string();
    camera.name = "camera " + std::to_string(index) + " (" + names[k] + ")";
    const std::string trouble = trouble_of_image(camera.source.image, camera.source.camera);
    if (!trouble.empty()) {
      if (!options.tolerant) throw io::Error(L4D_ERR_IO, camera.name + ": " + trouble);
      left_out.add(camera.name + ": " + trouble);
      continue;
    }
    CaptureView view;
    view.camera = index;
    view.frame = moves ? index : 0;
    view.time = static_cast<double>(view.frame) / capture.fps;
    view.file = camera.source.image;
    capture.views.push_back(std::move(view));
    capture.cameras.push_back(std::move(camera));
  }
  capture.frames = moves ? static_cast<uint32_t>(capture.views.size()) : 1;
  capture.notes.push_back(moves
                              ? "Photos are the frames of one camera, in the order of their names."
                              : "Photos are of a scene at rest; with --fps they are the frames of "
                                "one camera that moves.");
  left_out.append_to(&capture.notes);
  return capture;
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
  Capture capture = has_photos(root, names, set) ? read_photos(root, names, set, options)
                                                 : make_video_capture(folder, set, options);
  capture.layout = "colmap";
  // COLMAP writes one for each part of the photos that it cannot join.
  if (fs::exists(root / "sparse" / "1", error)) {
    capture.notes.push_back("There are other models beside sparse/0, which are not read.");
  }
  add_colmap_points(model, options, &capture);
  return capture;
}

}  // namespace l4d::train
