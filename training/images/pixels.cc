// SPDX-License-Identifier: Apache-2.0
#include "training/images/pixels.h"

#include <algorithm>
#include <cmath>

namespace l4d::train {
namespace {

uint8_t byte_of(double value) {
  return static_cast<uint8_t>(std::clamp(std::lround(value * 255), 0L, 255L));
}

// The part of [k, k + 1) x `step` that each source pixel has: first pixel, and weights that sum
// to 1.
struct Share {
  size_t first;
  std::vector<double> weights;
};
std::vector<Share> shares(uint32_t from, uint32_t to) {
  std::vector<Share> out(to);
  const double step = static_cast<double>(from) / to;
  for (uint32_t k = 0; k < to; ++k) {
    const double begin = k * step, end = std::min((k + 1) * step, static_cast<double>(from));
    Share& share = out[k];
    share.first = static_cast<size_t>(begin);
    for (size_t i = share.first; static_cast<double>(i) < end - 1e-9; ++i) {
      const double low = std::max(begin, static_cast<double>(i));
      share.weights.push_back((std::min(end, static_cast<double>(i + 1)) - low) / (end - begin));
    }
  }
  return out;
}

// What averages of one value each are, faster: reading images is a large part of short trainings.
std::vector<uint8_t> bytes_of(const std::vector<float>& values) {
  std::vector<uint8_t> bytes(values.size());
  for (size_t i = 0; i < values.size(); ++i) {
    const double value = static_cast<double>(values[i]) * 255 + 0.5;
    bytes[i] = static_cast<uint8_t>(static_cast<int>(std::clamp(value, 0.0, 255.5)));
  }
  return bytes;
}

}  // namespace

l4d_camera scaled_camera(const l4d_camera& camera, double scale) {
  l4d_camera out = camera;
  const auto size = [&](uint32_t pixels) {
    return static_cast<uint32_t>(std::max(1L, std::lround(pixels * scale)));
  };
  out.width = size(camera.width);
  out.height = size(camera.height);
  const double sx = static_cast<double>(out.width) / camera.width;
  const double sy = static_cast<double>(out.height) / camera.height;
  out.fx *= sx;
  out.cx *= sx;
  out.fy *= sy;
  out.cy *= sy;
  return out;
}

Pixels resized(const io::Image& image, const std::vector<float>& alpha, uint32_t width,
               uint32_t height) {
  Pixels out;
  out.width = width;
  out.height = height;
  if (width == image.width && height == image.height) {
    out.rgb = bytes_of(image.rgb);
    out.alpha = bytes_of(alpha);
    return out;
  }
  out.rgb.resize(size_t{3} * width * height);
  if (!alpha.empty()) out.alpha.resize(size_t{width} * height);
  const std::vector<Share> columns = shares(image.width, width),
                           rows = shares(image.height, height);
  for (size_t y = 0; y < height; ++y) {
    for (size_t x = 0; x < width; ++x) {
      double sum[3] = {0, 0, 0}, plain[3] = {0, 0, 0}, covered = 0;
      for (size_t j = 0; j < rows[y].weights.size(); ++j) {
        for (size_t i = 0; i < columns[x].weights.size(); ++i) {
          const size_t at = (rows[y].first + j) * image.width + columns[x].first + i;
          const double weight = rows[y].weights[j] * columns[x].weights[i];
          const double a = alpha.empty() ? 1 : static_cast<double>(alpha[at]);
          covered += weight * a;
          for (size_t c = 0; c < 3; ++c) {
            const double value = static_cast<double>(image.rgb[3 * at + c]);
            sum[c] += weight * a * value;
            plain[c] += weight * value;
          }
        }
      }
      const size_t to = y * width + x;
      for (size_t c = 0; c < 3; ++c) {
        out.rgb[3 * to + c] = byte_of(covered > 1e-6 ? sum[c] / covered : plain[c]);
      }
      if (!alpha.empty()) out.alpha[to] = byte_of(covered);
    }
  }
  return out;
}

Pixels halved(const Pixels& in) {
  Pixels out;
  out.width = std::max(1u, in.width / 2);
  out.height = std::max(1u, in.height / 2);
  const auto average = [&](const std::vector<uint8_t>& from, size_t channels,
                           std::vector<uint8_t>* to) {
    to->resize(channels * out.width * out.height);
    for (size_t y = 0; y < out.height; ++y) {
      const size_t row[2] = {2 * y, std::min<size_t>(2 * y + 1, in.height - 1)};
      for (size_t x = 0; x < out.width; ++x) {
        const size_t column[2] = {2 * x, std::min<size_t>(2 * x + 1, in.width - 1)};
        for (size_t c = 0; c < channels; ++c) {
          unsigned sum = 2;
          for (const size_t r : row) {
            for (const size_t k : column) sum += from[(r * in.width + k) * channels + c];
          }
          (*to)[(y * out.width + x) * channels + c] = static_cast<uint8_t>(sum / 4);
        }
      }
    }
  };
  average(in.rgb, 3, &out.rgb);
  if (!in.alpha.empty()) average(in.alpha, 1, &out.alpha);
  return out;
}

io::Image image_of(const Pixels& pixels, const Colour& background) {
  io::Image image(pixels.width, pixels.height);
  io::from_bytes(pixels.rgb.data(), pixels.rgb.size(), image.rgb.data());
  for (size_t i = 0; i < pixels.alpha.size(); ++i) {
    const float alpha = static_cast<float>(pixels.alpha[i]) / 255;
    for (size_t c = 0; c < 3; ++c) {
      image.rgb[3 * i + c] = alpha * image.rgb[3 * i + c] + (1 - alpha) * background[c];
    }
  }
  return image;
}

void distort(const io::Distortion& d, double x, double y, double* out) {
  const double r2 = x * x + y * y;
  if (d.model == io::Distortion::Model::kFisheye) {
    const double r = std::sqrt(r2), theta = std::atan(r), t2 = theta * theta;
    const double scale = theta * (1 + t2 * (d.k[0] + t2 * (d.k[1] + t2 * (d.k[2] + t2 * d.k[3]))));
    const double factor = r > 1e-12 ? scale / r : 1;
    out[0] = x * factor;
    out[1] = y * factor;
    return;
  }
  const double factor = (1 + r2 * (d.k[0] + r2 * (d.k[1] + r2 * d.k[2]))) /
                        (1 + r2 * (d.k[3] + r2 * (d.k[4] + r2 * d.k[5])));
  out[0] = x * factor + 2 * d.p[0] * x * y + d.p[1] * (r2 + 2 * x * x);
  out[1] = y * factor + d.p[0] * (r2 + 2 * y * y) + 2 * d.p[1] * x * y;
}

Undistortion::Undistortion(const l4d_camera& camera, const io::Distortion& distortion)
    : width_(camera.width),
      height_(camera.height),
      source_(size_t{2} * width_ * height_),
      mask_(size_t{width_} * height_, 255) {
  for (size_t v = 0; v < height_; ++v) {
    for (size_t u = 0; u < width_; ++u) {
      const double x = (static_cast<double>(u) + 0.5 - camera.cx) / camera.fx;
      const double y = (static_cast<double>(v) + 0.5 - camera.cy) / camera.fy;
      double d[2];
      distort(distortion, x, y, d);
      // In pixels whose centres have whole numbers.
      const double su = camera.fx * d[0] + camera.cx - 0.5;
      const double sv = camera.fy * d[1] + camera.cy - 0.5;
      const size_t at = v * width_ + u;
      source_[2 * at] = static_cast<float>(su);
      source_[2 * at + 1] = static_cast<float>(sv);
      const bool inside = su >= -0.5 && sv >= -0.5 && su <= width_ - 0.5 && sv <= height_ - 0.5;
      if (!inside) mask_[at] = 0;
    }
  }
}

io::Image Undistortion::apply(const io::Image& image) const {
  io::Image out(width_, height_);
  const auto clamped = [](float x, uint32_t size) {
    return std::clamp(x, 0.0f, static_cast<float>(size - 1));
  };
  for (size_t at = 0; at < mask_.size(); ++at) {
    if (mask_[at] == 0) continue;
    const float u = clamped(source_[2 * at], width_), v = clamped(source_[2 * at + 1], height_);
    const size_t u0 = static_cast<size_t>(u), v0 = static_cast<size_t>(v);
    const size_t u1 = std::min<size_t>(u0 + 1, width_ - 1),
                 v1 = std::min<size_t>(v0 + 1, height_ - 1);
    const float a = u - static_cast<float>(u0), b = v - static_cast<float>(v0);
    for (size_t c = 0; c < 3; ++c) {
      const auto pixel = [&](size_t y, size_t x) { return image.rgb[3 * (y * width_ + x) + c]; };
      out.rgb[3 * at + c] = (1 - b) * ((1 - a) * pixel(v0, u0) + a * pixel(v0, u1)) +
                            b * ((1 - a) * pixel(v1, u0) + a * pixel(v1, u1));
    }
  }
  return out;
}

}  // namespace l4d::train
