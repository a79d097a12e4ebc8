// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "io/file/file.h"
#include "io/image/image.h"

namespace l4d::eval {

// A convolution with ReLU of a network, and what comes right before it.
struct LpipsLayer {
  uint32_t index = 0;  // of its tensors: features.INDEX.weight and features.INDEX.bias
  uint32_t in = 0, out = 0;
  uint32_t side = 0, stride = 1, padding = 0;
  uint32_t pool = 0;        // side of the max pooling before it, with stride 2; 0: none
  bool is_compared = true;  // LPIPS compares what it makes
};

struct LpipsNetwork {
  std::string name;
  std::vector<LpipsLayer> layers;
};
LpipsNetwork lpips_alexnet();
LpipsNetwork lpips_vgg16();

struct LpipsWeights {
  std::vector<std::vector<float>> weights;  // by layer: [out, in, side, side]
  std::vector<std::vector<float>> biases;   // by layer: [out]
  std::vector<std::vector<float>> linear;   // by compared layer: [out]
};

// The perceptual distance of two images, LPIPS (Zhang et al. 2018) of version 0.1: the weights of
// its authors belong to it.
class Lpips {
 public:
  Lpips(LpipsNetwork network, LpipsWeights weights);
  // Reads the weights of AlexNet or VGG16 from a .safetensors file, which tells the network by the
  // shape of its first layer. Its header counts with `holder` while it is read; the caller counts
  // the values. Throws io::Error.
  static Lpips read(io::InputFile file, const io::Hold& holder = {});

  // "alex" or "vgg".
  const std::string& network() const { return network_.name; }
  // Throws io::Error(L4D_ERR_INVALID_ARGUMENT) if images of this size have no pixel left in the
  // last layer.
  void check_size(uint32_t width, uint32_t height) const;
  // Returns the bytes that distance() holds for images of this width, whatever their height.
  uint64_t memory(uint32_t width) const;
  // Returns the distance of two images of one size; 0 for equal images. Values are clamped to [0,
  // 1] first; NaN is 0. The result is the same for any number of threads; 0 = one per core. Throws
  // as check_size(), and if sizes differ.
  double distance(const io::Image& a, const io::Image& b, uint32_t threads) const;

 private:
  LpipsNetwork network_;
  LpipsWeights weights_;
};

}  // namespace l4d::eval
