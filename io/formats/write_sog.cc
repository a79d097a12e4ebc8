// SPDX-License-Identifier: Apache-2.0
#include "io/formats/write_sog.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "io/formats/clusters.h"
#include "io/formats/webp.h"
#include "io/formats/zip.h"
#include "io/scene/shape3.h"

namespace l4d::io {
namespace {

using Json = nlohmann::json;

constexpr size_t kCentroidsOfRow = 64;  // in the image of the palette
constexpr size_t kMostCentroids = 65536;

// Two zeros behind each of 10 bits.
uint32_t spread_bits(uint32_t x) {
  x = (x | x << 16) & 0x030000ff;
  x = (x | x << 8) & 0x0300f00f;
  x = (x | x << 4) & 0x030c30c3;
  return (x | x << 2) & 0x09249249;
}

// Rows by their place on a Z-shaped curve.
std::vector<uint32_t> order_in_space(const Splats& splats) {
  const size_t n = splats.count();
  std::vector<uint32_t> places(n), order(n);
  for (size_t k = 0; k < 3; ++k) {
    float least = splats.position[k], most = least;
    for (size_t i = 0; i < n; ++i) {
      least = std::min(least, splats.position[3 * i + k]);
      most = std::max(most, splats.position[3 * i + k]);
    }
    const double extent = static_cast<double>(most) - static_cast<double>(least);
    for (size_t i = 0; i < n && extent > 0; ++i) {
      const double from =
          static_cast<double>(splats.position[3 * i + k]) - static_cast<double>(least);
      places[i] |= spread_bits(static_cast<uint32_t>(from / extent * 1023)) << k;
    }
  }
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(),
                   [&](uint32_t a, uint32_t b) { return places[a] < places[b]; });
  return order;
}

double log_of(float x) {
  const double value = static_cast<double>(x);
  return std::copysign(std::log1p(std::fabs(value)), value);
}

class SogWriter {
 public:
  SogWriter(const std::string& path, const Splats& splats, const Check& check)
      : path_(path), splats_(splats), check_(check), order_(order_in_space(splats)), zip_(path) {
    const double side = std::ceil(std::sqrt(static_cast<double>(splats.count())) / 4) * 4;
    width_ = static_cast<uint32_t>(side);
    height_ = static_cast<uint32_t>((splats.count() + width_ - 1) / width_);
  }

  void write() {
    Json meta = {{"version", 2},
                 {"asset", {{"generator", "l4dcodec"}}},
                 {"count", splats_.count()},
                 {"means", means()}};
    add_shapes(&meta);
    meta["sh0"] = colors();
    if (splats_.sh_degree > 0) meta["shN"] = harmonics();
    const std::string text = meta.dump();
    zip_.add("meta.json", text.data(), text.size());
    zip_.commit();
  }

 private:
  // Pixel k is of Gaussian order_[k].
  template <typename Row>
  void add_image(const std::string& name, const Row& row) {
    call(check_);
    RgbaImage image{width_, height_, {}, nullptr};
    image.rgba.resize(4 * image.pixels());
    for (size_t k = 0; k < order_.size(); ++k) row(order_[k], &image.rgba[4 * k]);
    add(name, image);
  }
  void add(const std::string& name, const RgbaImage& image) {
    const std::vector<uint8_t> bytes = encode_webp(image, path_ + ": " + name);
    zip_.add(name, bytes.data(), bytes.size());
  }

  Json means() {
    std::array<double, 3> least{}, most{};
    for (size_t i = 0; i < splats_.count(); ++i) {
      for (size_t k = 0; k < 3; ++k) {
        const double x = log_of(splats_.position[3 * i + k]);
        least[k] = i == 0 ? x : std::min(least[k], x);
        most[k] = i == 0 ? x : std::max(most[k], x);
      }
    }
    const auto code = [&](size_t i, size_t k) {
      if (!(most[k] > least[k])) return 0U;
      const double t = (log_of(splats_.position[3 * i + k]) - least[k]) / (most[k] - least[k]);
      return static_cast<uint32_t>(std::lround(65535 * t));
    };
    for (const unsigned shift : {0U, 8U}) {
      add_image(shift == 0 ? "means_l.webp" : "means_u.webp", [&](size_t i, uint8_t* pixel) {
        for (size_t k = 0; k < 3; ++k) pixel[k] = static_cast<uint8_t>(code(i, k) >> shift);
        pixel[3] = 255;
      });
    }
    return {{"mins", least}, {"maxs", most}, {"files", {"means_l.webp", "means_u.webp"}}};
  }

  // Rotations and scales.
  void add_shapes(Json* meta) {
    std::vector<Shape3> shapes;
    std::vector<float> logs;
    shapes.reserve(splats_.count());
    logs.reserve(3 * splats_.count());
    for (size_t i = 0; i < splats_.count(); ++i) {
      shapes.push_back(shape_of_covariance(&splats_.covariance[6 * i]));
      for (const double s : shapes.back().scale) logs.push_back(static_cast<float>(std::log(s)));
    }
    const std::vector<float> book = codebook_of(logs);
    add_image("scales.webp", [&](size_t i, uint8_t* pixel) {
      for (size_t k = 0; k < 3; ++k) pixel[k] = nearest_code(book, logs[3 * i + k]);
      pixel[3] = 255;
    });
    add_image("quats.webp",
              [&](size_t i, uint8_t* pixel) { pack_quaternion(shapes[i].wxyz, pixel); });
    (*meta)["scales"] = {{"codebook", book}, {"files", {"scales.webp"}}};
    (*meta)["quats"] = {{"files", {"quats.webp"}}};
  }

  // The largest of w x y z is left out, and positive.
  static void pack_quaternion(const Vec4& wxyz, uint8_t* pixel) {
    size_t largest = 0;
    for (size_t k = 1; k < 4; ++k) {
      if (std::fabs(wxyz[k]) > std::fabs(wxyz[largest])) largest = k;
    }
    const double sign = wxyz[largest] < 0 ? -1 : 1;
    for (size_t k = 0, next = 0; k < 4; ++k) {
      if (k == largest) continue;
      const double x = sign * wxyz[k] * std::sqrt(2.0);
      pixel[next++] = static_cast<uint8_t>(std::clamp(std::lround(127.5 * (x + 1)), 0L, 255L));
    }
    pixel[3] = static_cast<uint8_t>(252 + largest);
  }

  Json colors() {
    const size_t numbers = size_t{3} * (splats_.sh_degree + 1) * (splats_.sh_degree + 1);
    std::vector<float> base;
    base.reserve(3 * splats_.count());
    for (size_t i = 0; i < splats_.count(); ++i) {
      base.insert(base.end(), &splats_.sh[numbers * i], &splats_.sh[numbers * i] + 3);
    }
    const std::vector<float> book = codebook_of(base);
    add_image("sh0.webp", [&](size_t i, uint8_t* pixel) {
      for (size_t k = 0; k < 3; ++k) pixel[k] = nearest_code(book, base[3 * i + k]);
      const double opacity = std::clamp(static_cast<double>(splats_.opacity[i]), 0.0, 1.0);
      pixel[3] = static_cast<uint8_t>(std::lround(255 * opacity));
    });
    return {{"codebook", book}, {"files", {"sh0.webp"}}};
  }

  Json harmonics() {
    const size_t rest = (size_t{splats_.sh_degree} + 1) * (splats_.sh_degree + 1) - 1;
    std::vector<float> rows;
    rows.reserve(3 * rest * splats_.count());
    for (size_t i = 0; i < splats_.count(); ++i) {
      const float* sh = &splats_.sh[3 * (rest + 1) * i];
      rows.insert(rows.end(), sh + 3, sh + 3 * (rest + 1));
    }
    size_t most = 1;
    while (2 * most <= std::min(splats_.count(), kMostCentroids)) most *= 2;
    const RowPalette palette = palette_of(rows, 3 * rest, most, check_);
    const size_t count = palette.centroids.size() / (3 * rest);
    const std::vector<float> book = codebook_of(palette.centroids);
    add_image("shN_labels.webp", [&](size_t i, uint8_t* pixel) {
      pixel[0] = static_cast<uint8_t>(palette.labels[i]);
      pixel[1] = static_cast<uint8_t>(palette.labels[i] >> 8);
      pixel[3] = 255;
    });
    RgbaImage image{static_cast<uint32_t>(kCentroidsOfRow * rest),
                    static_cast<uint32_t>((count + kCentroidsOfRow - 1) / kCentroidsOfRow),
                    {},
                    nullptr};
    image.rgba.resize(4 * image.pixels());
    for (size_t k = 0; k < count * rest; ++k) {
      for (size_t c = 0; c < 3; ++c) {
        image.rgba[4 * k + c] = nearest_code(book, palette.centroids[3 * k + c]);
      }
      image.rgba[4 * k + 3] = 255;
    }
    add("shN_centroids.webp", image);
    return {{"count", count},
            {"bands", splats_.sh_degree},
            {"codebook", book},
            {"files", {"shN_centroids.webp", "shN_labels.webp"}}};
  }

  std::string path_;
  const Splats& splats_;
  const Check& check_;
  std::vector<uint32_t> order_;
  ZipWriter zip_;
  uint32_t width_ = 0, height_ = 0;
};

// What is there at once at most: shapes, logarithms and their codebook, or the rows of spherical
// harmonics, how they are divided, and the palette; and always an image and what libwebp makes of
// it.
uint64_t bytes_to_write(uint64_t count, uint32_t degree) {
  constexpr uint64_t kOrder = 8, kImage = 64;
  constexpr uint64_t kShapes = sizeof(Shape3) + 12 + 3 * (4 + 2 * 8);
  const uint64_t rest = uint64_t{3} * degree * (degree + 2);  // numbers of a Gaussian
  const uint64_t rows =
      count * (4 * rest + 16) + 32 * rest * std::min<uint64_t>(count, kMostCentroids);
  return count * (kOrder + kImage) + std::max(count * kShapes, rows);
}

}  // namespace

WriteNotes write_sog(const std::string& path, Splats splats, const InstantSetting& setting) {
  require_finite(splats, path);
  if (splats.count() == 0) {
    throw Error(L4D_ERR_INVALID_SCENE, path + ": SOG has no image without pixels");
  }
  const auto memory =
      hold(setting.holder, bytes_to_write(splats.count(), splats.sh_degree), path + " as SOG");
  SogWriter(path, splats, setting.check).write();
  return {};
}

}  // namespace l4d::io
