// SPDX-License-Identifier: Apache-2.0
#include <toml++/toml.h>

#include <algorithm>
#include <filesystem>

#include "io/file/file.h"
#include "io/image/video.h"
#include "training/capture/opencv_camera.h"
#include "training/capture/video_capture.h"

// Calibrations of aniposelib and Pose2Sim: a table of TOML for each camera, and videos whose names
// have the camera's, in videos/, videos-raw/ or beside the file.
namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::CameraPlace;

// What a table takes at most, for each byte of its text: 160 were measured, of keys with many dots.
constexpr uint64_t kTableBytes = 192;
// The parser goes as deep as a key has dots; a matrix of numbers has a dozen of them on a line.
constexpr size_t kMostDots = 500;

// A file as a table, and what counts both.
class TomlFile {
 public:
  TomlFile(const std::string& path, const io::Hold& holder) : place{path, ""} {
    io::InputFile file(path, holder);
    memory_ = io::hold(holder, (1 + kTableBytes) * file.size(), path);
    std::string text(static_cast<size_t>(file.size()), '\0');
    text.resize(file.read(text.data(), text.size()));
    check_depth(text);
    try {
      root = toml::parse(std::string_view(text));
    } catch (const toml::parse_error& error) {
      fail(error.source().begin.line, std::string(error.description()));
    }
  }
  CameraPlace place;
  toml::table root;

 private:
  [[noreturn]] void fail(uint64_t line, const std::string& what) const {
    place.fail("line " + std::to_string(line) + ": " + what);
  }
  void check_depth(const std::string& text) const {
    uint64_t line = 1;
    size_t dots = 0;
    for (const char c : text) {
      line += c == '\n' ? 1U : 0U;
      dots = c == '\n' ? 0 : dots + (c == '.' ? 1U : 0U);
      if (dots > kMostDots) fail(line, "it has more than " + std::to_string(kMostDots) + " dots");
    }
  }

  std::shared_ptr<void> memory_;
};

std::vector<double> numbers_of(const CameraPlace& place, const toml::table& table,
                               const char* key) {
  std::vector<double> out;
  const toml::array* list = table[key].as_array();
  if (list == nullptr) place.fail(std::string(key) + " is no list");
  for (const toml::node& item : *list) {
    if (const toml::array* row = item.as_array()) {
      for (const toml::node& value : *row) {
        const auto number = value.value<double>();
        if (!number) place.fail(std::string(key) + " has what is no number");
        out.push_back(*number);
      }
    } else {
      const auto number = item.value<double>();
      if (!number) place.fail(std::string(key) + " has what is no number");
      out.push_back(*number);
    }
  }
  return out;
}

std::vector<double> numbers_of(const CameraPlace& place, const toml::table& table, const char* key,
                               size_t count) {
  const std::vector<double> out = numbers_of(place, table, key);
  if (out.size() == count) return out;
  place.fail(std::string(key) + " has " + std::to_string(out.size()) + " numbers, not " +
             std::to_string(count));
}

io::Camera camera_of(const CameraPlace& place, const toml::table& table, int id) {
  io::Camera camera;
  camera.id = id;
  camera.camera = io::default_camera();
  for (const double side : numbers_of(place, table, "size", 2)) {
    if (!(side >= 1 && side <= L4D_MAX_IMAGE_SIDE)) place.fail("size is out of range");
  }
  const std::vector<double> size = numbers_of(place, table, "size", 2);
  camera.camera.width = static_cast<uint32_t>(size[0]);
  camera.camera.height = static_cast<uint32_t>(size[1]);
  set_pinhole(place, numbers_of(place, table, "matrix", 9).data(), &camera.camera);
  if (table["fisheye"].value_or(false)) {
    const std::vector<double> k = numbers_of(place, table, "distortions", 4);
    camera.distortion.model = io::Distortion::Model::kFisheye;
    std::copy_n(k.begin(), 4, camera.distortion.k);
  } else {
    set_lens(place, numbers_of(place, table, "distortions"), &camera);
  }
  double rotation[9];
  rotation_of(numbers_of(place, table, "rotation", 3).data(), rotation);
  set_extrinsics(rotation, numbers_of(place, table, "translation", 3).data(), &camera.camera);
  io::check_camera(place, camera);
  return camera;
}

// Videos, by name, of the first folder that has some.
std::vector<fs::path> videos_of(const fs::path& folder) {
  for (const fs::path& place :
       {folder / "videos", folder / "videos-raw", folder.parent_path() / "videos",
        folder.parent_path() / "videos-raw", folder}) {
    std::vector<fs::path> videos = io::videos_in(place);
    if (!videos.empty()) return videos;
  }
  return {};
}

// The only video whose name has the camera's; else, where there are as many of both, by order.
void pair(const CameraPlace& file, const std::vector<std::string>& names, io::CameraSet* set) {
  const std::vector<fs::path> videos = videos_of(fs::path(file.path).parent_path());
  bool by_order = false;
  for (size_t k = 0; k < names.size(); ++k) {
    std::vector<fs::path> found;
    for (const fs::path& video : videos) {
      if (video.stem().string().find(names[k]) != std::string::npos) found.push_back(video);
    }
    if (found.size() == 1) {
      set->cameras[k].video = found[0].string();
    } else if (videos.size() == names.size()) {
      by_order = true;
    } else {
      const CameraPlace place{file.path, "camera " + names[k]};
      place.fail(L4D_ERR_IO, "the names of " + std::to_string(found.size()) + " of " +
                                 std::to_string(videos.size()) +
                                 " videos have its own; one must, or there are as many videos as "
                                 "cameras");
    }
  }
  if (!by_order) return;
  for (size_t k = 0; k < names.size(); ++k) set->cameras[k].video = videos[k].string();
  set->notes.push_back("Videos pair with cameras by the order of their names.");
}

}  // namespace

Capture read_toml_capture(const std::string& file, const CaptureOptions& options) {
  const TomlFile toml(file, options.holder);
  const CameraPlace& place = toml.place;
  const toml::table& root = toml.root;
  std::vector<std::pair<toml::source_position, std::string>> keys;  // in the order of the file
  for (const auto& [key, value] : root) {
    const toml::table* table = value.as_table();
    if (table != nullptr && table->contains("matrix")) {
      keys.emplace_back(value.source().begin, std::string(key.str()));
    }
  }
  std::sort(keys.begin(), keys.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  if (keys.empty()) place.fail("it has no camera: no table with a matrix");
  io::CameraSet set;
  set.source = "toml";
  std::vector<std::string> names;
  for (const auto& [position, key] : keys) {
    const toml::table& table = *root[key].as_table();
    names.push_back(table["name"].value_or(key));
    set.cameras.push_back(
        camera_of({file, "camera " + names.back()}, table, static_cast<int>(set.cameras.size())));
  }
  pair(place, names, &set);
  Capture capture = make_video_capture(file, set, options);
  capture.layout = "toml";
  return capture;
}

}  // namespace l4d::train
