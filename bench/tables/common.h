// SPDX-License-Identifier: Apache-2.0
// What the table programs share: timing, memory, encoding of scenes through the public API.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "io/ply/weights.h"
#include "io/scene/scene.h"
#include "l4d/l4d.hpp"

namespace l4d::bench {

double seconds_now();  // monotonic
double median(std::vector<double> values);
// Largest resident set of this process so far, bytes.
uint64_t peak_rss_bytes();
// Starts a new measurement of peak_rss_bytes, where the system allows it.
void reset_peak_rss();

// Median seconds of `runs` calls after one that warms up.
double time_median(int runs, const std::function<void()>& call);

// Folder with the basketball scene: $L4D_DATA_DIR, else ../shared/data. Empty if it is not there.
std::string data_dir();

struct WeightedScene {
  io::Scene scene;
  io::Weights weights;  // count 0 = none
};
// The basketball scene with its weights. Throws io::Error.
WeightedScene load_basketball();

// An encoder with scene and weights set. The scene must outlive it.
EncoderHandle make_encoder(const WeightedScene& scene, const std::vector<float>& sh_weights,
                           const char* preset, uint32_t threads = 0);
std::vector<float> sh_weights(const WeightedScene& scene);
l4d_encode_report report_of(const EncoderHandle& encoder);
l4d_query whole_query();
l4d_query time_query(double time);

}  // namespace l4d::bench
