// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "l4d/attributes.hpp"
#include "libl4dcodec/scene/rendering.h"
#include "libl4dcodec/scene/timeline.h"

namespace l4d::io {

// Failure of an import, an export or a file operation. `status` decides the tool's exit code.
class Error : public std::runtime_error {
 public:
  Error(l4d_status status, const std::string& message)
      : std::runtime_error(message), status_(status) {}
  l4d_status status() const { return status_; }

 private:
  l4d_status status_;
};

// A scene in memory, with the attribute meanings of l4d_gaussians.
struct Scene : AttributeArrays {
  l4d_timeline timeline{};
  l4d_placement placement{{0, 0, 0}, 1, L4D_COORDINATES_UNKNOWN, L4D_COLOR_SRGB};
  l4d_rendering rendering = default_rendering();
  l4d_presentation presentation = default_presentation();
  // Whether its first view was found in the scene, and stated by nobody.
  bool has_found_view = false;
  // The format that was read, as docs/schema/encode.json lists them, or "synth".
  std::string source;
  // Approximations made on import, one sentence each, with their size. For people.
  std::vector<std::string> notes;
  std::shared_ptr<void> memory;  // counts what was read (ImportOptions::holder)

  // Sets mean_t, and mean_t_double where any time would not come back from float32.
  void set_mean_times(std::vector<double> times);
  size_t sh_coefficients() const { return (sh_degree + 1) * (sh_degree + 1); }
};

// Seconds.
inline double duration(const l4d_timeline& timeline) { return sequence_duration(timeline); }
// The fraction meant by a decimal frame rate: 30 is 30/1, 29.97 is 30000/1001.
void set_fps(l4d_timeline& timeline, double fps);
// Sets the number of frames nearest to `seconds`; throws where the format cannot hold it.
void set_duration(l4d_timeline& timeline, double seconds);

// Converts in double precision between the two meanings of `position` and of `opacity`; no-ops
// where the scene already has that meaning.
void positions_to_reference_time(Scene& scene);
void positions_to_mean_time(Scene& scene);
// [count, 3] The same as positions_to_mean_time, before it rounds to float32.
std::vector<double> positions_at_mean_time(const Scene& scene);
void opacity_to_logit(Scene& scene);
// For what is written to be read again: throws Error(INVALID_SCENE), which names the first Gaussian
// that no scene may hold.
void require_valid(const Scene& scene, const std::string& path);
// Splits positions, [count, 3], into a common origin, which is added to the placement, and float32
// differences from it, `out`: map coordinates so keep their millimetres. The origin is 0 where the
// positions are not far from it.
void subtract_origin(const double* positions, size_t count, l4d_placement* placement, float* out);
// log(o / (1 - o)), finite for any opacity: 0 and 1 give values that come back as 0 and 1 in
// float32.
double logit(double opacity);

// "a, b_0 .. b_44, c": names that only differ in a number at their end, counted upwards, as one. At
// most 20 of them are written.
std::string list_of_names(const std::vector<std::string>& names);
// On rows of a file that stand for no Gaussian.
std::string zeros_note(size_t left_out, size_t rows);

// 3D Gaussians at one instant, as l4d_splat_buffers describes them.
struct Splats {
  uint32_t sh_degree = 0;
  std::vector<float> position;    // [M, 3]
  std::vector<float> covariance;  // [M, 6] xx xy xz yy yz zz
  std::vector<float> opacity;     // [M] in [0, 1]
  std::vector<float> sh;          // [M, (D+1)^2, 3]
  size_t count() const { return opacity.size(); }
};

}  // namespace l4d::io
