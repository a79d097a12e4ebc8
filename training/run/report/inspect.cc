// SPDX-License-Identifier: Apache-2.0
#include "training/run/report/inspect.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>

#include "io/file/file.h"
#include "training/capture/tolerance.h"
#include "training/images/frame_cache.h"
#include "training/images/loader.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr size_t kColumns = 6, kMaxCameras = 48, kMaxDecoded = 256;
constexpr uint32_t kWidth = 200;  // pixels of an image in the sheet

bool is_png(const fs::path& path) {
  std::string ending = path.extension().string();
  for (char& c : ending) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  return ending == ".png";
}

// What the capture was read from: its images and videos, also those of frames that are not chosen,
// and what else lies in its folder but sheets.
std::vector<std::string> files_of(const std::string& path, CaptureOptions options) {
  options.frames.clear();
  const Capture capture = read_capture(path, options);
  std::vector<std::string> files = {path};
  for (const CaptureCamera& camera : capture.cameras) {
    files.push_back(camera.source.video);
    files.push_back(camera.source.mask);
  }
  for (const CaptureView& view : capture.views) files.push_back(view.file);
  const fs::path folder = fs::is_directory(path) ? fs::path(path) : fs::path(path).parent_path();
  std::error_code error;
  fs::recursive_directory_iterator entry(folder.empty() ? "." : folder,
                                         fs::directory_options::skip_permission_denied, error);
  for (; !error && entry != fs::recursive_directory_iterator(); entry.increment(error)) {
    if (!is_png(entry->path())) files.push_back(entry->path().string());
  }
  return files;
}

// A sheet replaces what has its name, unless the capture is read from that.
void check_sheet(const std::string& sheet, const std::string& path, const CaptureOptions& options) {
  const auto fail = [&](const char* what) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT, sheet + ": --sheet " + what);
  };
  if (!is_png(sheet)) fail("is a PNG; its name must end with .png");
  std::error_code error;
  if (!fs::exists(sheet, error)) return;
  const std::optional<io::FileId> target = io::identify(sheet);
  if (!target) fail("must be a file");
  for (const std::string& file : files_of(path, options)) {
    const std::optional<io::FileId> id = file.empty() ? std::nullopt : io::identify(file);
    if (id && !(*id < *target) && !(*target < *id)) fail("is a file of the capture");
  }
}

// The first image of each camera, small, by camera: what of a capture cannot be decoded is found
// so, whatever its first bytes say. Of captures with a camera for each image, of many.
std::map<uint32_t, Pixels> first_images(const Capture& capture, uint32_t threads) {
  std::map<uint32_t, uint32_t> first;  // view by camera
  for (uint32_t k = 0; k < capture.views.size(); ++k) first.emplace(capture.views[k].camera, k);
  std::vector<uint32_t> views;
  for (const auto& [camera, view] : first) {
    if (views.size() < kMaxDecoded) views.push_back(view);
  }
  const l4d_camera& camera = capture.cameras[0].source.camera;
  const ImageLoader loader(capture, std::min(1.0, static_cast<double>(kWidth) / camera.width));
  std::map<uint32_t, Pixels> images;
  std::mutex mutex;
  loader.load(views, threads, [&](uint32_t view, Pixels pixels) {
    const std::lock_guard<std::mutex> lock(mutex);
    images[capture.views[view].camera] = std::move(pixels);
  });
  return images;
}

// The images of up to kMaxCameras cameras, in rows.
void write_sheet(const std::string& path, const std::map<uint32_t, Pixels>& images) {
  std::vector<uint32_t> cameras;
  for (const auto& [camera, pixels] : images) {
    if (cameras.size() < kMaxCameras) cameras.push_back(camera);
  }
  uint32_t width = 1, height = 1;
  for (const auto& [camera, pixels] : images) {
    width = std::max(width, pixels.width);
    height = std::max(height, pixels.height);
  }
  const size_t columns = std::min(kColumns, cameras.size());
  const size_t rows = (cameras.size() + columns - 1) / columns;
  io::Image sheet(static_cast<uint32_t>(columns * width), static_cast<uint32_t>(rows * height));
  constexpr Colour kGrey = {0.5F, 0.5F, 0.5F};
  for (size_t k = 0; k < cameras.size(); ++k) {
    const io::Image image = image_of(images.at(cameras[k]), kGrey);
    const size_t left = k % columns * width, top = k / columns * height;
    for (size_t y = 0; y < image.height; ++y) {
      std::copy_n(&image.rgb[3 * y * image.width], 3 * image.width,
                  &sheet.rgb[3 * ((top + y) * sheet.width + left)]);
    }
  }
  io::write_png(path, sheet);
}

// What a cache has of a capture, as lines of the text too.
Json list_cache(const std::string& folder, const Capture& capture, std::string* text) {
  Json out = Json::array();
  if (folder.empty()) return out;
  for (const FrameCache::Content& content : FrameCache::list(folder, capture)) {
    char line[80];
    std::snprintf(line, sizeof(line), "cache      scale %.6g: %.1f MB\n", content.scale,
                  static_cast<double>(content.bytes) / 1e6);
    *text += line;
    out.push_back({{"scale", content.scale}, {"bytes", content.bytes}});
  }
  if (out.empty()) *text += "cache      none of this capture\n";
  return out;
}

}  // namespace

Inspection inspect(const std::string& path, const CaptureOptions& options, const std::string& sheet,
                   const std::string& cache, uint32_t threads) {
  if (!sheet.empty()) check_sheet(sheet, path, options);
  const Capture capture = read_capture(path, options);
  check_image_files(capture);
  const std::map<uint32_t, Pixels> images = first_images(capture, threads);
  const CaptureFrame frame = frame_of(capture);
  size_t training = 0, tests = 0, videos = 0, distorted = 0;
  for (const CaptureView& view : capture.views) {
    ++(capture.cameras[view.camera].split == "train" ? training : tests);
  }
  Json cameras = Json::array();
  std::string test_names;
  for (const CaptureCamera& camera : capture.cameras) {
    const l4d_camera& c = camera.source.camera;
    const bool is_distorted = camera.source.distortion.model != io::Distortion::Model::kNone;
    videos += camera.is_video() ? 1U : 0U;
    distorted += is_distorted ? 1U : 0U;
    if (camera.split == "test") test_names += " " + std::to_string(camera.source.id);
    cameras.push_back({{"id", camera.source.id},
                       {"split", camera.split},
                       {"width", c.width},
                       {"height", c.height},
                       {"fx", c.fx},
                       {"fy", c.fy},
                       {"video", camera.source.video},
                       {"time_offset", camera.source.time_offset},
                       {"distorted", is_distorted}});
  }
  if (!sheet.empty()) write_sheet(sheet, images);
  char text[600];
  const l4d_camera& first = capture.cameras[0].source.camera;
  std::snprintf(text, sizeof(text),
                "layout     %s\n"
                "cameras    %zu, of which %zu have a video and %zu a distorted lens\n"
                "images     %zu for training, %zu for tests; %u x %u pixels\n"
                "sequence   %u frames at %g a second: %.3f s\n"
                "size       radius %.4g around (%.4g, %.4g, %.4g), scene units\n"
                "points     %zu%s\n",
                capture.layout.c_str(), capture.cameras.size(), videos, distorted, training, tests,
                first.width, first.height, capture.frames, capture.fps, capture.duration(),
                frame.radius, frame.center[0], frame.center[1], frame.center[2],
                capture.points.size(), capture.points_file.empty() ? "" : ", and those of a file");
  Inspection result;
  result.text = text;
  result.text += "test       cameras" + (test_names.empty() ? " none" : test_names) + "\n";
  const Json cached = list_cache(cache, capture, &result.text);
  for (const std::string& note : capture.notes) result.text += "note       " + note + "\n";
  const Json json = {{"schema", "l4dtrain.inspect/1"},
                     {"layout", capture.layout},
                     {"fps", capture.fps},
                     {"frames", capture.frames},
                     {"duration_s", capture.duration()},
                     {"training_images", training},
                     {"test_images", tests},
                     {"radius", frame.radius},
                     {"center", {frame.center[0], frame.center[1], frame.center[2]}},
                     {"points", capture.points.size()},
                     {"cache", cached},
                     {"cameras", cameras},
                     {"notes", capture.notes}};
  result.json = json.dump(1);
  return result;
}

}  // namespace l4d::train
