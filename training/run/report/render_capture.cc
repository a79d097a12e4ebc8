// SPDX-License-Identifier: Apache-2.0
#include "training/run/report/render_capture.h"

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <memory>

#include "io/camera/write_cameras.h"
#include "io/image/image.h"
#include "io/image/video.h"
#include "l4d/render.hpp"
#include "libl4dcodec/base/threads.h"
#include "training/run/report/capture_points.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::Error;

constexpr size_t kMostPrepared = 8000000;  // Gaussians of all renderers, some 200 bytes each

// A capture replaces nothing: neither another one, nor images that lie where its own would.
void check_place(const fs::path& root) {
  const auto fail = [&](const std::string& what) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, root.string() + ": " + what);
  };
  const std::string other = "; choose another folder";
  if (!fs::exists(root)) return;
  if (!fs::is_directory(root)) fail("a capture is a folder, and there is a file of this name");
  if (fs::exists(root / "cameras.json")) fail("there is already cameras.json" + other);
  for (const fs::directory_entry& entry : fs::directory_iterator(root)) {
    const std::string name = entry.path().filename().string();
    const bool is_video = name.rfind("cam", 0) == 0 && entry.path().extension() == ".mp4";
    if (name == "images" || is_video) fail("there is already " + name + other);
  }
}

std::string frame_name(const fs::path& folder, uint32_t frame) {
  char name[24];
  std::snprintf(name, sizeof(name), "%04u.png", frame);
  return (folder / name).string();
}

struct FrameRange {
  uint32_t first, count;
  double fps;
};

// Several views at a time: small images, their compression and files leave most threads of a single
// renderer idle. Each worker has a renderer, and renders all cameras of its frames, which share the
// slice of an instant; or, for videos, all frames of its cameras in order.
// keep(frame, camera, image): called on any thread, where frames count from 0.
template <typename Keep>
void render_views(const io::Scene& scene, const io::CameraSet& set,
                  const RenderCaptureOptions& options, const FrameRange& frames, const Keep& keep) {
  const bool by_camera = options.format == "mp4";
  const size_t threads = static_cast<size_t>(resolve_threads(static_cast<int>(options.threads)));
  const size_t parts = by_camera ? set.cameras.size() : frames.count;
  const size_t fit = std::max<size_t>(kMostPrepared / std::max<size_t>(scene.view().count, 1), 1);
  const size_t workers = std::min({threads, parts, fit});
  std::atomic<bool> stop{false};
  const auto work = [&](size_t worker, size_t) {
    l4d_renderer_options rendering = L4D_INIT(l4d_renderer_options);
    rendering.threads = static_cast<uint32_t>(std::max<size_t>(threads / workers, 1));
    RendererHandle renderer(&rendering);
    renderer.set_gaussians(scene.view(), scene.timeline);
    io::Image image(set.cameras[0].camera.width, set.cameras[0].camera.height);
    for (uint32_t frame = 0; frame < frames.count; ++frame) {
      if (!by_camera && frame % workers != worker) continue;
      renderer.set_time(scene.timeline.time_begin + (frames.first + frame) / frames.fps);
      for (size_t k = 0; k < set.cameras.size() && !stop; ++k) {
        if (by_camera && k % workers != worker) continue;
        renderer.render(set.cameras[k].camera, image.rgb.data());
        keep(frame, k, image);
      }
      if (stop) return;
    }
  };
  parallel_for(static_cast<int>(workers), workers, 1, [&](size_t worker, size_t end) {
    try {
      work(worker, end);
    } catch (...) {
      stop = true;
      throw;
    }
  });
}

// Images are those of pinholes, of which each takes all frames when they begin: the capture may say
// nothing else of them.
void leave_out(io::CameraSet* set, std::vector<std::string>* notes) {
  notes->insert(notes->end(), set->notes.begin(), set->notes.end());
  size_t distorted = 0, late = 0, timed = 0;
  for (io::Camera& camera : set->cameras) {
    distorted += camera.distortion.model != io::Distortion::Model::kNone ? 1U : 0U;
    late += camera.time_offset != 0 ? 1U : 0U;
    timed += camera.time ? 1U : 0U;
    camera.distortion = {};
    camera.time_offset = 0;
    camera.time.reset();
  }
  const auto note = [&](size_t count, const char* what) {
    if (count > 0) notes->push_back(what + std::to_string(count) + ".");
  };
  note(distorted, "Cameras whose lens distorts, which is left out, as images are of pinholes: ");
  note(late, "Cameras with a time_offset, which is left out: ");
  note(timed, "Cameras with a time, in place of which they take all frames: ");
}

io::CameraSet cameras_of(const io::Scene& scene, const RenderCaptureOptions& options,
                         std::vector<std::string>* notes) {
  if (options.camera_file.empty()) {
    io::CameraSet set = io::orbit_cameras(scene, options.cameras, options.width, options.height);
    io::split_for_tests(set);
    return set;
  }
  io::CameraSet set = io::read_cameras(options.camera_file);
  leave_out(&set, notes);
  const auto has_split = [](const io::Camera& camera) { return !camera.split.empty(); };
  if (std::none_of(set.cameras.begin(), set.cameras.end(), has_split)) io::split_for_tests(set);
  return set;
}

void check_size(const io::CameraSet& set, const RenderCaptureOptions& options) {
  const l4d_camera& size = set.cameras[0].camera;
  for (const io::Camera& camera : set.cameras) {
    if (camera.camera.width == size.width && camera.camera.height == size.height) continue;
    throw Error(L4D_ERR_INVALID_ARGUMENT, options.camera_file + ": the images of cameras " +
                                              std::to_string(set.cameras[0].id) + " and " +
                                              std::to_string(camera.id) +
                                              " have different sizes; a capture has one");
  }
  // The pixel format that plays everywhere would give such a video a black row or column, and the
  // capture would be refused.
  if (options.format == "mp4" && (size.width % 2 != 0 || size.height % 2 != 0)) {
    throw Error(
        L4D_ERR_INVALID_ARGUMENT,
        (options.camera_file.empty() ? "--size is " : options.camera_file + ": the size is ") +
            std::to_string(size.width) + "x" + std::to_string(size.height) +
            "; width and height of a video are even numbers. Choose others, or "
            "--format png");
  }
}

}  // namespace

uint32_t render_capture(const std::string& folder, const io::Scene& scene,
                        const RenderCaptureOptions& options, std::vector<std::string>* notes) {
  const bool is_video = options.format == "mp4";
  if (!is_video && options.format != "png") {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "--format is " + options.format + "; it must be png or mp4");
  }
  const uint32_t all = scene.timeline.num_frames;
  const uint32_t first = options.first_frame;
  if (first >= all) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "--first is " + std::to_string(first) +
                                              ", and the scene has " + std::to_string(all) +
                                              " frames, from 0");
  }
  const double fps = static_cast<double>(scene.timeline.fps_num) / scene.timeline.fps_den;
  std::vector<std::string> said;
  io::CameraSet set = cameras_of(scene, options, notes != nullptr ? notes : &said);
  set.fps = fps;
  set.frames = std::min(options.frames == 0 ? all : options.frames, all - first);
  const l4d_camera size = set.cameras[0].camera;
  check_size(set, options);
  const fs::path root(folder);
  check_place(root);
  fs::create_directories(root);
  std::vector<std::string> folders;
  std::vector<std::unique_ptr<io::VideoWriter>> videos;
  for (size_t k = 0; k < set.cameras.size(); ++k) {
    const std::string name = "cam" + std::string(k < 10 ? "0" : "") + std::to_string(k);
    io::Camera& camera = set.cameras[k];
    folders.push_back((root / "images" / name).string());
    camera.mask = camera.video = camera.images = "";
    if (is_video) {
      io::VideoOptions video;
      video.fps = fps;
      video.crf = 14;
      camera.video = (root / (name + ".mp4")).string();
      videos.push_back(
          std::make_unique<io::VideoWriter>(camera.video, size.width, size.height, video));
    } else {
      camera.images = folders[k] + "/%04d.png";
      fs::create_directories(folders[k]);
    }
  }
  const auto keep = [&](uint32_t frame, size_t k, const io::Image& image) {
    if (is_video) {
      videos[k]->write(image);
    } else {
      io::write_png(frame_name(folders[k], frame), image);
    }
  };
  render_views(scene, set, options, {first, set.frames, fps}, keep);
  for (const auto& video : videos) video->finish();
  if (options.points > 0) {
    write_capture_points((root / "points.ply").string(), scene, set, options.points,
                         scene.timeline.time_begin + first / fps, set.frames / fps / 2,
                         options.threads);
  }
  io::write_cameras((root / "cameras.json").string(), set);
  return static_cast<uint32_t>(set.cameras.size());
}

}  // namespace l4d::train
