// SPDX-License-Identifier: Apache-2.0
#include "io/camera/colmap.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <map>
#include <sstream>

#include "io/camera/read_cameras.h"
#include "io/file/file.h"

// COLMAP's models: cameras, images and points3D as .bin or .txt.
namespace l4d::io {
namespace {

namespace fs = std::filesystem;

struct Model {
  const char* name;
  size_t parameters;
};
// By their numbers in binary files; those after are not known here.
constexpr Model kModels[] = {{"SIMPLE_PINHOLE", 3}, {"PINHOLE", 4}, {"SIMPLE_RADIAL", 4},
                             {"RADIAL", 5},         {"OPENCV", 8},  {"OPENCV_FISHEYE", 8},
                             {"FULL_OPENCV", 12}};

struct Lens {
  l4d_camera camera;
  Distortion distortion;
};
struct Photo {
  uint64_t id = 0;
  double q[4], t[3];  // world to camera; q: w x y z
  uint64_t camera = 0;
  std::string name;
};

// A number of a text, which may be inf or nan: who reads it says whose it is.
bool take_number(std::istream& words, double* value) {
  std::string word;
  if (!(words >> word)) return false;
  char* end = nullptr;
  *value = std::strtod(word.c_str(), &end);
  return end != word.c_str() && *end == 0;
}

// What is left of a line, without blanks around it.
std::string rest_of(std::istream& words) {
  static constexpr char kBlanks[] = " \t\r";
  std::string text;
  std::getline(words, text);
  const size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(kBlanks) + 1 - begin);
}

// Numbers of a binary file, or words of a text: one after the other.
class Source {
 public:
  // Counts the file, and what its entries become: no more than kGrowth times its bytes.
  Source(const std::string& path, const Hold& holder) : place_{path, ""} {
    is_text_ = fs::path(path).extension() == ".txt";
    InputFile file(path, holder);
    memory_ = hold(holder, (1 + kGrowth) * file.size(), path);
    bytes_.resize(static_cast<size_t>(file.size()));
    bytes_.resize(file.read(bytes_.data(), bytes_.size()));
  }
  bool is_text() const { return is_text_; }
  const CameraPlace& place() const { return place_; }
  [[noreturn]] void fail(const std::string& what) const {
    place_.fail("byte " + std::to_string(at_) + ": " + what);
  }

  template <typename T>
  T take() {
    T value{};
    if (bytes_.size() - at_ < sizeof(T)) fail("the file ends early");
    std::memcpy(&value, &bytes_[at_], sizeof(T));
    at_ += sizeof(T);
    return value;
  }
  // How many entries of at least `least` bytes follow.
  uint64_t count(size_t least) {
    const uint64_t n = take<uint64_t>();
    if (n > (bytes_.size() - at_) / least) fail("the file is too short for its entries");
    return n;
  }
  void skip(uint64_t entries, uint64_t bytes) {
    if (entries > (bytes_.size() - at_) / bytes) fail("the file ends early");
    at_ += static_cast<size_t>(entries * bytes);
  }
  // Fails where a binary file has more than its entries.
  void finish() const {
    if (at_ != bytes_.size()) {
      fail(std::to_string(bytes_.size() - at_) + " bytes follow the entries that are stated");
    }
  }
  std::string name() {
    const auto from = bytes_.begin() + static_cast<ptrdiff_t>(at_);
    const auto end = std::find(from, bytes_.end(), uint8_t{0});
    if (end == bytes_.end()) fail("a name does not end");
    std::string text(from, end);
    at_ += text.size() + 1;
    return text;
  }
  // The next line of a text that is no comment; false at the end. Empty lines count.
  bool line(std::istringstream* words) {
    while (at_ < bytes_.size()) {
      const auto from = bytes_.begin() + static_cast<ptrdiff_t>(at_);
      const auto end = std::find(from, bytes_.end(), uint8_t{'\n'});
      const std::string text(from, end);
      at_ += text.size() + 1;
      if (!text.empty() && text[0] == '#') continue;
      words->clear();
      words->str(text);
      return true;
    }
    at_ = bytes_.size();
    return false;
  }

 private:
  CameraPlace place_;
  static constexpr uint64_t kGrowth = 4;

  bool is_text_ = false;
  std::shared_ptr<void> memory_;
  std::vector<uint8_t> bytes_;
  size_t at_ = 0;
};

void set_lens(const Source& source, const std::string& model, uint64_t width, uint64_t height,
              const std::vector<double>& p, Lens* lens) {
  lens->camera = default_camera();
  l4d_camera& c = lens->camera;
  c.width = static_cast<uint32_t>(std::min<uint64_t>(width, 1000000));
  c.height = static_cast<uint32_t>(std::min<uint64_t>(height, 1000000));
  for (const double value : p) {
    if (!std::isfinite(value)) source.fail("a parameter of a camera is not finite");
  }
  const bool one_focal = model == "SIMPLE_PINHOLE" || model == "SIMPLE_RADIAL" || model == "RADIAL";
  c.fx = p[0];
  c.fy = one_focal ? p[0] : p[1];
  const size_t at = one_focal ? 1 : 2;
  c.cx = p[at];
  c.cy = p[at + 1];
  const double* d = p.data() + at + 2;
  const size_t n = p.size() - at - 2;
  if (n == 0) return;
  Distortion& out = lens->distortion;
  out.model = model == "OPENCV_FISHEYE" ? Distortion::Model::kFisheye : Distortion::Model::kRadial;
  if (model == "OPENCV" || model == "FULL_OPENCV") {
    std::copy_n(d, 2, out.k);
    std::copy_n(d + 2, 2, out.p);
    std::copy_n(d + 4, n - 4, out.k + 2);
  } else {
    std::copy_n(d, n, out.k);
  }
  // A fisheye lens without coefficients is none the less no pinhole.
  const bool is_straight = std::all_of(d, d + n, [](double x) { return x == 0; });
  if (is_straight && out.model == Distortion::Model::kRadial) out = Distortion();
}

std::map<uint64_t, Lens> read_lenses(const std::string& path, const Hold& holder) {
  Source source(path, holder);
  std::map<uint64_t, Lens> lenses;
  const auto add = [&](uint64_t id, const std::string& model, uint64_t width, uint64_t height,
                       const std::vector<double>& parameters) {
    const auto [lens, is_new] = lenses.emplace(id, Lens());
    if (!is_new) source.fail("there are two cameras " + std::to_string(id));
    set_lens(source, model, width, height, parameters, &lens->second);
  };
  const auto unsupported = [&](const std::string& model) {
    source.place().fail(L4D_ERR_FEATURE_UNSUPPORTED, "cameras of the model " + model);
  };
  if (!source.is_text()) {
    const uint64_t n = source.count(24 + 24);
    for (uint64_t k = 0; k < n; ++k) {
      const uint32_t id = source.take<uint32_t>();
      const int32_t model = source.take<int32_t>();
      const uint64_t width = source.take<uint64_t>(), height = source.take<uint64_t>();
      if (model < 0 || static_cast<size_t>(model) >= std::size(kModels)) {
        unsupported(std::to_string(model));
      }
      std::vector<double> parameters(kModels[model].parameters);
      for (double& value : parameters) value = source.take<double>();
      add(id, kModels[model].name, width, height, parameters);
    }
    source.finish();
    return lenses;
  }
  for (std::istringstream words; source.line(&words);) {
    uint64_t id = 0, width = 0, height = 0;
    std::string model;
    if (!(words >> id >> model >> width >> height)) continue;
    const auto known = std::find_if(std::begin(kModels), std::end(kModels),
                                    [&](const Model& m) { return model == m.name; });
    if (known == std::end(kModels)) unsupported(model);
    std::vector<double> parameters(known->parameters);
    for (double& value : parameters) {
      if (!take_number(words, &value)) source.fail("a camera lacks parameters");
    }
    if (double more = 0; take_number(words, &more)) {
      source.fail("a camera has more parameters than " + model + " has");
    }
    add(id, model, width, height, parameters);
  }
  return lenses;
}

std::vector<Photo> read_images(const std::string& path, const Hold& holder) {
  Source source(path, holder);
  std::vector<Photo> images;
  if (!source.is_text()) {
    images.resize(static_cast<size_t>(source.count(73)));
    for (Photo& image : images) {
      image.id = source.take<uint32_t>();
      for (double& value : image.q) value = source.take<double>();
      for (double& value : image.t) value = source.take<double>();
      image.camera = source.take<uint32_t>();
      image.name = source.name();
      source.skip(source.take<uint64_t>(), 24);
    }
    source.finish();
  } else {
    std::istringstream words;
    while (source.line(&words)) {
      Photo image;
      if (!(words >> image.id)) continue;
      bool all = true;
      for (double& value : image.q) all = take_number(words, &value) && all;
      for (double& value : image.t) all = take_number(words, &value) && all;
      if (!all || !(words >> image.camera)) source.fail("an image lacks numbers");
      image.name = rest_of(words);
      if (image.name.empty()) source.fail("an image lacks its name");
      // The points that it shows.
      if (source.line(&words)) {
        size_t numbers = 0;
        for (double value = 0; take_number(words, &value);) ++numbers;
        if (!words.eof() || numbers % 3 != 0) {
          source.fail("the line behind that of " + image.name +
                      " holds no points: an image has two lines, of which the second may be empty");
        }
      }
      images.push_back(std::move(image));
    }
  }
  // By name, as videos are; COLMAP has them in any order.
  std::sort(images.begin(), images.end(),
            [](const Photo& a, const Photo& b) { return a.name < b.name; });
  return images;
}

void turn(const CameraPlace& place, const Photo& image, l4d_camera* camera) {
  const double* q = image.q;
  const double norm = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (!(std::abs(norm - 1) <= 1e-3)) place.fail("the quaternion does not have the length 1");
  const double w = q[0] / norm, x = q[1] / norm, y = q[2] / norm, z = q[3] / norm;
  const double r[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                       2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                       2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
  for (size_t row = 0; row < 3; ++row) {
    std::copy_n(r + 3 * row, 3, camera->world_to_camera + 4 * row);
    camera->world_to_camera[4 * row + 3] = image.t[row];
  }
}

// The binary file of this name if there is one, else the text.
std::string file_of(const std::string& model, const char* name) {
  std::error_code error;
  const fs::path binary = fs::path(model) / (std::string(name) + ".bin");
  return (fs::exists(binary, error) ? binary : fs::path(model) / (std::string(name) + ".txt"))
      .string();
}

}  // namespace

std::string find_colmap_model(const std::string& folder) {
  std::error_code error;
  for (const char* below : {"", "sparse/0", "0"}) {
    const std::string model = (fs::path(folder) / below).string();
    if (fs::exists(file_of(model, "cameras"), error) && fs::exists(file_of(model, "images"), error))
      return model;
  }
  return "";
}

CameraSet read_colmap_cameras(const std::string& model, std::vector<std::string>* names,
                              const Hold& holder) {
  const std::map<uint64_t, Lens> lenses = read_lenses(file_of(model, "cameras"), holder);
  CameraSet set;
  set.source = "colmap";
  const std::string images = file_of(model, "images");
  for (const Photo& image : read_images(images, holder)) {
    const CameraPlace place{images, "image " + image.name};
    const auto lens = lenses.find(image.camera);
    if (lens == lenses.end()) place.fail("its camera is not there");
    Camera camera;
    camera.id = static_cast<int>(set.cameras.size());
    camera.camera = lens->second.camera;
    camera.distortion = lens->second.distortion;
    turn(place, image, &camera.camera);
    check_camera(place, camera);
    set.cameras.push_back(std::move(camera));
    names->push_back(image.name);
  }
  return set;
}

std::vector<ColmapPoint> read_colmap_points(const std::string& model, const Hold& holder) {
  std::vector<ColmapPoint> points;
  const std::string path = file_of(model, "points3D");
  std::error_code error;
  if (!fs::exists(path, error)) return points;
  Source source(path, holder);
  const auto add = [&](const double* xyz, const unsigned* rgb) {
    ColmapPoint p{};
    for (size_t c = 0; c < 3; ++c) {
      if (!std::isfinite(xyz[c])) source.fail("a point is not finite");
      p.position[c] = static_cast<float>(xyz[c]);
      p.rgb[c] = static_cast<float>(std::min(rgb[c], 255u)) / 255;
    }
    points.push_back(p);
  };
  double xyz[3];
  unsigned rgb[3];
  if (!source.is_text()) {
    const uint64_t n = source.count(51);
    for (uint64_t k = 0; k < n; ++k) {
      source.take<uint64_t>();
      for (double& value : xyz) value = source.take<double>();
      for (unsigned& value : rgb) value = source.take<uint8_t>();
      source.take<double>();
      source.skip(source.take<uint64_t>(), 8);
      add(xyz, rgb);
    }
    source.finish();
    return points;
  }
  for (std::istringstream words; source.line(&words);) {
    uint64_t id = 0;
    if (!(words >> id)) continue;
    for (double& value : xyz) words >> value;
    for (unsigned& value : rgb) words >> value;
    if (!words) source.fail("a point lacks numbers");
    add(xyz, rgb);
  }
  return points;
}

}  // namespace l4d::io
