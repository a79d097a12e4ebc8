// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "io/file/file.h"
#include "io/synth/square.h"
#include "io/synth/surface.h"

namespace l4d::io {
namespace {

using namespace synth;  // of vectors
using Json = nlohmann::ordered_json;

constexpr int kWidth = 960, kHeight = 540;

Json camera(int id, const char* split, const View& view) {
  const Vec3 forward = unit(view.target - view.eye);
  const Vec3 right = unit(cross(forward, kUp)), down = cross(forward, right);
  const double half = view.degrees / 720;  // turns
  const double focal = kHeight / 2.0 * cos_turns(half) / sin_turns(half);
  Json w2c = Json::array();
  for (const Vec3& row : {right, down, forward}) {
    w2c.push_back({row[0], row[1], row[2], 0.0 - dot(row, view.eye)});
  }
  w2c.push_back({0, 0, 0, 1});
  return {{"id", id},
          {"split", split},
          {"K", {{focal, 0, kWidth / 2.0}, {0, focal, kHeight / 2.0}, {0, 0, 1}}},
          {"w2c", w2c}};
}

// Catmull-Rom through six points, s of 0..1.
Vec3 spline(const Vec3 (&points)[6], double s) {
  const double x = s * 5;
  const int i = std::min(static_cast<int>(x), 4);
  const double f = x - i;
  const auto at = [&](int k) { return points[std::min(std::max(k, 0), 5)]; };
  const Vec3 a = at(i - 1), b = at(i), c = at(i + 1), d = at(i + 2);
  return (b * 2 + (c - a) * f + (a * 2 - b * 5 + c * 4 - d) * (f * f) +
          ((b - c) * 3 + d - a) * (f * f * f)) *
         0.5;
}

}  // namespace

void write_square_cameras(const std::string& path, const l4d_timeline& timeline) {
  constexpr View kNamed[] = {kFirstView,
                             {{-3.6, 1.8, 8.8}, {1.9, 2.6, -3.4}, 46},
                             {{5.4, 2.2, 9.4}, {-2.0, 2.4, -3.4}, 46},
                             {{0.9, 1.65, 6.6}, {1.3, 1.45, 0.0}, 48},
                             {{3.6, 1.6, 3.0}, {3.7, 1.9, -3.0}, 50},
                             {{-3.4, 1.6, 2.3}, {-3.7, 1.5, -1.5}, 46},
                             {{0.5, 11.5, 17.5}, {0.3, 0.8, -3.0}, 42},
                             {{1.0, 2.0, -7.4}, {-0.5, 2.6, 6.0}, 50}};
  constexpr Vec3 kEyes[6] = {{-1.5, 2.6, 13.4}, {-0.4, 2.1, 9.5},   {0.9, 1.8, 6.0},
                             {0.4, 1.7, 2.0},   {-1.0, 1.75, -2.0}, {-0.9, 1.8, -3.6}};
  constexpr Vec3 kTargets[6] = {{0.3, 3.15, -3.0}, {0.6, 2.5, -3.0}, {0.2, 1.9, -4.0},
                                {-2.6, 1.8, -4.0}, {2.5, 1.9, -5.0}, {4.5, 2.0, -2.5}};
  Json cameras = Json::array();
  for (int k = 0; k < 8; ++k) cameras.push_back(camera(k, "test", kNamed[k]));
  for (int k = 0; k < 24; ++k) {
    const double s = sin_turns(k / 24.0), c = cos_turns(k / 24.0);
    cameras.push_back(
        camera(100 + k, "train",
               {{8.4 * s, 4.0 - c, 0.7 + 6.8 * c}, {0.2 - 1.5 * s, 1.7, -0.8 - 1.5 * c}, 50}));
  }
  const int walk = static_cast<int>(std::min<uint32_t>(150, timeline.num_frames));
  for (int k = 0; k < walk; ++k) {
    const double s = walk > 1 ? k / (walk - 1.0) : 0;
    cameras.push_back(camera(200 + k, "test", {spline(kEyes, s), spline(kTargets, s), 46}));
  }
  const Json root = {{"fps", timeline.num_frames / duration(timeline)},
                     {"frames", timeline.num_frames},
                     {"width", kWidth},
                     {"height", kHeight},
                     {"cameras", cameras}};
  const std::string text = root.dump(1) + "\n";
  OutputFile file(path);
  file.write(text.data(), text.size());
  file.commit();
}

}  // namespace l4d::io
