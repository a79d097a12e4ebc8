// SPDX-License-Identifier: Apache-2.0
// The networks of LPIPS against direct loops over whole maps in double, which share no code with
// them.
#include "eval/image/lpips.h"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <random>
#include <utility>

#include "io/scene/scene.h"
#include "tests/common/safetensors.h"

namespace l4d::eval {
namespace {

struct Map {
  size_t channels = 0, width = 0, height = 0;
  std::vector<double> values;
  Map(size_t c, size_t w, size_t h) : channels(c), width(w), height(h), values(c * w * h) {}
  double& at(size_t c, size_t y, size_t x) { return values[(c * height + y) * width + x]; }
  double at(size_t c, size_t y, size_t x) const { return values[(c * height + y) * width + x]; }
};

Map scaled(const io::Image& image) {
  const double shift[3] = {-0.030, -0.088, -0.188}, scale[3] = {0.458, 0.448, 0.450};
  Map map(3, image.width, image.height);
  for (size_t y = 0; y < image.height; ++y) {
    for (size_t x = 0; x < image.width; ++x) {
      for (size_t c = 0; c < 3; ++c) {
        const double value = image.rgb[3 * (y * image.width + x) + c];
        map.at(c, y, x) = (value * 2 - 1 - shift[c]) / scale[c];
      }
    }
  }
  return map;
}

Map pooled(const Map& in, size_t side) {
  Map out(in.channels, (in.width - side) / 2 + 1, (in.height - side) / 2 + 1);
  for (size_t c = 0; c < out.channels; ++c) {
    for (size_t y = 0; y < out.height; ++y) {
      for (size_t x = 0; x < out.width; ++x) {
        double largest = -1e300;
        for (size_t k = 0; k < side * side; ++k) {
          largest = std::max(largest, in.at(c, 2 * y + k / side, 2 * x + k % side));
        }
        out.at(c, y, x) = largest;
      }
    }
  }
  return out;
}

Map convolved(const Map& in, const LpipsLayer& layer, const std::vector<float>& weights,
              const std::vector<float>& bias) {
  const size_t side = layer.side;
  Map out(layer.out, (in.width + 2 * layer.padding - side) / layer.stride + 1,
          (in.height + 2 * layer.padding - side) / layer.stride + 1);
  for (size_t o = 0; o < out.channels; ++o) {
    for (size_t y = 0; y < out.height; ++y) {
      for (size_t x = 0; x < out.width; ++x) {
        double sum = bias[o];
        for (size_t c = 0; c < in.channels; ++c) {
          for (size_t ky = 0; ky < side; ++ky) {
            const size_t row = y * layer.stride + ky - layer.padding;  // wraps above the map
            if (row >= in.height) continue;
            for (size_t kx = 0; kx < side; ++kx) {
              const size_t column = x * layer.stride + kx - layer.padding;
              if (column >= in.width) continue;
              sum += static_cast<double>(weights[((o * in.channels + c) * side + ky) * side + kx]) *
                     in.at(c, row, column);
            }
          }
        }
        out.at(o, y, x) = std::max(sum, 0.0);
      }
    }
  }
  return out;
}

double distance_of(const Map& a, const Map& b, const std::vector<float>& linear) {
  double sum = 0;
  for (size_t y = 0; y < a.height; ++y) {
    for (size_t x = 0; x < a.width; ++x) {
      double length_a = 0, length_b = 0;
      for (size_t c = 0; c < a.channels; ++c) {
        length_a += a.at(c, y, x) * a.at(c, y, x);
        length_b += b.at(c, y, x) * b.at(c, y, x);
      }
      length_a = std::sqrt(length_a) + 1e-10;
      length_b = std::sqrt(length_b) + 1e-10;
      for (size_t c = 0; c < a.channels; ++c) {
        sum += linear[c] * std::pow(a.at(c, y, x) / length_a - b.at(c, y, x) / length_b, 2);
      }
    }
  }
  return sum / static_cast<double>(a.width * a.height);
}

double naive_distance(const LpipsNetwork& network, const LpipsWeights& weights, const io::Image& a,
                      const io::Image& b) {
  Map map_a = scaled(a), map_b = scaled(b);
  double sum = 0;
  size_t compared = 0;
  for (size_t k = 0; k < network.layers.size(); ++k) {
    const LpipsLayer& layer = network.layers[k];
    for (Map* map : {&map_a, &map_b}) {
      if (layer.pool > 0) *map = pooled(*map, layer.pool);
      *map = convolved(*map, layer, weights.weights[k], weights.biases[k]);
    }
    if (layer.is_compared) sum += distance_of(map_a, map_b, weights.linear[compared++]);
  }
  return sum;
}

std::vector<float> random_values(std::mt19937& random, size_t count, double low, double high) {
  std::vector<float> values(count);
  for (float& value : values) {
    value = static_cast<float>(low + (high - low) * static_cast<double>(random()) / 4294967296.0);
  }
  return values;
}

// Weights that keep the size of features from layer to layer.
LpipsWeights random_weights(const LpipsNetwork& network, std::mt19937& random) {
  LpipsWeights w;
  for (const LpipsLayer& layer : network.layers) {
    const size_t taps = size_t{layer.in} * layer.side * layer.side;
    const double bound = std::sqrt(6.0 / static_cast<double>(taps));
    w.weights.push_back(random_values(random, layer.out * taps, -bound, bound));
    w.biases.push_back(random_values(random, layer.out, -0.1, 0.1));
    if (layer.is_compared) w.linear.push_back(random_values(random, layer.out, 0, 1));
  }
  return w;
}

io::Image random_image(std::mt19937& random, uint32_t width, uint32_t height) {
  io::Image image(width, height);
  image.rgb = random_values(random, image.rgb.size(), 0, 1);
  return image;
}

void expect_as_naive(const LpipsNetwork& network, uint32_t width, uint32_t height) {
  SCOPED_TRACE(network.name + " " + std::to_string(width) + " x " + std::to_string(height));
  std::mt19937 random(width * 1000 + height);
  const LpipsWeights weights = random_weights(network, random);
  const io::Image a = random_image(random, width, height), b = random_image(random, width, height);
  const Lpips lpips(network, weights);
  const double expected = naive_distance(network, weights, a, b);
  EXPECT_GT(expected, 1e-3);
  const double distance = lpips.distance(a, b, 1);
  EXPECT_NEAR(distance, expected, 1e-5 * expected);
  for (const uint32_t threads : {2u, 5u}) EXPECT_EQ(lpips.distance(a, b, threads), distance);
  EXPECT_EQ(lpips.distance(b, b, 2), 0);
}

// Strides, paddings, pooling and layers that are not compared, on all remainders of sizes.
TEST(Lpips, SmallNetworksAgreeWithDirectLoops) {
  const LpipsNetwork odd{"odd", {{0, 3, 5, 5, 3, 2}, {2, 5, 40, 3, 1, 1, 3, false}, {4, 40, 7, 1}}};
  const LpipsNetwork padded{"padded", {{0, 3, 4, 3, 2, 2}, {2, 4, 33, 2, 1, 0, 2}}};
  for (uint32_t side = 12; side < 20; ++side) {
    expect_as_naive(odd, side, 31 - side);
    expect_as_naive(padded, 31 - side, side);
  }
}

TEST(Lpips, AlexNetAgreesWithDirectLoops) { expect_as_naive(lpips_alexnet(), 64, 64); }

TEST(Lpips, Vgg16AgreesWithDirectLoops) { expect_as_naive(lpips_vgg16(), 33, 16); }

// The numbers of parameters and of layers that torchvision states of both trunks.
TEST(Lpips, NetworksHaveTheLayersOfTheirAuthors) {
  const auto parameters = [](const LpipsNetwork& network) {
    uint64_t count = 0;
    for (const LpipsLayer& l : network.layers) {
      count += uint64_t{l.out} * (uint64_t{l.in} * l.side * l.side + 1);
    }
    return count;
  };
  const auto compared = [](const LpipsNetwork& network) {
    std::vector<std::pair<uint32_t, uint32_t>> layers;  // index, channels
    for (const LpipsLayer& layer : network.layers) {
      if (layer.is_compared) layers.emplace_back(layer.index, layer.out);
    }
    return layers;
  };
  using Layers = std::vector<std::pair<uint32_t, uint32_t>>;
  EXPECT_EQ(parameters(lpips_alexnet()), 2469696u);
  EXPECT_EQ(parameters(lpips_vgg16()), 14714688u);
  EXPECT_EQ(compared(lpips_alexnet()), (Layers{{0, 64}, {3, 192}, {6, 384}, {8, 256}, {10, 256}}));
  EXPECT_EQ(compared(lpips_vgg16()), (Layers{{2, 64}, {7, 128}, {14, 256}, {21, 512}, {28, 512}}));
}

// One layer, whose features are the scaled red and green: white has 1.03 / 0.458 and 1.088 / 0.448,
// pure red has the same red, and a green below 0, which ReLU cuts.
TEST(Lpips, AgreesWithAnExampleByHand) {
  const LpipsNetwork network{"one", {{0, 3, 2, 1}}};
  const Lpips lpips(network, {{{1, 0, 0, 0, 1, 0}}, {{0, 0}}, {{2, 3}}});
  io::Image white(1, 2), red(1, 2);
  white.rgb = {1, 1, 1, 1, 1, 1};
  red.rgb = {1, 0, 0, 1, 1, 1};  // only the first pixel differs
  const double r = 1.03 / 0.458, g = 1.088 / 0.448, length = std::hypot(r, g);
  const double expected = (2 * std::pow(1 - r / length, 2) + 3 * std::pow(g / length, 2)) / 2;
  EXPECT_NEAR(lpips.distance(white, red, 1), expected, 1e-6);
  EXPECT_NEAR(lpips.distance(red, white, 1), expected, 1e-6);
  EXPECT_EQ(lpips.distance(white, white, 1), 0);
  // Values beyond the range are clamped, and what is no number is black.
  red.rgb = {7, -1, std::nanf(""), 2, 1, 1};
  EXPECT_NEAR(lpips.distance(white, red, 1), expected, 1e-6);
}

// Features of length 0, as black has here, are no division by 0.
TEST(Lpips, FeaturesMayBeZero) {
  const Lpips lpips({"one", {{0, 3, 1, 1}}}, {{{1, 0, 0}}, {{0}}, {{1}}});
  io::Image black(2, 2), white(2, 2);
  white.rgb.assign(white.rgb.size(), 1.0f);
  EXPECT_EQ(lpips.distance(black, black, 1), 0);
  EXPECT_NEAR(lpips.distance(black, white, 1), 1, 1e-9);
}

std::string message_of(const std::function<void()>& f) {
  try {
    f();
  } catch (const io::Error& error) {
    return error.what();
  }
  return "nothing is thrown";
}

TEST(Lpips, RefusesImagesThatAreTooSmallOrDiffer) {
  const Lpips alex(lpips_alexnet(), {}), vgg(lpips_vgg16(), {});
  alex.check_size(31, 31);
  vgg.check_size(16, 16);
  EXPECT_EQ(message_of([&] { alex.check_size(100, 30); }),
            "LPIPS with \"alex\" needs images of at least 31 pixels a side; these have 100 x 30");
  EXPECT_THAT(message_of([&] { vgg.check_size(15, 400); }), testing::HasSubstr("at least 16"));
  EXPECT_THAT(message_of([&] { alex.distance(io::Image(40, 40), io::Image(40, 41), 1); }),
              testing::HasSubstr("differ in size"));
}

// A file with the weights of a network, under the names that training/README.md states.
std::vector<uint8_t> file_of(const LpipsNetwork& network, const LpipsWeights& weights,
                             const std::string& leave_out = "") {
  std::string header =
      "{\"classifier.0.weight\":{\"dtype\":\"F16\",\"shape\":[0],\"data_offsets\":[0,0]}";
  std::vector<float> values;
  const auto add = [&](const std::string& name, const std::string& shape,
                       const std::vector<float>& of_tensor) {
    if (name == leave_out) return;
    const size_t begin = 4 * values.size();
    values.insert(values.end(), of_tensor.begin(), of_tensor.end());
    header += ",\"" + name + "\":{\"dtype\":\"F32\",\"shape\":" + shape + ",\"data_offsets\":[" +
              std::to_string(begin) + "," + std::to_string(4 * values.size()) + "]}";
  };
  size_t compared = 0;
  for (size_t k = 0; k < network.layers.size(); ++k) {
    const LpipsLayer& layer = network.layers[k];
    const std::string name = "features." + std::to_string(layer.index);
    const std::string out = std::to_string(layer.out), side = std::to_string(layer.side);
    add(name + ".bias", "[" + out + "]", weights.biases[k]);
    add(name + ".weight",
        "[" + out + "," + std::to_string(layer.in) + "," + side + "," + side + "]",
        weights.weights[k]);
    if (!layer.is_compared) continue;
    add("lin" + std::to_string(compared) + ".model.1.weight", "[1," + out + ",1,1]",
        weights.linear[compared]);
    ++compared;
  }
  return test::safetensors_file(header + "}", values);
}

Lpips read(std::vector<uint8_t> bytes) {
  return Lpips::read(io::InputFile("weights", std::move(bytes)));
}

TEST(Lpips, ReadsTheNetworkFromAFile) {
  std::mt19937 random(5);
  const io::Image a = random_image(random, 48, 40), b = random_image(random, 48, 40);
  for (const LpipsNetwork& network : {lpips_alexnet(), lpips_vgg16()}) {
    const LpipsWeights weights = random_weights(network, random);
    const Lpips lpips = read(file_of(network, weights));
    EXPECT_EQ(lpips.network(), network.name);
    EXPECT_EQ(lpips.distance(a, b, 2), Lpips(network, weights).distance(a, b, 2));
  }
}

TEST(Lpips, RefusesFilesOfOtherNetworks) {
  std::mt19937 random(6);
  const LpipsNetwork alex = lpips_alexnet();
  const LpipsWeights weights = random_weights(alex, random);
  EXPECT_THAT(message_of([&] { read(file_of(alex, weights, "lin3.model.1.weight")); }),
              testing::HasSubstr("there is no tensor lin3.model.1.weight"));
  EXPECT_THAT(message_of([&] { read(file_of(alex, weights, "features.0.weight")); }),
              testing::HasSubstr("there is no tensor features.0.weight"));
  const LpipsNetwork other{"other", {{0, 3, 64, 7, 2, 3}}};
  EXPECT_THAT(message_of([&] { read(file_of(other, random_weights(other, random))); }),
              testing::HasSubstr("the shape of neither AlexNet nor VGG16"));
  LpipsNetwork changed = lpips_alexnet();
  changed.layers[2].side = 5;
  EXPECT_THAT(message_of([&] { read(file_of(changed, random_weights(changed, random))); }),
              testing::HasSubstr("features.6.weight has the shape [384, 192, 5, 5]; it must be "
                                 "[384, 192, 3, 3]"));
}

}  // namespace
}  // namespace l4d::eval
