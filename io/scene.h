// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "l4d/l4d.h"

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
struct Scene {
  l4d_timeline timeline{};
  l4d_placement placement{{0, 0, 0}, 1, L4D_COORDINATES_UNKNOWN, L4D_COLOR_SRGB};
  uint32_t sh_degree = 0;
  uint32_t flags = 0;           // L4D_POSITION_AT_MEAN_TIME, L4D_OPACITY_LOGIT
  std::vector<float> position;  // [N, 3]
  std::vector<float> mean_t;    // [N]
  // [N] where float32 does not hold times as they are, else empty
  std::vector<double> mean_t_double;
  std::vector<float> log_scale;  // [N, 4]
  std::vector<float> rotor;      // [N, 8]
  std::vector<float> opacity;    // [N]
  std::vector<float> sh;         // [N, (D+1)^2, 3]

  // Name of the format it was read from: "l4d_ply", "3dgs_ply", "ftgs_ply", "stg_ply", "l4d",
  // "synth".
  std::string source;
  // Approximations made on import, one sentence each, with their size. For people.
  std::vector<std::string> notes;

  size_t count() const { return mean_t.size(); }
  double mean_time(size_t i) const {
    return mean_t_double.empty() ? static_cast<double>(mean_t[i]) : mean_t_double[i];
  }
  // Sets mean_t, and mean_t_double where any time would not come back from float32.
  void set_mean_times(std::vector<double> times);
  size_t sh_coefficients() const { return (sh_degree + 1) * (sh_degree + 1); }
  void resize(size_t count);  // sets all arrays for the current sh_degree
  l4d_gaussians view() const;
};

double duration(const l4d_timeline& timeline);  // seconds

// Converts in double precision between the two meanings of `position` and of `opacity`; no-ops
// where the scene already has that meaning.
void positions_to_reference_time(Scene& scene);
void positions_to_mean_time(Scene& scene);
void opacity_to_linear(Scene& scene);
void opacity_to_logit(Scene& scene);
// log(o / (1 - o)), finite for any opacity: 0 and 1 give values that come back as 0 and 1 in
// float32.
double logit(double opacity);

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
