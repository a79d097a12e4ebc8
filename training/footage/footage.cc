// SPDX-License-Identifier: Apache-2.0
#include "training/footage/footage.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

#include "io/camera/colmap.h"
#include "io/camera/write_cameras.h"
#include "io/image/image.h"
#include "io/image/video.h"
#include "training/footage/program.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::Error;

constexpr const char* kNoColmap =
    "places of cameras need the program colmap, which is not there: install colmap, or give a "
    "capture with places (training/README.md)";

constexpr size_t kLeastCameras = 3;

struct Clip {
  fs::path path;
  std::string name;
  uint32_t width = 0, height = 0;  // as players show it
  io::VideoFacts facts;
};

// The frame in the middle, at the size that players show: turned ones have width and height
// exchanged.
io::Image middle_of(Clip* clip) {
  const io::VideoFacts& facts = clip->facts;
  io::VideoRange range;
  range.is_video = true;
  range.first = facts.frames / 2;
  if (range.first > 0) {
    if (facts.times.size() <= range.first && !(facts.fps > 0)) {
      throw Error(L4D_ERR_CORRUPT, clip->path.string() + ": nothing says when its frames come");
    }
    range.seek = facts.times.size() > range.first
                     ? (facts.times[range.first - 1] + facts.times[range.first]) / 2
                     : (range.first - 0.5) / facts.fps;
  }
  const auto read = [&](uint32_t width, uint32_t height) {
    io::VideoReader reader(clip->path.string(), width, height, range);
    io::Image image;
    reader.read(range.first, &image);
    clip->width = width;
    clip->height = height;
    return image;
  };
  if (facts.width != facts.height) {
    try {
      return read(facts.height, facts.width);
    } catch (const Error& error) {
      if (error.status() != L4D_ERR_CORRUPT) throw;  // it is not turned
    }
  }
  return read(facts.width, facts.height);
}

// The rate that most have, without the noise of rounded times; the frames of others have their
// times.
double usual_rate(const std::vector<Clip>& clips) {
  std::vector<double> rates;
  for (const Clip& clip : clips) rates.push_back(clip.facts.fps);
  std::nth_element(rates.begin(), rates.begin() + static_cast<std::ptrdiff_t>(rates.size() / 2),
                   rates.end());
  return std::round(1e6 * rates[rates.size() / 2]) / 1e6;
}

// Frames, until the first camera ends.
uint32_t shortest(const std::vector<Clip>& clips, double rate) {
  double frames = UINT32_MAX;
  for (const Clip& clip : clips) {
    const std::vector<double>& times = clip.facts.times;
    frames =
        std::min(frames, times.empty() ? clip.facts.frames : std::round(times.back() * rate) + 1);
  }
  return static_cast<uint32_t>(frames);
}

// The largest model, for COLMAP makes one of each part of the images that it cannot join.
fs::path largest_model(const fs::path& models, size_t* cameras) {
  fs::path best;
  *cameras = 0;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(models, error)) {
    std::vector<std::string> names;
    const size_t n = io::read_colmap_cameras(entry.path().string(), &names, {}).cameras.size();
    if (n <= *cameras) continue;
    *cameras = n;
    best = entry.path();
  }
  return best;
}

fs::path find_places(const fs::path& work, const FootageOptions& options, const FootageStep& step,
                     const std::function<bool()>& cancelled) {
  const std::string database = (work / "database.db").string();
  const std::string images = (work / "images").string(), log = (work / "colmap.log").string();
  const std::string threads = options.threads == 0 ? "-1" : std::to_string(options.threads);
  const fs::path models = work / "models";
  fs::create_directory(models);
  const auto colmap = [&](std::vector<std::string> words) {
    words.insert(words.begin(), "colmap");
    run_program(words, log, kNoColmap, cancelled);
  };
  step("looking for features");
  colmap({"feature_extractor", "--database_path", database, "--image_path", images,
          "--ImageReader.camera_model", options.lens, "--SiftExtraction.use_gpu", "0",
          // What looks the same from 20 degrees aside.
          "--SiftExtraction.estimate_affine_shape", "1", "--SiftExtraction.domain_size_pooling",
          "1", "--SiftExtraction.num_threads", threads});
  step("matching features");
  // A second look by what the first has found of two cameras: several times as many matches of
  // cameras 20 degrees apart.
  colmap({"exhaustive_matcher", "--database_path", database, "--SiftMatching.use_gpu", "0",
          "--SiftMatching.guided_matching", "1", "--SiftMatching.num_threads", threads});
  step("finding places");
  colmap({"mapper", "--database_path", database, "--image_path", images, "--output_path",
          models.string(), "--Mapper.num_threads", threads,
          // Of the first two cameras: degrees and matches. Neighbours on a rig are less than the 16
          // degrees apart that COLMAP asks of photos.
          "--Mapper.init_min_tri_angle", "6", "--Mapper.init_min_num_inliers", "60"});
  return models;
}

// Of few cameras the one in the middle tests: one at the edge sees what no other does.
void choose_test(io::CameraSet* set) {
  constexpr size_t kFew = 16;
  if (set->cameras.size() >= kFew) return io::split_for_tests(*set);
  double least = 0;
  io::Camera* middle = nullptr;
  for (io::Camera& camera : set->cameras) {
    camera.split = "train";
    double sum = 0, own[3], other[3];
    camera_center(camera.camera, own);
    for (const io::Camera& another : set->cameras) {
      camera_center(another.camera, other);
      sum += std::hypot(own[0] - other[0], own[1] - other[1], own[2] - other[2]);
    }
    if (middle != nullptr && sum >= least) continue;
    least = sum;
    middle = &camera;
  }
  middle->split = "test";
}

// Removes a folder that did not become a capture.
class Unfinished {
 public:
  explicit Unfinished(fs::path path) : path_(std::move(path)) { fs::create_directories(path_); }
  ~Unfinished() {
    std::error_code error;
    fs::remove_all(path_, error);
  }
  Unfinished(const Unfinished&) = delete;
  Unfinished& operator=(const Unfinished&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

void find_fields(const Capture& capture, FootageReport* report) {
  report->least_field = 180;
  for (const CaptureCamera& camera : capture.cameras) {
    const l4d_camera& lens = camera.source.camera;
    const double edge = 0.5 * lens.width / lens.fx;
    const bool is_fisheye = camera.source.distortion.model == io::Distortion::Model::kFisheye;
    const double field = 360 / 3.141592653589793 * (is_fisheye ? edge : std::atan(edge));
    report->least_field = std::min(report->least_field, field);
    report->largest_field = std::max(report->largest_field, field);
  }
}

void link_or_copy(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::create_hard_link(from, to, error);
  if (error) fs::copy_file(from, to);
}

}  // namespace

bool is_footage(const std::string& path) { return !io::videos_in(path).empty(); }

FootageReport make_capture(const std::string& footage, const std::string& out,
                           const FootageOptions& options, const FootageStep& step,
                           const std::function<bool()>& cancelled) {
  const fs::path root = fs::path(out).lexically_normal();
  std::error_code error;
  if (fs::exists(root, error) && !fs::is_empty(root, error)) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                out + " is there, and not empty; a capture replaces nothing");
  }
  std::vector<Clip> clips;
  for (const fs::path& path : io::videos_in(footage)) {
    clips.push_back({path, path.stem().string(), 0, 0, io::probe_video(path.string())});
  }
  if (clips.size() < kLeastCameras) {
    throw Error(L4D_ERR_INVALID_ARGUMENT, footage + ": it has " + std::to_string(clips.size()) +
                                              " videos; places are found from 3 cameras on");
  }
  const Unfinished made(root.string() + ".part");
  const fs::path work = made.path() / "work";
  fs::create_directories(work / "images");
  fs::create_directories(made.path() / "videos");
  step("reading an image of each camera");
  std::map<std::string, const Clip*> by_image;
  for (Clip& clip : clips) {
    const std::string image = clip.name + ".png";
    if (!by_image.emplace(image, &clip).second) {
      throw Error(L4D_ERR_INVALID_ARGUMENT, footage + ": two videos have the name " + clip.name);
    }
    io::write_png((work / "images" / image).string(), middle_of(&clip));
  }
  size_t placed = 0;
  const fs::path model = largest_model(find_places(work, options, step, cancelled), &placed);
  std::vector<std::string> names;
  io::CameraSet set;
  if (placed > 0) set = io::read_colmap_cameras(model.string(), &names, {});
  std::string lost;
  for (const auto& [image, clip] : by_image) {
    if (std::find(names.begin(), names.end(), image) == names.end()) lost += " " + clip->name;
  }
  FootageReport report;
  if (!lost.empty() && (placed < kLeastCameras || !options.tolerant)) {
    throw Error(L4D_ERR_CORRUPT,
                footage + ": of " + std::to_string(clips.size()) +
                    " cameras, these find no place beside the others:" + lost +
                    ". Neighbours must see the same things, from less than 30 degrees apart" +
                    (placed < kLeastCameras ? "" : "; --tolerant leaves these out"));
  }
  if (!lost.empty())
    report.notes.push_back("Cameras that found no place are left out:" + lost + ".");
  for (size_t k = 0; k < names.size(); ++k) {
    const Clip& clip = *by_image.at(names[k]);
    const fs::path video = made.path() / "videos" / clip.path.filename();
    link_or_copy(clip.path, video);
    set.cameras[k].video = video.string();
    set.cameras[k].id = static_cast<int>(k);
  }
  set.fps = usual_rate(clips);
  set.frames = shortest(clips, set.fps);
  choose_test(&set);
  const std::string file = (made.path() / "cameras.json").string();
  io::write_cameras(file, set);
  fs::create_directory(made.path() / "sparse");
  fs::rename(model, made.path() / "sparse" / "0");
  fs::remove_all(work);
  step("comparing clocks");
  CaptureOptions reading;
  reading.tolerant = options.tolerant;
  const Capture capture = read_capture(file, reading);
  report.cameras = capture.cameras.size();
  find_fields(capture, &report);
  report.clocks = find_clocks(capture, options.max_offset, options.threads, cancelled);
  write_synchronised(file, capture, report.clocks);
  fs::remove(root, error);  // where it was empty
  fs::rename(made.path(), root);
  return report;
}

}  // namespace l4d::train
