// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "training/capture/capture.h"
#include "training/images/store.h"
#include "training/model/state.h"

// Where a training begins.
namespace l4d::train {

struct StartOptions {
  uint64_t count = 0;     // Gaussians to begin with
  uint64_t capacity = 0;  // at most
  uint32_t sh_degree = 3;
  uint64_t seed = 0;
  double longest = 1e30;  // s, of the temporal standard deviations of points without a time
};

// x, y, z, optionally red, green, blue (uchar, or float in [0, 1]) and t (s) of the element
// `vertex`. Throws io::Error. Points without colours are noted, unless notes is null. holder:
// counts what reading takes, which is more than the points.
std::vector<Point> read_points(const std::string& path, const io::Hold& holder,
                               std::vector<std::string>* notes);

// The points of the PLY files of a folder, each at the time of the frame that its name ends with:
// 000012.ply. About 2 `count` of them, as many of each file. Throws io::Error. Files of frames that
// the capture does not have are left out, and noted.
std::vector<Point> frame_points(const std::string& folder, const Capture& capture, uint64_t count,
                                uint64_t seed, const io::Hold& holder,
                                std::vector<std::string>* notes);

// Notes points that are of another time than the capture, and where no camera sees any.
void note_points(const Capture& capture, const std::vector<Point>& points,
                 std::vector<std::string>* notes);

// Whether the point is in the image of the camera.
bool sees(const l4d_camera& camera, const float* p /* [3] */);

// Without points: half of them in the ball around the mean of the cameras with their radius, where
// a third of the cameras see it, half in a shell of 0.9 to 1.5 of that radius; random colours.
std::vector<Point> random_points(const Capture& capture, uint64_t count, uint64_t seed);

// Adds copies of points where there are fewer than half of `count`, up to that, each moved by at
// most the distance to the nearest other point, and returns their number: the model grows by few
// percent in each round, and only around what it has. Random points, which a few cameras take for
// what is near to one of them, are added only where there are fewer than 20 points.
uint64_t fill_up(const Capture& capture, uint64_t count, uint64_t seed, std::vector<Point>* points);

// Points that all views of an instant show with alpha above 1/2, of 16 instants. Empty if no image
// has alpha.
std::vector<Point> hull_points(const Capture& capture, const ImageLoader& loader,
                               const std::vector<Instant>& instants, const ImageStore& store,
                               uint64_t count, uint64_t seed);

// Whether it is one of the words of first_points(), and not a file.
bool is_init_word(const std::string& init);
// The points that `init` names: "capture", "hull", "frustum" (random points), a file, or a folder
// with a file for each frame. "auto" is the hull where images have alpha, and random points
// elsewhere. Throws io::Error.
std::vector<Point> first_points(const std::string& init, const Capture& capture,
                                const ImageLoader& loader, const std::vector<Instant>& instants,
                                const ImageStore& store, uint64_t count, uint64_t seed,
                                const io::Hold& holder, std::vector<std::string>* notes);

// Gaussians at the points: as many as `options.count`, drawn from them. The scale is the root mean
// square distance to 3 neighbours, times live around the time of a point that has one, else for a
// random part of the sequence.
ModelState start_model(const Capture& capture, const std::vector<Point>& points,
                       const StartOptions& options);

}  // namespace l4d::train
