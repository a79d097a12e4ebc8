// SPDX-License-Identifier: Apache-2.0
#include "training/capture/video_capture.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <set>

#include "io/image/image.h"
#include "io/image/video.h"
#include "io/scene/statements.h"
#include "training/capture/tolerance.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::Error;

std::string name_of(const io::Camera& camera) { return "camera " + std::to_string(camera.id); }

[[noreturn]] void fail(l4d_status status, const std::string& path, const io::Camera& camera,
                       const std::string& what) {
  throw Error(status, path + ": " + name_of(camera) + ": " + what);
}

// The names of the files in a folder; nothing if it cannot be read.
std::set<std::string> files_in(const fs::path& folder) {
  std::set<std::string> names;
  std::error_code error;
  fs::directory_iterator entry(folder.empty() ? "." : folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    std::error_code unknown;
    if (entry->is_regular_file(unknown)) names.insert(entry->path().filename().string());
  }
  return names;
}

// Images up to the first that is missing or, if tolerant, not whole; `trouble` says what it has.
// Folders are listed, which takes less time than a question for each of thousands of images.
uint32_t count_images(const io::Camera& camera, uint32_t most, bool tolerant,
                      std::string* trouble) {
  std::error_code error;
  fs::path folder;
  std::set<std::string> names;
  for (uint32_t n = 0; n < most; ++n) {
    const std::string path = io::numbered_image(camera, n);
    const fs::path parent = fs::path(path).parent_path();
    if (n == 0 || parent != folder) {
      folder = parent;
      names = files_in(folder);
    }
    // A folder that may not be listed may still be read.
    if (names.count(fs::path(path).filename().string()) == 0 && !fs::is_regular_file(path, error)) {
      *trouble = "cannot open " + path;
      return n;
    }
    if (tolerant) *trouble = trouble_of_image(path, camera.camera);
    if (!trouble->empty()) return n;
  }
  return most;
}

// What only decoding finds would else end the training later.
void decode_all(const std::string& path, const io::Camera& camera, uint32_t frames) {
  try {
    io::decode_video(camera.video, camera.camera.width, camera.camera.height, frames);
  } catch (const Error& error) {
    fail(error.status(), path, camera, error.what());
  }
}

// How far a frame may be from where a steady rate has it, in frames.
constexpr double kSteady = 0.25;
// Of two rates that are taken for one: 29.97 stands beside 30 for the same frames.
constexpr double kSameRate = 0.01;

bool is_same_rate(double a, double b) { return std::abs(a - b) <= kSameRate * b; }

// Finds the frames of a camera, their rate and times, and what ends it; checks what needs no
// decoding.
void call_on(const std::string& path, const io::CameraSet& set, bool tolerant, CaptureCamera* out,
             std::string* end) {
  const io::Camera& camera = out->source;
  const uint32_t most = set.frames != 0 ? set.frames : UINT32_MAX;
  if (tolerant && !camera.mask.empty()) {
    const std::string trouble = trouble_of_image(camera.mask, camera.camera);
    if (!trouble.empty()) fail(L4D_ERR_IO, path, camera, "its mask: " + trouble);
  }
  if (!camera.images.empty()) {
    out->frames = count_images(camera, most, tolerant, end);
    if (tolerant && out->frames == 0) fail(L4D_ERR_IO, path, camera, *end);
    return;
  }
  if (camera.video.empty()) {
    fail(L4D_ERR_CORRUPT, path, camera, "it has neither a video nor images");
  }
  io::VideoFacts facts;
  try {
    facts = io::probe_video(camera.video, camera.camera.width, camera.camera.height);
  } catch (const Error& error) {
    fail(error.status(), path, camera, error.what());
  }
  if (!io::has_size(camera.video, facts, camera.camera.width, camera.camera.height)) {
    fail(L4D_ERR_CORRUPT, path, camera,
         camera.video + " has " + std::to_string(facts.width) + " x " +
             std::to_string(facts.height) + " pixels, and the camera has " +
             std::to_string(camera.camera.width) + " x " + std::to_string(camera.camera.height));
  }
  if (tolerant && facts.frames == 0) {
    fail(L4D_ERR_IO, path, camera, camera.video + " has no frames");
  }
  if (tolerant) decode_all(path, camera, facts.frames);
  *end = camera.video + " has " + std::to_string(facts.frames) + " frames";
  out->frames = facts.frames;
  out->fps = facts.fps;
  out->times = std::move(facts.times);
}

// Frames of a video at another rate have its times, unless no video has that of the capture: then
// one of the two is wrong.
void check_rate(const std::string& path, double fps, const std::vector<CaptureCamera>& cameras) {
  const auto contradicts = [fps](const CaptureCamera& camera) {
    return camera.fps > 0 && !is_same_rate(camera.fps, fps);
  };
  if (!(fps > 0) || !std::all_of(cameras.begin(), cameras.end(), contradicts)) return;
  const CaptureCamera& camera = cameras.front();
  fail(L4D_ERR_CORRUPT, path, camera.source,
       camera.source.video + " has " + io::text_of_number(camera.fps) +
           " frames a second, and the capture " + io::text_of_number(fps) +
           ": they are not synchronised");
}

// The frames of the sequence that a camera reaches, at `rate` frames a second by its own clock.
// Notes where its times count.
uint32_t frames_reached(double rate, CaptureCamera* camera, std::vector<std::string>* notes) {
  const std::vector<double>& times = camera->times;
  const double own = is_same_rate(camera->fps, rate) ? camera->fps : rate;
  size_t frame = 0;
  camera->is_uneven = !io::is_steady(times, own, kSteady, &frame);
  if (!camera->is_uneven) return camera->frames;
  notes->push_back("Frames of " + camera->name + " come at uneven times, which count: frame " +
                   std::to_string(frame) + " at " + io::text_of_number(times[frame]) +
                   " s, where " + io::text_of_number(rate) + " frames a second have it at " +
                   io::text_of_number(static_cast<double>(frame) / rate) + " s.");
  return static_cast<uint32_t>(std::min(std::round(times.back() * rate) + 1, double{UINT32_MAX}));
}

// The views of all frames of the sequence but those that a camera took before it begins, or after
// its end. rate: frames a second by the clocks of the cameras.
void add_views(const std::string& path, double rate, Capture* capture) {
  std::vector<uint32_t> outside(capture->cameras.size());
  const double half_a_frame = 0.5 / capture->fps;
  for (uint32_t c = 0; c < capture->cameras.size(); ++c) {
    const CaptureCamera& camera = capture->cameras[c];
    const io::Camera& source = camera.source;
    for (uint32_t frame = 0; frame < camera.frames; ++frame) {
      const double place =
          camera.is_uneven ? camera.times[frame] * rate : static_cast<double>(frame);
      if (std::round(place) >= capture->frames) break;
      CaptureView view{c, frame, place / capture->fps + source.time_offset, ""};
      if (view.time < -half_a_frame || view.time > capture->duration() + half_a_frame) {
        ++outside[c];
        continue;
      }
      view.time = std::clamp(view.time, 0.0, capture->duration());
      if (!source.images.empty()) view.file = io::numbered_image(source, frame);
      capture->views.push_back(std::move(view));
    }
  }
  for (size_t c = 0; c < outside.size(); ++c) {
    if (outside[c] == 0) continue;
    const io::Camera& source = capture->cameras[c].source;
    const std::string offset =
        "by its time_offset of " + io::text_of_number(source.time_offset) + " s ";
    if (!std::any_of(capture->views.begin(), capture->views.end(),
                     [c](const CaptureView& view) { return view.camera == c; })) {
      fail(L4D_ERR_CORRUPT, path, source, offset + "no frame of it lies in the sequence");
    }
    capture->notes.push_back("Of " + capture->cameras[c].name + ", " + std::to_string(outside[c]) +
                             " frames are left out: " + offset +
                             "they were not taken in the sequence.");
  }
}

// One of two cameras that have the same images has a wrong place.
void note_shared_images(const std::vector<CaptureCamera>& cameras,
                        std::vector<std::string>* notes) {
  std::map<std::string, const CaptureCamera*> first;
  for (const CaptureCamera& camera : cameras) {
    const io::Camera& source = camera.source;
    const std::string& images = source.images.empty() ? source.video : source.images;
    const auto [at, is_new] = first.emplace(fs::path(images).lexically_normal().string(), &camera);
    if (is_new) continue;
    notes->push_back(at->second->name + " and " + camera.name + " have the same images: " + images +
                     ".");
    return;
  }
}

}  // namespace

Capture make_video_capture(const std::string& path, io::CameraSet set,
                           const CaptureOptions& options) {
  io::find_first_images(&set);
  Capture capture;
  capture.notes = set.notes;
  LeftOut left_out;
  std::vector<std::string> ends;  // by camera
  for (const io::Camera& source : set.cameras) {
    CaptureCamera camera;
    camera.source = source;
    camera.name = name_of(source);
    camera.split = source.split;
    std::string end;
    try {
      call_on(path, set, options.tolerant, &camera, &end);
    } catch (const Error& error) {
      if (!options.tolerant) throw;
      left_out.add(error.what());
      continue;
    }
    capture.cameras.push_back(std::move(camera));
    ends.push_back(end);
  }
  left_out.append_to(&capture.notes);
  note_shared_images(capture.cameras, &capture.notes);
  if (capture.cameras.empty()) throw Error(L4D_ERR_INVALID_ARGUMENT, path + ": no camera is left");
  check_rate(path, set.fps, capture.cameras);
  double rate = set.fps;
  for (const CaptureCamera& camera : capture.cameras) {
    if (!(rate > 0)) rate = camera.fps;
  }
  if (!(rate > 0)) {
    rate = options.fps > 0 ? options.fps : 30;
    if (!(options.fps > 0)) {
      capture.notes.push_back("Nothing tells the frame rate; it is taken to be 30.");
    }
  }
  capture.fps = options.fps > 0 ? options.fps : rate;
  uint32_t shortest = UINT32_MAX, longest = 0;
  const CaptureCamera* short_one = nullptr;
  for (CaptureCamera& camera : capture.cameras) {
    const uint32_t reached = frames_reached(rate, &camera, &capture.notes);
    if (reached < shortest) {
      shortest = reached;
      short_one = &camera;
    }
    longest = std::max(longest, reached);
  }
  const uint32_t wanted = set.frames != 0 ? set.frames : longest;
  if (shortest < wanted) {
    const auto index = static_cast<size_t>(short_one - capture.cameras.data());
    const std::string what = "its images end before frame " + std::to_string(shortest) + " of " +
                             std::to_string(wanted) + ": " + ends[index];
    if (!options.tolerant || shortest == 0) fail(L4D_ERR_IO, path, short_one->source, what);
    capture.notes.push_back("All cameras are cut to " + std::to_string(shortest) + " frames: of " +
                            short_one->name + ", " + what + ".");
  }
  capture.frames = std::min(shortest, wanted);
  // Twice, for a list that grows, with the path of an image.
  constexpr uint64_t kPathBytes = 128;
  uint64_t bytes = 0;
  for (const CaptureCamera& camera : capture.cameras) {
    const uint64_t images = camera.is_uneven ? camera.frames : capture.frames;
    bytes += 2 * images * (sizeof(CaptureView) + kPathBytes) + camera.times.size() * sizeof(double);
  }
  capture.memory = io::hold(options.holder, bytes, path + ": the list of its images");
  add_views(path, rate, &capture);
  return capture;
}

std::string numbered_images_in(const fs::path& folder) {
  const std::set<std::string> names = files_in(folder);
  for (const char* ending : io::kImageExtensions) {  // PNG before what may be a copy of it
    for (const std::string& name : names) {
      const std::string stem = fs::path(name).stem().string();
      if (stem.empty() || stem.find_first_not_of("0123456789") != std::string::npos) continue;
      if (fs::path(name).extension() != ending) continue;
      return (folder / ("%0" + std::to_string(stem.size()) + "d" + ending)).string();
    }
  }
  return (folder / "%04d.png").string();
}

Capture read_cameras_capture(const std::string& file, const CaptureOptions& options) {
  const io::CameraSet set = io::read_cameras(file, options.any_path, options.holder);
  for (const io::Camera& camera : set.cameras) {
    io::require_inside(set, camera);
    const std::string& split = camera.split;
    if (!options.test.empty() || split.empty() || split == "train" || split == "test") continue;
    fail(L4D_ERR_CORRUPT, file, camera,
         "its split is \"" + split +
             "\"; it must be train or test, or --test names all test cameras");
  }
  Capture capture = make_video_capture(file, set, options);
  capture.layout = "cameras";
  const fs::path model = fs::path(file).parent_path() / "sparse" / "0";
  add_colmap_points(model.string(), options, &capture);
  return capture;
}

Capture read_n3dv_capture(const std::string& file, const CaptureOptions& options) {
  io::CameraSet set = io::read_cameras(file, options.any_path, options.holder);
  const auto is_zero = [](const io::Camera& camera) {
    return fs::path(camera.video).stem() == "cam00";
  };
  const bool has_zero = std::any_of(set.cameras.begin(), set.cameras.end(), is_zero);
  // Which camera tests follows from the names of videos and the options, not from the file.
  auto& notes = set.notes;
  const auto names_test = [](const std::string& note) {
    return note.rfind("Camera 0 is for testing", 0) == 0;
  };
  notes.erase(std::remove_if(notes.begin(), notes.end(), names_test), notes.end());
  for (io::Camera& camera : set.cameras) {
    // Rows and videos pair by their order alone, so that no row can do without its video.
    if (camera.video.empty()) {
      throw Error(L4D_ERR_IO, file + ": it has " + std::to_string(set.cameras.size()) +
                                  " cameras, and its folder another number of videos; videos in "
                                  "the order of their names pair with cameras. An empty file under "
                                  "the name of a video that is missing keeps its place, and "
                                  "--tolerant then leaves out its camera");
    }
    const bool is_test = has_zero ? is_zero(camera) : &camera == &set.cameras.front();
    camera.split = is_test ? "test" : "train";
    if (!is_test || !options.test.empty()) continue;
    notes.push_back("Camera " + std::to_string(camera.id) +
                    " is for testing and all others are for training, as is usual.");
  }
  Capture capture = make_video_capture(file, set, options);
  capture.layout = "n3dv";
  return capture;
}

}  // namespace l4d::train
