// SPDX-License-Identifier: Apache-2.0
#include "training/run/setup/capacity.h"

#include <algorithm>
#include <cstdio>

namespace l4d::train {
namespace {

using io::Error;

constexpr uint32_t kMinSize = 8;           // pixels a side of images that are scaled
constexpr uint64_t kLeastResident = 1000;  // Gaussians; with fewer nothing can be trained

uint64_t rows_in(uint64_t bytes, const BackendCost& cost) {
  return bytes <= cost.fixed ? 0 : (bytes - cost.fixed) / std::max<uint64_t>(cost.row, 1);
}

}  // namespace

void check_scale(double scale, const Capture& capture, const ImageLoader& loader) {
  for (uint32_t k = 0; k < capture.cameras.size() && scale < 1; ++k) {
    const l4d_camera& camera = loader.camera(k);
    if (std::min(camera.width, camera.height) >= kMinSize) continue;
    char number[40];
    std::snprintf(number, sizeof(number), "%g", scale);
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                "--scale is " + std::string(number) + "; it makes images of " +
                    std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                    " pixels, which must be at least " + std::to_string(kMinSize) + " a side");
  }
}

StepSize step_size(const Settings& settings, const Capture& capture, const ImageLoader& loader) {
  StepSize size{settings.sh_degree, settings.views, 0, 0};
  for (uint32_t k = 0; k < capture.cameras.size(); ++k) {
    size.width = std::max(size.width, loader.camera(k).width);
    size.height = std::max(size.height, loader.camera(k).height);
  }
  return size;
}

void settle_capacity(Settings* s, const BackendCost& cost, std::vector<std::string>* notes) {
  if (s->resident == 0) {
    s->resident = s->gaussians;
    const uint64_t bytes = s->device_memory != 0 ? s->device_memory : cost.free / 2;
    if (bytes != 0) s->resident = std::min(s->gaussians, rows_in(bytes, cost));
    const uint64_t least = std::min(s->gaussians, kLeastResident);
    if (s->resident < least) {
      throw Error(L4D_ERR_LIMIT_EXCEEDED,
                  (s->device_memory != 0 ? "--device-memory is " : "half of the free memory is ") +
                      std::to_string(bytes) + " bytes; steps need at least " +
                      std::to_string(cost.fixed + least * cost.row) +
                      ": fewer --views and a smaller --scale need less");
    }
  }
  s->resident = std::min(s->resident, s->gaussians);
  if (!is_partly_away(*s)) {
    if (s->adam == "auto") s->adam = "dense";
    return;
  }
  const auto refuse = [&](const std::string& what) {
    throw Error(L4D_ERR_INVALID_ARGUMENT,
                what + " needs all Gaussians in the back end, which holds " +
                    std::to_string(s->resident) + " of " + std::to_string(s->gaussians) +
                    "; a larger --device-memory or fewer --gaussians allow it");
  };
  if (s->adam == "dense") refuse("--adam dense");
  if (s->density == "gradient") refuse("--density gradient");
  if (s->consistency_weight > 0) refuse("--consistency-weight");
  notes->push_back("The back end holds " + std::to_string(s->resident) + " of " +
                   std::to_string(s->gaussians) +
                   " Gaussians: those that no window of images needs are kept elsewhere, and "
                   "Adam is sparse");
  s->adam = "sparse";
}

}  // namespace l4d::train
