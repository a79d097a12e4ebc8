// SPDX-License-Identifier: Apache-2.0
#include "eval/jod/jod.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "libl4dcodec/base/threads.h"

namespace l4d::eval {
namespace {

constexpr JodDisplay kDisplays[] = {{"standard_4k", 75.402449}, {"standard_fhd", 37.842504}};
constexpr uint32_t kLeastSide = 8;
constexpr uint32_t kRows = 16;  // of a piece of work
// Light of both displays, cd/m^2: of white, of black, and what is reflected of 250 lux.
constexpr double kPeak = 200, kBlack = 0.2, kReflected = 0.397887;
// From the light of red, green and blue: achromatic, red to green, violet to yellow.
constexpr float kToAxes[3][3] = {{0.2332012107F, 0.7288307890F, 0.0889958693F},
                                 {0.1276207712F, -0.0870680876F, -0.0367773906F},
                                 {-0.2148225086F, -0.6262536922F, 0.8514033270F}};
constexpr float kLeastLight = 0.01F, kMostContrast = 1000;
// Masking.
constexpr float kGain[kJodChannels] = {1, 1.45F, 1, 1};
constexpr float kMaskFactor = 0.1601411270F;
constexpr float kMaskPower[kJodChannels] = {1.3026227F, 2.8885908F, 3.6807714F, 3.5887773F};
constexpr float kPower = 2.264355182647705F;
constexpr float kMostDifference = 366.6447430F;
constexpr float kMaskedBy[kJodChannels][kJodChannels] = {  // row: what masks
    {0.87690895F, 0.01604034F, 0.05012430F, 0.26203679F},
    {5.91984494F, 1.26932994F, 0.15181156F, 0.70855784F},
    {14.04356390F, 0.49821122F, 0.69769207F, 0.67578453F},
    {0.00752146F, 0.02168512F, 0.08773876F, 0.23519839F}};

// safe_power() of a pixel.
class Power {
 public:
  explicit Power(float exponent) : exponent_(exponent), least_(std::pow(kLeast, exponent)) {}
  float operator()(float x) const {
    return x > 0 ? std::pow(x + kLeast, exponent_) - least_ : 0.0F;
  }

 private:
  static constexpr float kLeast = 1e-5F;
  float exponent_, least_;
};

// The response of a channel to a frequency, Hz.
double response(size_t channel, double hz) {
  constexpr double kScale[3] = {5.79336, 14.1255, 6.63661};
  constexpr double kBend[3] = {1.3314, 1.1196, 0.947901};
  if (channel < 3) return std::exp(-std::pow(hz, kBend[channel]) / kScale[channel]);
  constexpr double kTransient = 0.1898, kMiddle = 5, kWidth = 0.12314;
  const double apart = std::pow(hz, kTransient) - std::pow(kMiddle, kTransient);
  return std::exp(-apart * apart / kWidth);
}

// A symmetric filter over the frames until now.
std::vector<float> filter_of(size_t channel, double fps) {
  constexpr double kQuarter = 0.25, kTurn = 6.283185307179586;
  const size_t half = static_cast<size_t>(std::ceil(kQuarter * fps / 2)), n = 2 * half + 1;
  std::vector<float> taps(n);
  for (size_t j = 0; j < n; ++j) {
    const double at = static_cast<double>(j) - static_cast<double>(half);
    double sum = response(channel, 0);
    for (size_t k = 1; k <= half; ++k) {
      const double hz = static_cast<double>(k) * fps / static_cast<double>(n - 1);
      sum += 2 * response(channel, hz) *
             std::cos(kTurn * static_cast<double>(k) * at / static_cast<double>(n));
    }
    taps[j] = static_cast<float>(sum / static_cast<double>(n));
  }
  return taps;
}

float light_of(float value) {
  const float v = value > 0 ? std::min(value, 1.0F) : 0.0F;
  const float linear = v > 0.04045F ? std::pow((v + 0.055F) / 1.055F, 2.4F) : v / 12.92F;
  return static_cast<float>(kPeak - kBlack) * linear + static_cast<float>(kBlack + kReflected);
}

template <typename Body>
void for_rows(uint32_t rows, uint32_t threads, const Body& body) {
  parallel_for(static_cast<int>(threads), rows, kRows, [&](size_t begin, size_t end) {
    for (size_t y = begin; y < end; ++y) body(static_cast<uint32_t>(y));
  });
}

// The root of the mean of squares, each a little off as everywhere here.
double pooled_pixels(const std::vector<double>& sums, const Plane& plane) {
  double sum = 0;
  for (const double row : sums) sum += row;
  return safe_power(sum / static_cast<double>(plane.values.size()), 0.5);
}

}  // namespace

const JodDisplay* find_jod_display(const std::string& name) {
  for (const JodDisplay& display : kDisplays) {
    if (name == display.name) return &display;
  }
  return nullptr;
}

double video_rate(const std::vector<double>& times) {
  constexpr double kTolerance = 1e-3;  // of a step
  if (times.size() < 2) return 0;
  const double step = (times.back() - times.front()) / static_cast<double>(times.size() - 1);
  if (!(step > 0)) return 0;
  for (size_t k = 0; k < times.size(); ++k) {
    const double even = times[0] + static_cast<double>(k) * step;
    if (!(std::abs(times[k] - even) <= kTolerance * step)) return 0;
  }
  return 1 / step;
}

JodMeter::JodMeter(uint32_t width, uint32_t height, uint64_t frames, double fps,
                   const JodDisplay& display, uint32_t threads, const io::Hold& holder)
    : width_(width), height_(height), threads_(threads), channels_(frames == 1 ? 3 : 4) {
  if (width < kLeastSide || height < kLeastSide) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT, "JOD needs images of at least 8 x 8 pixels");
  }
  if (frames != 1 && !(fps > 0 && fps <= 1000)) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT, "JOD needs a frame rate of at most 1000");
  }
  bands_ = band_frequencies(width, height, display.pixels_per_degree);
  for (size_t c = 0; c < channels_; ++c) {
    filters_[c] = frames == 1 ? std::vector<float>{1} : filter_of(c, fps);
  }
  // The frames of the filter; channels of levels, their next ones, and what is made of both.
  constexpr uint64_t kLevelPlanes = 40;
  const uint64_t planes = kVideos * kAxes * filters_[0].size() + kLevelPlanes;
  memory_ = io::hold(holder, planes * sizeof(float) * width * height, "frames that JOD compares");
  for (auto& video : ring_) video.resize(filters_[0].size());
}

void JodMeter::keep(const io::Image& image, size_t video) {
  if (image.width != width_ || image.height != height_) {
    throw io::Error(L4D_ERR_INVALID_ARGUMENT, "the images differ in size");
  }
  auto& ring = ring_[video];
  std::array<Plane, kAxes>& planes = ring[frames_.size() % ring.size()];
  for (Plane& plane : planes) plane = Plane(width_, height_);
  for_rows(height_, threads_, [&](uint32_t y) {
    const float* rgb = &image.rgb[size_t{3} * width_ * y];
    for (uint32_t x = 0; x < width_; ++x) {
      float light[3];
      for (size_t c = 0; c < 3; ++c) light[c] = light_of(rgb[3 * x + c]);
      for (size_t axis = 0; axis < kAxes; ++axis) {
        const float* m = kToAxes[axis];
        planes[axis].row(y)[x] = m[0] * light[0] + m[1] * light[1] + m[2] * light[2];
      }
    }
  });
  // Before the first frame there are copies of it.
  if (!frames_.empty()) return;
  for (size_t k = 1; k < ring.size(); ++k) ring[k] = planes;
}

JodMeter::Channels JodMeter::filtered(size_t video) const {
  const auto& ring = ring_[video];
  const size_t n = ring.size(), now = frames_.size();
  Channels out;
  for (size_t c = 0; c < channels_; ++c) out[c] = Plane(width_, height_);
  for_rows(height_, threads_, [&](uint32_t y) {
    for (size_t c = 0; c < channels_; ++c) {
      float* to = out[c].row(y);
      for (size_t j = 0; j < n; ++j) {
        // The oldest first: now - n + 1 + j.
        const float* from = ring[(now + j + 1) % n][c == 3 ? 0 : c].row(y);
        const float tap = filters_[c][j];
        for (uint32_t x = 0; x < width_; ++x) to[x] += tap * from[x];
      }
    }
  });
  return out;
}

void JodMeter::compare_band(size_t band, const std::array<Channels, kVideos>& level,
                            const std::array<Channels, kVideos>& next, JodFrame* out) const {
  const uint32_t width = level[0][0].width, height = level[0][0].height;
  const float factor = band == 0 ? 1 : 2;
  std::array<Plane, kVideos> light;
  for (size_t v = 0; v < kVideos; ++v) light[v] = expand(next[v][0], width, height, threads_);
  // From here on: what is seen of each video, and what masks.
  std::array<Channels, kVideos> seen;
  Channels masks;
  for (size_t c = 0; c < channels_; ++c) {
    const Sensitivity sensitivity(c, bands_[band]);
    for (size_t v = 0; v < kVideos; ++v) {
      seen[v][c] = c == 0 ? light[v] : expand(next[v][c], width, height, threads_);
    }
    masks[c] = Plane(width, height);
    for_rows(height, threads_, [&](uint32_t y) {
      for (uint32_t x = 0; x < width; ++x) {
        const float back = std::max(light[1].row(y)[x], kLeastLight);
        const float weight = kGain[c] * sensitivity(Sensitivity::place_of(back));
        float least = 0;
        for (size_t v = 0; v < kVideos; ++v) {
          const float own = std::max(light[v].row(y)[x], kLeastLight);
          float& value = seen[v][c].row(y)[x];
          const float contrast = std::min((level[v][c].row(y)[x] - value) / own, kMostContrast);
          value = factor * contrast * weight;
          least = v == 0 ? std::abs(value) : std::min(least, std::abs(value));
        }
        masks[c].row(y)[x] = least;
      }
    });
    blur(&masks[c], threads_);
  }
  std::vector<Power> of_mask(std::begin(kMaskPower), std::end(kMaskPower));
  const Power of_difference(kPower);
  std::array<std::vector<double>, kJodChannels> sums;
  for (size_t c = 0; c < channels_; ++c) sums[c].resize(height);
  for_rows(height, threads_, [&](uint32_t y) {
    for (uint32_t x = 0; x < width; ++x) {
      float mask[kJodChannels];
      for (size_t c = 0; c < channels_; ++c) {
        mask[c] = of_mask[c](kMaskFactor * masks[c].row(y)[x]);
      }
      for (size_t c = 0; c < channels_; ++c) {
        float all = 1;
        for (size_t k = 0; k < channels_; ++k) all += kMaskedBy[k][c] * mask[k];
        const float apart = std::abs(seen[0][c].row(y)[x] - seen[1][c].row(y)[x]);
        const float masked = of_difference(apart) / all;
        const float limited = kMostDifference * masked / (kMostDifference + masked);
        sums[c][y] += safe_power(static_cast<double>(limited), 2);
      }
    }
  });
  for (size_t c = 0; c < channels_; ++c) (*out)[c].push_back(pooled_pixels(sums[c], light[0]));
}

void JodMeter::compare_base(const std::array<Channels, kVideos>& level, JodFrame* out) const {
  const Plane& any = level[0][0];
  double light[kVideos] = {};
  for (size_t v = 0; v < kVideos; ++v) {
    for (const float value : level[v][0].values) {
      light[v] += static_cast<double>(std::max(value, kLeastLight));
    }
    light[v] /= static_cast<double>(any.values.size());
  }
  for (size_t c = 0; c < channels_; ++c) {
    const Sensitivity sensitivity(c, bands_.back());
    const auto weight =
        static_cast<double>(sensitivity(Sensitivity::place_of(static_cast<float>(light[1]))));
    std::vector<double> sums(any.height);
    for (uint32_t y = 0; y < any.height; ++y) {
      for (uint32_t x = 0; x < any.width; ++x) {
        const double apart = static_cast<double>(level[0][c].row(y)[x]) / light[0] -
                             static_cast<double>(level[1][c].row(y)[x]) / light[1];
        sums[y] += safe_power(weight * std::abs(apart), 2);
      }
    }
    (*out)[c].push_back(pooled_pixels(sums, any));
  }
}

void JodMeter::add(const io::Image& test, const io::Image& reference) {
  keep(test, 0);
  keep(reference, 1);
  JodFrame frame;
  std::array<Channels, kVideos> level = {filtered(0), filtered(1)};
  for (size_t band = 0; band + 1 < bands_.size(); ++band) {
    std::array<Channels, kVideos> next;
    for (size_t v = 0; v < kVideos; ++v) {
      for (size_t c = 0; c < channels_; ++c) next[v][c] = reduce(level[v][c], threads_);
    }
    compare_band(band, level, next, &frame);
    level = std::move(next);
  }
  compare_base(level, &frame);
  frames_.push_back(std::move(frame));
}

}  // namespace l4d::eval
