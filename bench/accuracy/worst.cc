// SPDX-License-Identifier: Apache-2.0
#include "bench/accuracy/worst.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "eval/pair/comparison.h"
#include "eval/scene/motion.h"

namespace l4d::bench {

WorstGaussian worst_gaussian(const io::Scene& original, const Encoded& encoded) {
  DecoderHandle decoder;
  decoder.open_memory(encoded.file.data(), encoded.file.size());
  const eval::DecodedScene decoded = eval::decode_scene(decoder);
  const eval::Comparison c = eval::compare_scenes(
      original, decoded, eval::pair_by_order(original, decoded.scene, encoded.order), 0);
  WorstGaussian worst;
  worst.position = c.max_error("position_sizes");
  worst.covariance = c.max_error("covariance_factor");
  worst.opacity = c.max_error("seen_opacity");
  for (size_t i = 0; i < decoded.scene.count(); ++i) {
    const eval::Motion a = eval::motion_of(original, encoded.order[i]);
    const double error = a.mean_t - decoded.scene.mean_time(i);
    worst.mean_time = std::max(worst.mean_time, std::fabs(error) / a.sigma_t);
  }
  return worst;
}

}  // namespace l4d::bench
