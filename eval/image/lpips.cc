// SPDX-License-Identifier: Apache-2.0
#include "eval/image/lpips.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "eval/image/lpips_stages.h"
#include "io/file/safetensors.h"

namespace l4d::eval {
namespace {

using io::Error;

constexpr size_t kPoolStride = 2;
constexpr size_t kColours = 3;
// Of images in [-1, 1], as LPIPS defines them.
constexpr float kShift[kColours] = {-0.030f, -0.088f, -0.188f};
constexpr float kScale[kColours] = {0.458f, 0.448f, 0.450f};

// Row `y` of an image as the first layer wants it: [3, width].
void scaled_row(const io::Image& image, size_t y, float* row) {
  const float* pixel = &image.rgb[kColours * y * image.width];
  for (size_t x = 0; x < image.width; ++x, pixel += kColours) {
    for (size_t c = 0; c < kColours; ++c) {
      const float value = pixel[c] > 0 ? std::min(pixel[c], 1.0f) : 0.0f;  // NaN is 0
      row[c * image.width + x] = (2 * value - 1 - kShift[c]) / kScale[c];
    }
  }
}

// The stages of a network for images of one size. It refers to the weights.
class Pipeline {
 public:
  Pipeline(const LpipsNetwork& network, const LpipsWeights& weights, size_t width, size_t height,
           uint32_t threads) {
    const size_t layers = network.layers.size();
    distances_.reserve(layers);
    stages_.reserve(2 * layers);
    MapShape shape{kColours, width, height};
    for (size_t k = 0; k < layers; ++k) {
      const LpipsLayer& layer = network.layers[k];
      if (layer.pool > 0) {
        shape = add<MaxPoolStage>(shape, FilterStage::Window{layer.pool, kPoolStride, 0}, next());
      }
      const FilterStage::Window window{layer.side, layer.stride, layer.padding};
      RowSink to_next = next();
      FeatureDistance* distance = nullptr;
      if (layer.is_compared) {
        distance = &distances_.emplace_back(
            MapShape{layer.out,
                     window_positions(shape.width, layer.side, layer.stride, layer.padding),
                     window_positions(shape.height, layer.side, layer.stride, layer.padding)},
            weights.linear[distances_.size()]);
      }
      const auto sink = [distance, to_next](const float* row) {
        if (distance != nullptr) distance->add(row);
        to_next(row);
      };
      shape = add<ConvolutionStage>(shape, layer.out, window, weights.weights[k], weights.biases[k],
                                    threads, sink);
    }
  }

  Pipeline(const Pipeline&) = delete;  // stages refer to it
  Pipeline& operator=(const Pipeline&) = delete;

  void push(const float* row) { stages_.front()->push(row); }
  double distance() const {
    double sum = 0;
    for (const FeatureDistance& distance : distances_) sum += distance.mean();
    return sum;
  }

 private:
  // Passes rows to the stage behind the one that is added next, if there is one.
  RowSink next() {
    const size_t behind = stages_.size() + 1;
    return [this, behind](const float* row) {
      if (behind < stages_.size()) stages_[behind]->push(row);
    };
  }
  template <typename Stage, typename... Arguments>
  MapShape add(const MapShape& in, Arguments&&... arguments) {
    stages_.push_back(std::make_unique<Stage>(in, std::forward<Arguments>(arguments)...));
    return stages_.back()->out();
  }

  std::vector<FeatureDistance> distances_;
  std::vector<std::unique_ptr<FilterStage>> stages_;
};

// Pixels of a side that are left in the last layer.
size_t last_side(const LpipsNetwork& network, size_t side) {
  for (const LpipsLayer& layer : network.layers) {
    if (layer.pool > 0) side = window_positions(side, layer.pool, kPoolStride, 0);
    side = window_positions(side, layer.side, layer.stride, layer.padding);
  }
  return side;
}

std::vector<io::TensorName> tensors_of(const LpipsNetwork& network) {
  std::vector<io::TensorName> tensors;
  for (const LpipsLayer& layer : network.layers) {
    const std::string name = "features." + std::to_string(layer.index);
    tensors.push_back({name + ".weight", {layer.out, layer.in, layer.side, layer.side}});
    tensors.push_back({name + ".bias", {layer.out}});
  }
  size_t compared = 0;
  for (const LpipsLayer& layer : network.layers) {
    if (!layer.is_compared) continue;
    tensors.push_back(
        {"lin" + std::to_string(compared++) + ".model.1.weight", {1, layer.out, 1, 1}});
  }
  return tensors;
}

}  // namespace

LpipsNetwork lpips_alexnet() {
  return {"alex",
          {{0, 3, 64, 11, 4, 2},
           {3, 64, 192, 5, 1, 2, 3},
           {6, 192, 384, 3, 1, 1, 3},
           {8, 384, 256, 3, 1, 1},
           {10, 256, 256, 3, 1, 1}}};
}

LpipsNetwork lpips_vgg16() {
  return {"vgg",
          {{0, 3, 64, 3, 1, 1, 0, false},
           {2, 64, 64, 3, 1, 1},
           {5, 64, 128, 3, 1, 1, 2, false},
           {7, 128, 128, 3, 1, 1},
           {10, 128, 256, 3, 1, 1, 2, false},
           {12, 256, 256, 3, 1, 1, 0, false},
           {14, 256, 256, 3, 1, 1},
           {17, 256, 512, 3, 1, 1, 2, false},
           {19, 512, 512, 3, 1, 1, 0, false},
           {21, 512, 512, 3, 1, 1},
           {24, 512, 512, 3, 1, 1, 2, false},
           {26, 512, 512, 3, 1, 1, 0, false},
           {28, 512, 512, 3, 1, 1}}};
}

Lpips::Lpips(LpipsNetwork network, LpipsWeights weights)
    : network_(std::move(network)), weights_(std::move(weights)) {}

Lpips Lpips::read(io::InputFile input, const io::Hold& holder) {
  io::TensorFile file(std::move(input), holder);
  const std::vector<uint64_t>* first = file.shape_of("features.0.weight");
  if (first == nullptr) {
    throw Error(L4D_ERR_CORRUPT, file.path() + ": there is no tensor features.0.weight");
  }
  for (LpipsNetwork& network : std::vector<LpipsNetwork>{lpips_alexnet(), lpips_vgg16()}) {
    const std::vector<io::TensorName> tensors = tensors_of(network);
    if (*first != tensors.front().shape) continue;
    std::vector<std::vector<float>> values = file.read(tensors);
    LpipsWeights weights;
    const size_t layers = network.layers.size();
    for (size_t k = 0; k < layers; ++k) {
      weights.weights.push_back(std::move(values[2 * k]));
      weights.biases.push_back(std::move(values[2 * k + 1]));
    }
    for (size_t k = 2 * layers; k < values.size(); ++k) {
      weights.linear.push_back(std::move(values[k]));
    }
    return Lpips(std::move(network), std::move(weights));
  }
  throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
              file.path() + ": features.0.weight has the shape of neither AlexNet nor VGG16");
}

void Lpips::check_size(uint32_t width, uint32_t height) const {
  if (last_side(network_, std::min(width, height)) > 0) return;
  uint32_t least = std::min(width, height);
  while (last_side(network_, least) == 0) ++least;
  throw Error(L4D_ERR_INVALID_ARGUMENT, "LPIPS with \"" + network_.name +
                                            "\" needs images of at least " + std::to_string(least) +
                                            " pixels a side; these have " + std::to_string(width) +
                                            " x " + std::to_string(height));
}

uint64_t Lpips::memory(uint32_t width) const {
  // Of both images: the rows of each window, the row that a stage makes, and for a convolution what
  // its weights multiply.
  uint64_t floats = 2 * kColours * width, side = width, channels = kColours;
  const auto add = [&](uint64_t rows, uint64_t padding, uint64_t out_channels, uint64_t out_width,
                       uint64_t taps) {
    floats += 2 * (rows * channels * (side + 2 * padding) + out_channels * out_width +
                   taps * channels * out_width);
    channels = out_channels;
    side = out_width;
  };
  for (const LpipsLayer& layer : network_.layers) {
    if (layer.pool > 0) {
      add(layer.pool, 0, channels,
          window_positions(static_cast<size_t>(side), layer.pool, kPoolStride, 0), 0);
    }
    const size_t out =
        window_positions(static_cast<size_t>(side), layer.side, layer.stride, layer.padding);
    add(layer.side, layer.padding, layer.out, out, uint64_t{layer.side} * layer.side);
    floats += 4 * out;  // lengths of features, as doubles
  }
  return floats * sizeof(float);
}

double Lpips::distance(const io::Image& a, const io::Image& b, uint32_t threads) const {
  if (!a.same_size(b)) throw Error(L4D_ERR_INVALID_ARGUMENT, "the images differ in size");
  check_size(a.width, a.height);
  Pipeline pipeline(network_, weights_, a.width, a.height, threads);
  const size_t values = kColours * a.width;
  std::vector<float> row(2 * values);
  for (size_t y = 0; y < a.height; ++y) {
    scaled_row(a, y, row.data());
    scaled_row(b, y, &row[values]);
    pipeline.push(row.data());
  }
  return pipeline.distance();
}

}  // namespace l4d::eval
