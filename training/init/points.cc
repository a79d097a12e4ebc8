// SPDX-License-Identifier: Apache-2.0
// Points of a file to begin with.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "io/ply/ply.h"
#include "training/init/start.h"

namespace l4d::train {
namespace {

using io::PlyType;

constexpr const char* kColours[] = {"red", "green", "blue"};
constexpr float kBrightest = 2;  // colours may be a little above 1

// What the colours of the points are divided by; 0: there are none.
float divisor_of(const io::PlyReader& reader) {
  size_t colours = 0, bytes = 0, floats = 0;
  for (const char* name : kColours) {
    const size_t property = reader.element().find(name);
    if (property == io::PlyElement::kNone) continue;
    const PlyType type = reader.element().properties[property].type;
    ++colours;
    bytes += type == PlyType::kUint8 ? 1U : 0U;
    floats += type == PlyType::kFloat32 || type == PlyType::kFloat64 ? 1U : 0U;
  }
  if (colours == 0) return 0;
  if (bytes == 3) return 255;
  if (floats == 3) return 1;
  reader.fail(L4D_ERR_FEATURE_UNSUPPORTED,
              "the points' red, green and blue are not all there as uchar or as float");
}

void check_point(const io::PlyReader& reader, const Point& p, size_t i) {
  const std::string name = "point " + std::to_string(i);
  for (size_t c = 0; c < 3; ++c) {
    if (!std::isfinite(p.position[c]) || !std::isfinite(p.rgb[c]) || !std::isfinite(p.time)) {
      reader.fail(L4D_ERR_CORRUPT, name + " has a number that is not finite");
    }
    if (p.rgb[c] <= kBrightest) continue;
    char number[32];
    std::snprintf(number, sizeof(number), "%g", static_cast<double>(p.rgb[c]));
    reader.fail(L4D_ERR_CORRUPT,
                name + " has the " + kColours[c] + " " + number + "; floats are from 0 to 1");
  }
}

}  // namespace

std::vector<Point> read_points(const std::string& path, const io::Hold& holder,
                               std::vector<std::string>* notes) {
  io::PlyReader reader(io::InputFile(path, holder), "vertex");
  const io::PlyElement& element = reader.element();
  std::vector<io::PlyColumn> columns;
  const size_t n = static_cast<size_t>(element.count);
  const auto memory = io::hold(holder, n * (7 * sizeof(float) + sizeof(Point)), path);
  std::vector<float> xyz(3 * n), rgb(3 * n, 0.5f), time(n);
  const auto column = [&](const char* name, std::vector<float>* to, size_t first, size_t stride) {
    const size_t property = element.find(name);
    if (property == io::PlyElement::kNone) return false;
    io::PlyColumn c;
    c.property = property;
    c.to_float = to->data();
    c.first = first;
    c.stride = stride;
    columns.push_back(c);
    return true;
  };
  if (!column("x", &xyz, 0, 3) || !column("y", &xyz, 1, 3) || !column("z", &xyz, 2, 3)) {
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "the points have no x, y and z");
  }
  const float divisor = divisor_of(reader);
  for (size_t c = 0; c < 3 && divisor != 0; ++c) column(kColours[c], &rgb, c, 3);
  if (divisor == 0 && notes != nullptr) {
    notes->push_back(path + " has no red, green and blue; its points are grey.");
  }
  const bool has_time = column("t", &time, 0, 1);
  reader.read_rows(columns);
  std::vector<Point> points(n);
  for (size_t i = 0; i < n; ++i) {
    Point& p = points[i];
    p.time = time[i];
    p.has_time = has_time;
    for (size_t c = 0; c < 3; ++c) {
      p.position[c] = xyz[3 * i + c];
      p.rgb[c] = divisor == 0 ? rgb[3 * i + c] : rgb[3 * i + c] / divisor;
    }
    check_point(reader, p, i);
  }
  if (points.empty()) reader.fail(L4D_ERR_CORRUPT, "there are no points");
  return points;
}

void note_points(const Capture& capture, const std::vector<Point>& points,
                 std::vector<std::string>* notes) {
  const double frame = 1 / capture.fps;
  const auto is_outside = [&](const Point& p) {
    const auto time = static_cast<double>(p.time);
    return p.has_time && !(time >= -frame && time <= capture.duration() + frame);
  };
  const auto is_seen = [&](const Point& p) {
    return std::any_of(
        capture.cameras.begin(), capture.cameras.end(),
        [&](const CaptureCamera& camera) { return sees(camera.source.camera, p.position); });
  };
  const auto outside = std::count_if(points.begin(), points.end(), is_outside);
  if (outside > 0) {
    notes->push_back(
        std::to_string(outside) + " of " + std::to_string(points.size()) +
        " points have a time outside of the sequence; t is in seconds from its begin.");
  }
  if (!points.empty() && std::none_of(points.begin(), points.end(), is_seen)) {
    notes->push_back("No camera sees any of the " + std::to_string(points.size()) +
                     " points; they should be in the coordinates of the cameras.");
  }
}

bool is_init_word(const std::string& init) {
  return init == "capture" || init == "hull" || init == "frustum" || init == "auto";
}

std::vector<Point> first_points(const std::string& init, const Capture& capture,
                                const ImageLoader& loader, const std::vector<Instant>& instants,
                                const ImageStore& store, uint64_t count, uint64_t seed,
                                const io::Hold& holder, std::vector<std::string>* notes) {
  const auto noted = [&](std::vector<Point> points) {
    note_points(capture, points, notes);
    return points;
  };
  if (init == "capture") return noted(capture.points);
  if (init == "hull" || init == "auto") {
    std::vector<Point> points = hull_points(capture, loader, instants, store, count, seed);
    if (!points.empty()) return points;
    if (init == "hull") {
      throw io::Error(L4D_ERR_INVALID_ARGUMENT,
                      "--init is hull, but no point is inside the alpha of all images");
    }
  }
  if (init == "frustum" || init == "auto") return random_points(capture, count, seed);
  std::error_code error;
  if (std::filesystem::is_directory(init, error)) {
    return noted(frame_points(init, capture, count, seed, holder, notes));
  }
  return noted(read_points(init, holder, notes));
}

}  // namespace l4d::train
