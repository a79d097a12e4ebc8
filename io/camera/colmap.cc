// SPDX-License-Identifier: Apache-2.0
#include "io/camera/colmap.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <sstream>

#include "io/camera/colmap_source.h"
#include "io/camera/read_cameras.h"

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

void set_lens(const ColmapSource& source, const std::string& model, uint64_t width, uint64_t height,
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
  ColmapSource source(path, holder);
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
  for (std::istringstream words; source.entry(&words);) {
    uint64_t id = 0, width = 0, height = 0;
    std::string model;
    if (!take_whole(words, &id) || !(words >> model) || !take_whole(words, &width) ||
        !take_whole(words, &height)) {
      source.fail("a camera lacks its number, model or size");
    }
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

// Whether what is left of a line is the points that an image shows: x y id for each, where the id
// of a point without a place in space is -1.
bool holds_points(std::istream& words) {
  size_t numbers = 0;
  for (double value = 0; has_words(words); ++numbers) {
    if (!take_number(words, &value) || !std::isfinite(value)) return false;
    if (numbers % 3 == 2 && !(value >= -1 && value == std::floor(value))) return false;
  }
  return numbers % 3 == 0;
}

// An image of a text, which has two lines.
Photo read_photo(ColmapSource& source, std::istringstream& words) {
  Photo image;
  if (!take_whole(words, &image.id)) source.fail("an image lacks its number");
  bool all = true;
  for (double& value : image.q) all = take_number(words, &value) && all;
  for (double& value : image.t) all = take_number(words, &value) && all;
  if (!all || !take_whole(words, &image.camera)) source.fail("an image lacks numbers");
  image.name = rest_of(words);
  if (image.name.empty()) source.fail("an image lacks its name");
  if (source.line(&words) && !holds_points(words)) {
    source.fail("the line of points of the image " + image.name +
                " is missing: an image has two lines, of which the second has x, y and id of each "
                "point, or is empty");
  }
  return image;
}

Photo read_binary_photo(ColmapSource& source) {
  Photo image;
  image.id = source.take<uint32_t>();
  for (double& value : image.q) value = source.take<double>();
  for (double& value : image.t) value = source.take<double>();
  image.camera = source.take<uint32_t>();
  image.name = source.name();
  source.skip(source.take<uint64_t>(), 24);
  return image;
}

// images: by name.
void check_unique(const CameraPlace& place, const std::vector<Photo>& images) {
  const auto same_name =
      std::adjacent_find(images.begin(), images.end(),
                         [](const Photo& a, const Photo& b) { return a.name == b.name; });
  if (same_name != images.end()) place.fail("there are two images " + same_name->name);
  std::vector<uint64_t> ids;
  for (const Photo& image : images) ids.push_back(image.id);
  std::sort(ids.begin(), ids.end());
  const auto same_id = std::adjacent_find(ids.begin(), ids.end());
  if (same_id != ids.end()) {
    place.fail("there are two images of the number " + std::to_string(*same_id));
  }
}

// notes: gets one where a comment states another number of images, as of a file that was cut off.
std::vector<Photo> read_images(const std::string& path, const Hold& holder,
                               std::vector<std::string>* notes) {
  ColmapSource source(path, holder);
  std::vector<Photo> images;
  if (!source.is_text()) {
    images.resize(static_cast<size_t>(source.count(73)));
    for (Photo& image : images) image = read_binary_photo(source);
    source.finish();
  } else {
    for (std::istringstream words; source.entry(&words);) {
      images.push_back(read_photo(source, words));
    }
    const std::optional<uint64_t> stated = source.stated_images();
    if (stated && *stated != images.size()) {
      notes->push_back(fs::path(path).filename().string() + " states " + std::to_string(*stated) +
                       " images, and has " + std::to_string(images.size()) + ".");
    }
  }
  // By name, as videos are; COLMAP has them in any order.
  std::sort(images.begin(), images.end(),
            [](const Photo& a, const Photo& b) { return a.name < b.name; });
  check_unique(source.place(), images);
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
  for (const Photo& image : read_images(images, holder, &set.notes)) {
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
  ColmapSource source(path, holder);
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
  for (std::istringstream words; source.entry(&words);) {
    uint64_t id = 0;
    if (!take_whole(words, &id)) source.fail("a point lacks its number");
    for (double& value : xyz) words >> value;
    for (unsigned& value : rgb) words >> value;
    if (!words) source.fail("a point lacks numbers");
    add(xyz, rgb);
  }
  return points;
}

}  // namespace l4d::io
