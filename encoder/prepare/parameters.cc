// SPDX-License-Identifier: Apache-2.0
#include "encoder/prepare/parameters.h"

#include <algorithm>
#include <iterator>
#include <string>

namespace l4d {
namespace {

constexpr const char* kComponentNames[L4D_COMPONENT_COUNT] = {"sh", "scale", "rotor-spatial",
                                                              "rotor-temporal"};

constexpr bool kStable = true;
// In the order of Parameter: name, description, unit, range, default, whether it is per component,
// an integer, stable.
constexpr ParameterDescription kParameters[] = {
    {"lossless", "code float32 attributes exactly", "", 0, 1, 0, false, true, kStable},
    {"quality", "of transforms and fixed positions: fidelity to aim at, in dB", "dB", 20, 90, 44,
     false, false, kStable},
    {"effort",
     "how hard k-means and zstd try: sets kmeans-iterations, kmeans-sample and zstd-level", "", 1,
     9, 7, false, true, kStable},
    {"max-position-error", "of each Gaussian while seen, in its own sizes; 0 = no bound", "sizes",
     0, 1e6, 0.5, false, false, kStable},
    {"max-covariance-factor", "of each Gaussian's variances; 1 or less = no bound", "", 0, 1e6, 1.5,
     false, false, kStable},
    {"max-opacity-error", "of each Gaussian at any instant; 0 = no bound", "", 0, 1, 0.1, false,
     false, kStable},
    {"max-visible-error", "distance of each Gaussian while visible, scene units; 0 = no bound",
     "scene units", 0, 1e30, 0, false, false, kStable},
    {"max-base-color-error", "of each Gaussian, colour units 0 to 1; 0 = no bound", "", 0, 1e6,
     0.05, false, false, kStable},
    {"max-directional-color-error", "of each Gaussian in any direction; 0 = no bound", "", 0, 1e6,
     0.5, false, false, kStable},
    {"drop-invalid", "drop Gaussians that cannot be coded instead of refusing the scene", "", 0, 1,
     0, false, true, kStable},
    {"prune-weight", "drop Gaussians whose alpha_t weight is at most this; negative = never", "",
     -1, 1e30, -1, false, false, kStable},
    {"prune-cost",
     "drop Gaussians that cost more bits than they are worth, by this factor; 0 = none", "", 0, 10,
     0.2, false, false, kStable},
    {"page-size", "Gaussians per page", "Gaussians", 64, 65536, 4096, false, true, kStable},
    {"profile",
     "declared profile: 1 indexed, 2 main, 3 lossless, 0 none; -1 = what the stream keeps to", "",
     -1, 3, -1, false, true, kStable},
    {"level", "declared conformance level, 0 = none; -1 = the smallest that the stream keeps to",
     "", -1, 6, -1, false, true, kStable},
    {"codebook-size", "entries of each stage's codebook", "", 1, 65536, 1024, true, true, !kStable},
    {"escape-threshold", "keep vectors of a larger weight unquantised; 0 = never", "", 0, 1e30, 0,
     true, false, !kStable},
    {"rcq", "block codebooks: 0 never, 1 where they pay, 2 wherever allowed", "", 0, 2, 1, false,
     true, !kStable},
    {"rcq-size", "entries of a residual codebook", "", 1, 4096, 512, false, true, !kStable},
    {"merge-fraction", "merge a finest layer with a smaller share of all Gaussians", "", 0, 1,
     0.005, false, false, !kStable},
    {"merge-count", "merge a finest layer with fewer Gaussians", "Gaussians", 0, 1e9, 4096, false,
     true, !kStable},
    {"closed-loop", "choose means and opacities so that decoded Gaussians are in place", "", 0, 1,
     1, false, true, !kStable},
    {"gauge", "rotors: 0 as given, 1 sign, 2 nearest identity, 3 sorted scales", "", 0, 3, 1, false,
     true, !kStable},
    {"opacity-bits", "bits of an opacity code; 0 = as the quality allows", "bits", 0, 16, 0, false,
     true, !kStable},
    {"scale-factor-bits", "bits of a scale factor code", "bits", 1, 16, 8, false, true, !kStable},
    {"kmeans-iterations", "Lloyd iterations at most", "", 0, 1000, 10, false, true, !kStable},
    {"kmeans-sample", "training points per codeword", "", 1, 1e6, 24, false, true, !kStable},
    {"zstd-level", "effort of zstd", "", 1, 22, 15, false, true, !kStable},
    {"coding", "0 codebooks, 1 transform, 2 whichever costs less", "", 0, 2, 1, true, true,
     !kStable},
    {"quality-offset", "dB on top of the quality", "dB", -30, 30, 0, true, false, !kStable},
    {"fixed-positions", "positions in fixed point, with a step that follows the quality", "", 0, 1,
     1, false, true, !kStable},
    {"mean-t-shift", "low bits of binary16 mean times left out; -1 = as the quality allows", "bits",
     -1, 10, -1, false, true, !kStable},
    {"rans", "code pages by rANS, not zstd", "", 0, 1, 1, false, true, !kStable},
    {"position-offset", "dB on top of the quality, of fixed positions", "dB", -30, 60, 6, false,
     false, !kStable},
    {"codebooks-by-cost", "sizes and depths of codebooks follow the quality", "", 0, 1, 0, false,
     true, !kStable},
    {"refine", "rounds in which residual stages are coded again for each other", "", 0, 20, 0,
     false, true, !kStable},
    // Lists.
    {"tiers", "shares of the long-lived Gaussians that the first tier has, the first two, ..", "",
     0, 1, 0, false, false, kStable, L4D_MAX_TIERS - 1},
    {"stages", "shares of the Gaussians that residual stages are for, the first 1", "", 0, 1, 0,
     true, false, !kStable, L4D_MAX_STAGES}};
static_assert(std::size(kParameters) == static_cast<size_t>(Parameter::kCount));

}  // namespace

const ParameterDescription& describe_parameter(Parameter parameter) {
  return kParameters[static_cast<size_t>(parameter)];
}

Status find_parameter(const std::string& name, NamedParameter* out) {
  const size_t dot = std::min(name.find('.'), name.size());
  const std::string alone = name.substr(0, dot);
  size_t index = 0;
  while (index < std::size(kParameters) && alone != kParameters[index].name) ++index;
  if (index == std::size(kParameters)) return invalid_argument("`" + alone + "` is no parameter");
  out->parameter = static_cast<Parameter>(index);
  out->component = kAllComponents;
  if (dot == name.size()) return {};
  const std::string component = name.substr(dot + 1);
  if (!kParameters[index].per_component) {
    return invalid_argument("`" + alone + "` has no components");
  }
  std::string known;
  for (int c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (component == kComponentNames[c]) out->component = c;
    known += std::string(c == 0 ? " " : ", ") + kComponentNames[c];
  }
  if (out->component != kAllComponents) return {};
  return invalid_argument("`" + component + "` is no component:" + known);
}

const char* component_name(int component) { return kComponentNames[component]; }

}  // namespace l4d
