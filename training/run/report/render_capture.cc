// SPDX-License-Identifier: Apache-2.0
#include "training/run/report/render_capture.h"

#include <algorithm>
#include <atomic>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "io/file/file.h"
#include "io/image/image.h"
#include "io/image/video.h"
#include "l4d/render.hpp"
#include "libl4dcodec/base/threads.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;
using io::Error;

constexpr uint32_t kTestEvery = 8;
constexpr size_t kMostPrepared = 8000000;  // Gaussians of all renderers, some 200 bytes each

Json json_of(const io::Camera& camera, const std::string& name, bool is_video, bool is_test) {
  const l4d_camera& c = camera.camera;
  const double* m = c.world_to_camera;
  Json w2c = Json::array();
  for (size_t r = 0; r < 3; ++r) {
    w2c.push_back({m[4 * r], m[4 * r + 1], m[4 * r + 2], m[4 * r + 3]});
  }
  w2c.push_back({0, 0, 0, 1});
  Json out = {{"id", camera.id},
              {"split", is_test ? "test" : "train"},
              {"K", {{c.fx, 0, c.cx}, {0, c.fy, c.cy}, {0, 0, 1}}},
              {"w2c", w2c}};
  if (is_video) {
    out["video"] = name + ".mp4";
  } else {
    out["images"] = "images/" + name + "/%04d.png";
  }
  return out;
}

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
    l4d_renderer_options rendering;
    l4d_renderer_options_init(&rendering);
    rendering.threads = static_cast<uint32_t>(std::max<size_t>(threads / workers, 1));
    RendererHandle renderer(&rendering);
    renderer.set_gaussians(scene.view(), scene.timeline);
    io::Image image(options.width, options.height);
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

}  // namespace

void render_capture(const std::string& folder, const io::Scene& scene,
                    const RenderCaptureOptions& options) {
  const bool is_video = options.format == "mp4";
  if (!is_video && options.format != "png") {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "--format is " + options.format + "; it must be png or mp4");
  }
  // The pixel format that plays everywhere would give such a video a black row or column, and the
  // capture would be refused.
  if (is_video && (options.width % 2 != 0 || options.height % 2 != 0)) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "--size is " + std::to_string(options.width) + "x" +
                    std::to_string(options.height) +
                    "; width and height of a video are even numbers. Choose others, or "
                    "--format png");
  }
  const uint32_t all = scene.timeline.num_frames;
  const uint32_t first = options.first_frame;
  if (first >= all) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, "--first is " + std::to_string(first) +
                                              ", and the scene has " + std::to_string(all) +
                                              " frames, from 0");
  }
  const uint32_t frames = std::min(options.frames == 0 ? all : options.frames, all - first);
  const double fps = static_cast<double>(scene.timeline.fps_num) / scene.timeline.fps_den;
  const io::CameraSet set =
      io::orbit_cameras(scene, options.cameras, options.width, options.height);
  const fs::path root(folder);
  check_place(root);
  fs::create_directories(root);
  Json cameras = Json::array();
  std::vector<std::string> names;
  std::vector<std::unique_ptr<io::VideoWriter>> videos;
  for (size_t k = 0; k < set.cameras.size(); ++k) {
    names.push_back("cam" + std::string(k < 10 ? "0" : "") + std::to_string(k));
    cameras.push_back(json_of(set.cameras[k], names[k], is_video, k % kTestEvery == 0));
    if (is_video) {
      io::VideoOptions video;
      video.fps = fps;
      video.crf = 14;
      videos.push_back(std::make_unique<io::VideoWriter>((root / (names[k] + ".mp4")).string(),
                                                         options.width, options.height, video));
    } else {
      fs::create_directories(root / "images" / names[k]);
    }
  }
  const auto keep = [&](uint32_t frame, size_t k, const io::Image& image) {
    if (is_video) {
      videos[k]->write(image);
    } else {
      io::write_png(frame_name(root / "images" / names[k], frame), image);
    }
  };
  render_views(scene, set, options, {first, frames, fps}, keep);
  for (const auto& video : videos) video->finish();
  const Json document = {{"fps", fps},
                         {"frames", frames},
                         {"width", options.width},
                         {"height", options.height},
                         {"cameras", cameras}};
  const std::string text = document.dump(1) + "\n";
  io::OutputFile file((root / "cameras.json").string());
  file.write(text.data(), text.size());
  file.commit();
}

}  // namespace l4d::train
