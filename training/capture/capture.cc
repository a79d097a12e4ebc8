// SPDX-License-Identifier: Apache-2.0
#include "training/capture/capture.h"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <set>

#include "io/camera/read_cameras.h"
#include "io/image/video.h"
#include "io/scene/scene.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::Error;

constexpr uint32_t kTestEvery = 8;  // cameras, where a layout names none for tests
constexpr size_t kMinViews = 3;
constexpr double kMinFps = 1e-3, kMaxFps = 1e6;
constexpr double kMinSeconds = 1e-3, kMaxSeconds = 1e6;

// "0,10,15" and "0-3".
std::set<int> ids_of(const std::string& text) {
  std::set<int> ids;
  const auto fail = [&] {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "the test cameras are \"" + text +
                    "\"; they must be numbers and ascending ranges: 0,10,15 or 0-3");
  };
  size_t at = 0;
  const auto number = [&]() -> int {
    size_t end = at;
    while (end < text.size() && text[end] >= '0' && text[end] <= '9') ++end;
    if (end == at || end - at > 6) fail();
    const int value = std::stoi(text.substr(at, end - at));
    at = end;
    return value;
  };
  while (at < text.size()) {
    const int first = number();
    int last = first;
    if (at < text.size() && text[at] == '-') {
      ++at;
      last = number();
      if (last < first) fail();
    }
    for (int id = first; id <= last; ++id) ids.insert(id);
    if (at == text.size()) break;
    if (text[at++] != ',') fail();
  }
  return ids;
}

void choose_test_cameras(Capture* capture, const CaptureOptions& options) {
  if (!options.test.empty()) {
    std::set<int> ids = ids_of(options.test);
    for (CaptureCamera& camera : capture->cameras) {
      camera.split = ids.erase(camera.source.id) > 0 ? "test" : "train";
    }
    if (ids.empty()) return;
    throw Error(L4D_ERR_INVALID_ARGUMENT, capture->path + ": there is no camera " +
                                              std::to_string(*ids.begin()) +
                                              ", which is to be a test camera");
  }
  const auto named = [](const CaptureCamera& camera) { return !camera.split.empty(); };
  if (std::any_of(capture->cameras.begin(), capture->cameras.end(), named)) {
    for (CaptureCamera& camera : capture->cameras) {
      if (camera.split != "test") camera.split = "train";
    }
    return;
  }
  for (size_t k = 0; k < capture->cameras.size(); ++k) {
    capture->cameras[k].split = k % kTestEvery == 0 ? "test" : "train";
  }
  capture->notes.push_back(
      "The capture names no test cameras; the first and every 8th after it are.");
}

struct FrameChoice {
  uint32_t first = 0, end = 0, step = 1;
};

// "a:b:step" as numbers without signs; false where the text is something else.
bool parse_frames(const std::string& text, FrameChoice* choice) {
  uint32_t* const numbers[] = {&choice->first, &choice->end, &choice->step};
  size_t count = 0, at = 0;
  while (count < 3) {
    const size_t begin = at;
    uint64_t value = 0;
    for (; at < text.size() && text[at] >= '0' && text[at] <= '9' && value <= UINT32_MAX; ++at) {
      value = 10 * value + static_cast<uint64_t>(text[at] - '0');
    }
    if (at == begin || value > UINT32_MAX) return false;
    *numbers[count++] = static_cast<uint32_t>(value);
    if (at == text.size()) return count >= 2;
    if (text[at++] != ':') return false;
  }
  return false;
}

// Throws where it is no choice, whatever the capture.
FrameChoice choice_of(const std::string& text) {
  FrameChoice choice;
  if (!parse_frames(text, &choice) || choice.first >= choice.end || choice.step == 0) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "the frames are \"" + text +
                    "\"; they must be first:end or first:end:step with first < end");
  }
  return choice;
}

FrameChoice frames_of(const std::string& text, Capture* capture) {
  const uint32_t frames = capture->frames;
  if (text.empty()) return {0, frames, 1};
  FrameChoice choice = choice_of(text);
  if (choice.first >= frames) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "the frames are \"" + text + "\", and the capture has " + std::to_string(frames));
  }
  if (choice.end > frames) {
    capture->notes.push_back("The frames " + text + " end with the capture, which has " +
                             std::to_string(frames) + ".");
    choice.end = frames;
  }
  return choice;
}

// The sequence then begins with the first frame of the choice.
void choose_frames(Capture* capture, const CaptureOptions& options) {
  const FrameChoice choice = frames_of(options.frames, capture);
  // Of the sequence: a camera that drops frames has others there.
  const auto frame_of = [&](const CaptureView& view) {
    const CaptureCamera& camera = capture->cameras[view.camera];
    if (!camera.is_uneven) return view.frame;
    const double own = view.time - camera.source.time_offset;
    return static_cast<uint32_t>(std::max(0.0, std::round(own * capture->fps)));
  };
  const auto left_out = [&](const CaptureView& view) {
    const uint32_t frame = frame_of(view);
    return frame < choice.first || frame >= choice.end || (frame - choice.first) % choice.step != 0;
  };
  auto& views = capture->views;
  views.erase(std::remove_if(views.begin(), views.end(), left_out), views.end());
  const double begin = static_cast<double>(choice.first) / capture->fps;
  for (CaptureView& view : views) view.time = std::max(0.0, view.time - begin);
  for (Point& point : capture->points) point.time -= static_cast<float>(begin);
  capture->frames = choice.end - choice.first;
}

void check(const Capture& capture) {
  size_t training = 0;
  for (const CaptureView& view : capture.views) {
    training += capture.cameras[view.camera].split == "train" ? 1U : 0U;
  }
  if (training < kMinViews) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, capture.path + ": only " + std::to_string(training) +
                                              " images to train on; at least 3 are needed");
  }
}

// Frame rates of files may be anything.
void check_clock(const std::string& path, const Capture& capture) {
  if (!(capture.fps >= kMinFps && capture.fps <= kMaxFps)) {
    throw Error(L4D_ERR_CORRUPT, path + ": the capture has " + std::to_string(capture.fps) +
                                     " frames a second; there must be 0.001 to 1000000");
  }
  if (capture.frames >= 1 && capture.frames <= L4D_MAX_FRAMES) return;
  throw Error(L4D_ERR_CORRUPT, path + ": the sequence has " + std::to_string(capture.frames) +
                                   " frames; there must be 1 to " + std::to_string(L4D_MAX_FRAMES));
}

// Files of some layouts do not state the unit of their times; the others have frames.
void note_times(Capture* capture, const CaptureOptions& options) {
  const bool is_dnerf = capture->layout == "dnerf" || capture->layout == "transforms";
  const bool is_scaled = is_dnerf || (capture->layout == "hypernerf" && options.fps == 0);
  const std::string seconds = "--seconds (" + io::decimal(options.seconds) + ")";
  double last = 0;
  for (const CaptureView& view : capture->views) last = std::max(last, view.time);
  if (is_scaled && last > 0) {
    capture->notes.push_back("Times of images are multiplied by " + seconds +
                             ": the last one is at " + io::decimal(last) +
                             " s, and the sequence lasts " + io::decimal(capture->duration()) +
                             " s.");
  } else if (is_dnerf) {
    capture->notes.push_back("All images are of one instant: no time is above 0.");
  } else if (options.seconds != 1) {
    capture->notes.push_back(seconds +
                             " changes nothing: times are those of frames, of which there are " +
                             io::decimal(capture->fps) + " a second.");
  }
}

bool is_there(const fs::path& path) {
  std::error_code error;
  return fs::exists(path, error);
}

// The files of a folder whose names have a begin and an end; the file itself where it is one.
std::vector<std::string> files_like(const fs::path& place, const std::string& begin,
                                    const std::string& end) {
  const auto is_like = [&](const fs::path& path) {
    const std::string name = path.filename().string();
    return name.size() >= begin.size() + end.size() && name.compare(0, begin.size(), begin) == 0 &&
           name.compare(name.size() - end.size(), end.size(), end) == 0;
  };
  std::vector<std::string> files;
  std::error_code error;
  if (!fs::is_directory(place, error)) {
    if (is_like(place)) files.push_back(place.string());
    return files;
  }
  for (fs::directory_iterator entry(place, error); !error && entry != fs::directory_iterator();
       entry.increment(error)) {
    if (is_like(entry->path())) files.push_back(entry->path().string());
  }
  return files;
}

Capture read_layout(const std::string& path, const CaptureOptions& options) {
  const fs::path place(path);
  std::error_code error;
  if (!is_there(place)) {
    throw Error(L4D_ERR_IO, path + ": cannot open the capture: it does not exist");
  }
  const bool is_folder = fs::is_directory(place, error);
  const auto file = [&](const char* name) { return is_folder ? place / name : place; };
  const auto is = [&](const char* name) {
    return is_folder ? is_there(place / name) : place.filename() == name;
  };
  if (is("cameras.json")) return read_cameras_capture(file("cameras.json").string(), options);
  if (is("poses_bounds.npy")) return read_n3dv_capture(file("poses_bounds.npy").string(), options);
  if (is("transforms_train.json")) {
    return read_dnerf_capture((is_folder ? place : place.parent_path()).string(), options);
  }
  const std::string folder = (is_folder ? place : place.parent_path()).string();
  if (is("intri.yml") || is("extri.yml")) return read_selfcap_capture(folder, options);
  if (is("dataset.json")) return read_hypernerf_capture(folder, options);
  if (is_folder && is_there(place / "sparse" / "0")) return read_colmap_capture(path, options);
  if (is("transforms.json")) return read_dnerf_capture(folder, options);
  if (is("train_meta.json")) return read_dynamic3dgs_capture(folder, options);
  const std::vector<std::string> panoptic = files_like(place, "calibration_", ".json");
  if (panoptic.size() == 1) return read_panoptic_capture(panoptic[0], options);
  std::vector<std::string> tables = files_like(place, "", ".toml");
  // What programs are to do is in files of TOML, too.
  if (is_folder) {
    for (std::string& table : files_like(place / "calibration", "", ".toml")) {
      tables.push_back(std::move(table));
    }
    tables.erase(std::remove_if(tables.begin(), tables.end(),
                                [&](const std::string& table) {
                                  return !is_toml_calibration(table, options.holder);
                                }),
                 tables.end());
  }
  if (tables.size() == 1) return read_toml_capture(tables[0], options);
  // Another name for cameras.json, as `l4dtrain sync -o` writes them; transforms_val.json and its
  // like are parts of a capture.
  const bool is_part = place.filename().string().rfind("transforms", 0) == 0;
  if (!is_folder && place.extension() == ".json" && !is_part) {
    return read_cameras_capture(path, options);
  }
  throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
              path +
                  ": no layout of captures that is known: none of cameras.json, "
                  "poses_bounds.npy, transforms_train.json, transforms.json, intri.yml, "
                  "dataset.json, sparse/0, train_meta.json, one calibration_*.json and one *.toml "
                  "is there");
}

}  // namespace

l4d_timeline Capture::timeline() const {
  l4d_timeline out{};
  io::set_fps(out, fps);
  out.num_frames = frames;
  return out;
}

void check(const CaptureOptions& options) {
  const auto need = [](const char* option, double value, double least, double most) {
    if (value >= least && value <= most) return;
    char text[120];
    std::snprintf(text, sizeof(text), "%s is %g; it must be %g to %g", option, value, least, most);
    throw Error(L4D_ERR_INVALID_ARGUMENT, text);
  };
  if (options.fps != 0) need("--fps", options.fps, kMinFps, kMaxFps);
  need("--seconds", options.seconds, kMinSeconds, kMaxSeconds);
  if (!options.frames.empty()) choice_of(options.frames);
  ids_of(options.test);
}

Capture read_capture(const std::string& path, const CaptureOptions& options) {
  check(options);
  Capture capture = read_layout(path, options);
  check_clock(path, capture);
  note_times(&capture, options);
  capture.path = path;
  choose_test_cameras(&capture, options);
  choose_frames(&capture, options);
  std::stable_sort(capture.views.begin(), capture.views.end(),
                   [](const CaptureView& a, const CaptureView& b) {
                     return a.time != b.time ? a.time < b.time : a.camera < b.camera;
                   });
  check(capture);
  check_place(&capture);
  // Sorting takes a copy of the views.
  uint64_t bytes = 2 * capture.views.capacity() * sizeof(CaptureView) +
                   capture.points.capacity() * sizeof(Point) +
                   capture.cameras.capacity() * sizeof(CaptureCamera);
  for (const CaptureCamera& camera : capture.cameras) {
    bytes += camera.times.capacity() * sizeof(double);
  }
  capture.memory.reset();
  capture.memory = io::hold(options.holder, bytes, path + ": the capture");
  capture.holder = options.holder;
  return capture;
}

}  // namespace l4d::train
