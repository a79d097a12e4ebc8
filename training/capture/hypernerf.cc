// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>

#include "io/camera/read_cameras.h"
#include "io/file/file.h"
#include "io/image/image.h"
#include "training/capture/capture.h"
#include "training/capture/tolerance.h"

// HyperNeRF and Nerfies: scene.json, dataset.json, metadata.json, camera/ID.json, rgb/2x/ID.png.
namespace l4d::train {
namespace {

namespace fs = std::filesystem;
using io::CameraPlace;
using Json = nlohmann::json;

// memory: counts the object.
Json read_json(const fs::path& path, const io::Hold& holder, std::shared_ptr<void>* memory) {
  io::InputFile file(path.string(), holder);
  Json root = io::read_json_file(file, holder, 0, memory);
  if (!root.is_object()) CameraPlace{path.string(), ""}.fail("not a JSON object");
  return root;
}

std::vector<double> numbers(const CameraPlace& place, const Json& root, const char* key,
                            size_t size) {
  const Json& list = io::member(place, root, key);
  if (!list.is_array() || list.size() != size) {
    place.fail(std::string(key) + " is not a list of " + std::to_string(size) + " numbers");
  }
  std::vector<double> out;
  for (const Json& value : list) out.push_back(io::finite_number(place, value, key));
  return out;
}

class HypernerfReader {
 public:
  HypernerfReader(const std::string& folder, const CaptureOptions& options)
      : folder_(folder), options_(options) {}

  Capture read() {
    const CameraPlace scene_place{(folder_ / "scene.json").string(), ""};
    std::shared_ptr<void> memory[3];
    const Json scene = read_json(folder_ / "scene.json", options_.holder, &memory[0]);
    scale_ = io::number_or(scene_place, scene, "scale", 1);
    center_ = scene.contains("center") ? numbers(scene_place, scene, "center", 3)
                                       : std::vector<double>{0, 0, 0};
    const CameraPlace place{(folder_ / "dataset.json").string(), ""};
    const Json dataset = read_json(folder_ / "dataset.json", options_.holder, &memory[1]);
    const std::vector<std::string> ids = texts(place, dataset, "ids");
    std::set<std::string> tests;
    if (dataset.contains("val_ids")) {
      for (const std::string& id : texts(place, dataset, "val_ids")) tests.insert(id);
    }
    const Json metadata = read_json(folder_ / "metadata.json", options_.holder, &memory[2]);
    capture_.layout = "hypernerf";
    for (const std::string& id : ids) last_ = std::max(last_, warp_of(metadata, id));
    for (const std::string& id : tests) {
      if (std::find(ids.begin(), ids.end(), id) != ids.end()) continue;
      capture_.notes.push_back("val_ids of dataset.json has an image that ids has not: " + id +
                               ".");
      break;
    }
    LeftOut left_out;
    for (size_t k = 0; k < ids.size(); ++k) {
      // Without a list for tests: every 4th trains, and the one 2 later tests.
      const bool trains = tests.empty() ? k % 4 == 0 : tests.count(ids[k]) == 0;
      const bool is_test = tests.empty() ? k % 4 == 2 : tests.count(ids[k]) != 0;
      if (!trains && !is_test) continue;
      try {
        add(ids[k], metadata, is_test ? "test" : "train");
      } catch (const io::Error& error) {
        if (!options_.tolerant) throw;
        left_out.add(error.what());
      }
    }
    left_out.append_to(&capture_.notes);
    capture_.frames = last_ + 1;
    capture_.fps =
        options_.fps > 0 ? options_.fps : static_cast<double>(capture_.frames) / options_.seconds;
    for (CaptureView& view : capture_.views) view.time = view.frame / capture_.fps;
    return std::move(capture_);
  }

 private:
  static std::vector<std::string> texts(const CameraPlace& place, const Json& root,
                                        const char* key) {
    const Json& list = io::member(place, root, key);
    if (!list.is_array()) place.fail(std::string(key) + " is not a list");
    std::vector<std::string> out;
    for (const Json& value : list) {
      if (!value.is_string() || value.get<std::string>().find('/') != std::string::npos) {
        place.fail(std::string(key) + " has an entry that is no name of an image");
      }
      out.push_back(value.get<std::string>());
    }
    return out;
  }

  uint32_t warp_of(const Json& metadata, const std::string& id) const {
    const CameraPlace place{(folder_ / "metadata.json").string(), "image " + id};
    const Json& entry = io::member(place, metadata, id.c_str());
    return io::whole_number(place, entry, entry.contains("warp_id") ? "warp_id" : "time_id",
                            L4D_MAX_FRAMES);
  }

  // The images of half the size, which papers use, else the whole ones.
  std::string image_of(const std::string& id, unsigned* factor) const {
    std::error_code error;
    for (const unsigned f : {2u, 1u, 4u}) {
      const fs::path folder = folder_ / "rgb" / (std::to_string(f) + "x");
      *factor = f;
      for (const char* ending : io::kImageExtensions) {
        const fs::path path = folder / (id + ending);
        if (fs::is_regular_file(path, error)) return path.string();
      }
    }
    throw io::Error(L4D_ERR_IO, folder_.string() + ": image " + id +
                                    ": cannot open it: rgb/2x has no such PNG, JPEG or EXR");
  }

  void add(const std::string& id, const Json& metadata, const char* split) {
    const fs::path path = folder_ / "camera" / (id + ".json");
    const CameraPlace place{path.string(), "image " + id};
    std::shared_ptr<void> memory;
    const Json root = read_json(path, options_.holder, &memory);
    unsigned factor = 1;
    const std::string image = image_of(id, &factor);
    CaptureCamera out;
    out.name = "image " + id;
    out.split = split;
    out.source.id = static_cast<int>(capture_.cameras.size());
    out.source.image = image;
    l4d_camera& camera = out.source.camera = io::default_camera();
    const std::vector<double> size = numbers(place, root, "image_size", 2);
    const std::vector<double> principal = numbers(place, root, "principal_point", 2);
    const double focal = io::number(place, root, "focal_length");
    const double aspect = io::number_or(place, root, "pixel_aspect_ratio", 1);
    if (!(std::abs(io::number_or(place, root, "skew", 0)) <= 1e-6 * std::abs(focal))) {
      place.fail(L4D_ERR_FEATURE_UNSUPPORTED, "the camera has a skew");
    }
    camera.width = static_cast<uint32_t>(std::clamp(size[0] / factor, 0.0, 1e6));
    camera.height = static_cast<uint32_t>(std::clamp(size[1] / factor, 0.0, 1e6));
    camera.fx = focal / factor;
    camera.fy = focal * aspect / factor;
    camera.cx = principal[0] / factor;
    camera.cy = principal[1] / factor;
    double rotation[9];
    io::matrix(place, root, "orientation", 3, 3, rotation);  // world to camera
    const std::vector<double> position = numbers(place, root, "position", 3);
    for (size_t r = 0; r < 3; ++r) {
      double* row = camera.world_to_camera + 4 * r;
      row[3] = 0;
      for (size_t c = 0; c < 3; ++c) {
        row[c] = rotation[3 * r + c];
        row[3] -= row[c] * (position[c] - center_[c]) * scale_;
      }
    }
    set_lens(place, root, &out.source.distortion);
    io::check_camera(place, out.source);
    if (options_.tolerant) {
      const std::string trouble = trouble_of_image(image, camera);
      if (!trouble.empty()) throw io::Error(L4D_ERR_IO, out.name + ": " + trouble);
    }
    const uint32_t index = camera_index(out);
    capture_.views.push_back({index, warp_of(metadata, id), 0, image});
    if (index == capture_.cameras.size()) capture_.cameras.push_back(std::move(out));
  }

  // Of a camera that stays in its place for several images there is one.
  uint32_t camera_index(const CaptureCamera& camera) const {
    const l4d_camera& a = camera.source.camera;
    for (uint32_t k = 0; k < capture_.cameras.size(); ++k) {
      const CaptureCamera& other = capture_.cameras[k];
      const l4d_camera& b = other.source.camera;
      const bool same = other.split == camera.split && a.width == b.width && a.height == b.height &&
                        a.fx == b.fx && a.fy == b.fy && a.cx == b.cx && a.cy == b.cy &&
                        io::same_lens(other.source.distortion, camera.source.distortion) &&
                        std::equal(a.world_to_camera, a.world_to_camera + 12, b.world_to_camera);
      if (same) return k;
    }
    return static_cast<uint32_t>(capture_.cameras.size());
  }

  static void set_lens(const CameraPlace& place, const Json& root, io::Distortion* lens) {
    bool any = false;
    const auto read = [&](const char* key, size_t size, double* to) {
      if (!root.contains(key)) return;
      const std::vector<double> list = numbers(place, root, key, size);
      std::copy(list.begin(), list.end(), to);
      any |= std::any_of(list.begin(), list.end(), [](double x) { return x != 0; });
    };
    read("radial_distortion", 3, lens->k);
    double tangential[2] = {0, 0};
    read("tangential_distortion", 2, tangential);
    std::copy_n(tangential, 2, lens->p);
    if (any) lens->model = io::Distortion::Model::kRadial;
  }

  fs::path folder_;
  const CaptureOptions& options_;
  Capture capture_;
  double scale_ = 1;
  std::vector<double> center_;
  uint32_t last_ = 0;
};

}  // namespace

Capture read_hypernerf_capture(const std::string& folder, const CaptureOptions& options) {
  return HypernerfReader(folder, options).read();
}

}  // namespace l4d::train
