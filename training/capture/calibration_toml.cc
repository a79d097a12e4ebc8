// SPDX-License-Identifier: Apache-2.0
#include <toml++/toml.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <set>

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
  // OpenCV has the centre of the first pixel at 0, 0.
  camera.camera.cx += 0.5;
  camera.camera.cy += 0.5;
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

// What all of several names begin and end with, taken off.
std::vector<std::string> own_parts(std::vector<std::string> names) {
  if (names.size() < 2) return names;
  size_t begin = 0, end = 0;
  const auto all_have = [&](const auto& letter) {
    return std::all_of(names.begin(), names.end(), [&](const std::string& name) {
      return begin + end < name.size() && letter(name) == letter(names[0]);
    });
  };
  while (all_have([&](const std::string& name) { return name[begin]; })) ++begin;
  while (all_have([&](const std::string& name) { return name[name.size() - 1 - end]; })) ++end;
  for (std::string& name : names) name = name.substr(begin, name.size() - begin - end);
  return names;
}

bool has_word(const std::string& text, const std::string& word) {
  const auto kind = [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return std::isdigit(byte) != 0 ? 1 : std::isalpha(byte) != 0 ? 2 : 3;
  };
  for (size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1)) {
    const size_t end = at + word.size();
    const bool begins = at == 0 || kind(text[at - 1]) != kind(word.front());
    if (begins && (end == text.size() || kind(text[end]) != kind(word.back()))) return true;
  }
  return false;
}

// For each camera the place of its video, where each has one and no two the same: cameras by the
// video of their name, else of what is their own in it, else whose name has the camera's as a
// word, or in it.
std::vector<size_t> pairs_of(const std::vector<std::string>& names,
                             const std::vector<std::string>& stems) {
  const std::vector<std::string> own_names = own_parts(names), own_stems = own_parts(stems);
  const auto is_of = [&](int how, size_t name, size_t stem) {
    if (how == 0) return stems[stem] == names[name];
    if (how == 1) return !own_names[name].empty() && own_stems[stem] == own_names[name];
    if (how == 2) return has_word(stems[stem], names[name]);
    return stems[stem].find(names[name]) != std::string::npos;
  };
  for (int how = 0; how < 4; ++how) {
    std::vector<size_t> pairs;
    for (size_t n = 0; n < names.size(); ++n) {
      std::vector<size_t> found;
      for (size_t s = 0; s < stems.size(); ++s) {
        if (is_of(how, n, s)) found.push_back(s);
      }
      if (found.size() == 1) pairs.push_back(found[0]);
    }
    const std::set<size_t> each(pairs.begin(), pairs.end());
    if (each.size() == names.size()) return pairs;
  }
  return {};
}

// Where no video has the name of a camera, and there are as many of both, they pair by order.
void pair(const CameraPlace& file, const std::vector<std::string>& names, io::CameraSet* set) {
  const std::vector<fs::path> videos = videos_of(fs::path(file.path).parent_path());
  std::vector<std::string> stems;
  for (const fs::path& video : videos) stems.push_back(video.stem().string());
  const std::vector<size_t> pairs = pairs_of(names, stems);
  for (size_t k = 0; k < pairs.size(); ++k) set->cameras[k].video = videos[pairs[k]].string();
  if (!pairs.empty()) return;
  std::vector<size_t> with_it;  // by camera: videos
  for (const std::string& name : names) {
    with_it.push_back(
        static_cast<size_t>(std::count_if(stems.begin(), stems.end(), [&](const std::string& stem) {
          return stem.find(name) != std::string::npos;
        })));
  }
  const bool are_unlike = *std::max_element(with_it.begin(), with_it.end()) == 0;
  if (!are_unlike || videos.size() != names.size()) {
    const auto worst =
        std::find_if(with_it.begin(), with_it.end(), [](size_t count) { return count != 1; });
    const size_t k = worst == with_it.end() ? 0 : static_cast<size_t>(worst - with_it.begin());
    const CameraPlace place{file.path, "camera " + names[k]};
    place.fail(L4D_ERR_IO, "the names of " + std::to_string(with_it[k]) + " of " +
                               std::to_string(videos.size()) +
                               " videos have its own; one must for each camera, or none, and there "
                               "are as many videos as cameras");
  }
  for (size_t k = 0; k < names.size(); ++k) set->cameras[k].video = videos[k].string();
  set->notes.push_back("Videos pair with cameras by the order of their names.");
}

}  // namespace

bool is_toml_calibration(const std::string& path, const io::Hold& holder) {
  io::InputFile file(path, holder);
  const std::shared_ptr<void> memory = io::hold(holder, file.size(), path);
  std::string text(static_cast<size_t>(file.size()), '\0');
  text.resize(file.read(text.data(), text.size()));
  return text.find("matrix") != std::string::npos;
}

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
  std::set<std::string> each;
  for (const std::string& name : names) {
    if (!each.insert(name).second) place.fail("two of its cameras have the name " + name);
  }
  pair(place, names, &set);
  Capture capture = make_video_capture(file, set, options);
  capture.layout = "toml";
  return capture;
}

}  // namespace l4d::train
