// SPDX-License-Identifier: Apache-2.0
// Compressed 3DGS PLY, as read_compressed_ply.cc reads it, with ranges of colours.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numeric>

#include "io/file/file.h"
#include "io/file/little_endian.h"
#include "io/ply/compressed_ply.h"
#include "io/ply/scene_ply.h"
#include "io/scene/shape3.h"
#include "libl4dcodec/scene/morton.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {
namespace {

using Bytes = std::vector<uint8_t>;

constexpr double kMostScale = 20;  // of logarithms, either way: what the format's own writer keeps

// The nearest fraction of [least, most] in so many bits.
uint32_t code_of(double value, float least, float most, unsigned bits) {
  const double range = static_cast<double>(most) - static_cast<double>(least);
  const double steps = std::ldexp(1.0, static_cast<int>(bits)) - 1;
  const double share = range > 0 ? (value - static_cast<double>(least)) / range : 0;
  return static_cast<uint32_t>(std::lround(std::clamp(share, 0.0, 1.0) * steps));
}

uint32_t code_of(const double* v, const float* range) {
  return code_of(v[0], range[0], range[3], 11) << 21 | code_of(v[1], range[1], range[4], 10) << 11 |
         code_of(v[2], range[2], range[5], 11);
}

// The largest of w x y z is left out, and positive.
uint32_t code_of_rotation(const Vec4& wxyz) {
  size_t largest = 0;
  for (size_t k = 1; k < 4; ++k) {
    if (std::fabs(wxyz[k]) > std::fabs(wxyz[largest])) largest = k;
  }
  uint32_t code = static_cast<uint32_t>(largest);
  for (size_t k = 0; k < 4; ++k) {
    if (k == largest) continue;
    const double x = wxyz[largest] < 0 ? -wxyz[k] : wxyz[k];
    code = code << 10 | code_of(x / std::sqrt(2.0) + 0.5, 0, 1, 10);
  }
  return code;
}

// A byte is the middle of its step, but for the ends of the range of 8.
uint8_t code_of_harmonic(double value) {
  return static_cast<uint8_t>(std::clamp(std::floor((value / 8 + 0.5) * 256), 0.0, 255.0));
}

// Along a Morton curve, so that a chunk has neighbours.
std::vector<uint32_t> order_of(const Splats& splats) {
  std::array<float, 3> least{}, most{};
  for (size_t k = 0; k < 3; ++k) {
    least[k] = most[k] = splats.count() > 0 ? splats.position[k] : 0;
    for (size_t i = k; i < splats.position.size(); i += 3) {
      least[k] = std::min(least[k], splats.position[i]);
      most[k] = std::max(most[k], splats.position[i]);
    }
  }
  std::vector<uint64_t> key(splats.count());
  for (size_t i = 0; i < splats.count(); ++i) {
    std::array<uint32_t, 3> code{};
    for (size_t k = 0; k < 3; ++k) {
      code[k] = code_of(static_cast<double>(splats.position[3 * i + k]), least[k], most[k], 16);
    }
    key[i] = morton_code(code[0], code[1], code[2]);
  }
  std::vector<uint32_t> order(splats.count());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(),
            [&](uint32_t a, uint32_t b) { return key[a] != key[b] ? key[a] < key[b] : a < b; });
  return order;
}

// Numbers of a Gaussian that have a range in each chunk: position, logarithms of scales, colour.
struct Row {
  std::array<double, 9> numbers{};
  Vec4 wxyz{};
};

Row row_of(const Splats& splats, size_t i) {
  Row row;
  const Shape3 shape = shape_of_covariance(&splats.covariance[6 * i]);
  const size_t width = size_t{3} * sh_terms(splats.sh_degree);
  for (size_t k = 0; k < 3; ++k) {
    row.numbers[k] = static_cast<double>(splats.position[3 * i + k]);
    row.numbers[3 + k] = std::clamp(std::log(shape.scale[k]), -kMostScale, kMostScale);
    row.numbers[6 + k] = 0.5 + sh_constant::k0 * static_cast<double>(splats.sh[width * i + k]);
  }
  row.wxyz = shape.wxyz;
  return row;
}

void append_float(Bytes* bytes, float value) {
  uint32_t bits = 0;
  std::memcpy(&bits, &value, sizeof(bits));
  append_little_endian(bytes, bits, 4);
}

std::string header_of(const Splats& splats, size_t chunks) {
  const auto element = [](const char* name, size_t count) {
    return "element " + std::string(name) + " " + std::to_string(count) + "\n";
  };
  std::string text = "ply\nformat binary_little_endian 1.0\n" + element("chunk", chunks);
  for (const char* name : kRangeNames) text += std::string("property float ") + name + "\n";
  text += element("vertex", splats.count());
  for (const char* name : kPackedNames) text += std::string("property uint ") + name + "\n";
  const size_t rest = size_t{3} * (sh_terms(splats.sh_degree) - 1);
  if (rest > 0) text += element("sh", splats.count());
  for (size_t k = 0; k < rest; ++k) text += "property uchar f_rest_" + std::to_string(k) + "\n";
  return text + "end_header\n";
}

}  // namespace

WriteNotes write_compressed_ply(const std::string& path, const Splats& splats, const Hold& holder,
                                const Check& check) {
  const size_t count = splats.count(), chunks = (count + kPlyChunk - 1) / kPlyChunk;
  // The order, packed numbers and ranges.
  const auto memory =
      hold(holder, count * (8 + 4 + 16) + chunks * kRanges * 4, path + " as compressed PLY");
  const std::vector<uint32_t> order = order_of(splats);
  Bytes ranges, packed;
  ranges.reserve(chunks * kRanges * sizeof(float));
  packed.reserve(count * 4 * sizeof(uint32_t));
  uint64_t limited = 0;
  for (size_t begin = 0; begin < count; begin += kPlyChunk) {
    const size_t size = std::min<size_t>(kPlyChunk, count - begin);
    std::vector<Row> rows;
    std::array<float, kRanges> range{};
    for (size_t j = 0; j < size; ++j) {
      rows.push_back(row_of(splats, order[begin + j]));
      for (size_t k = 0; k < 9; ++k) {
        const float x = static_cast<float>(rows[j].numbers[k]);
        float& least = range[6 * (k / 3) + k % 3];
        float& most = range[6 * (k / 3) + 3 + k % 3];
        least = j == 0 ? x : std::min(least, x);
        most = j == 0 ? x : std::max(most, x);
      }
    }
    for (const float x : range) append_float(&ranges, x);
    for (size_t j = 0; j < size; ++j) {
      const double* n = rows[j].numbers.data();
      append_little_endian(&packed, code_of(n, &range[kPositionRange]), 4);
      append_little_endian(&packed, code_of_rotation(rows[j].wxyz), 4);
      append_little_endian(&packed, code_of(n + 3, &range[kScaleRange]), 4);
      uint32_t color = 0;
      for (size_t k = 0; k < 3; ++k) {
        color =
            color << 8 | code_of(n[6 + k], range[kColorRange + k], range[kColorRange + 3 + k], 8);
      }
      const double opacity = static_cast<double>(splats.opacity[order[begin + j]]);
      append_little_endian(&packed, color << 8 | code_of(opacity, 0, 1, 8), 4);
    }
  }
  OutputFile file(path, check);
  const std::string header = header_of(splats, chunks);
  file.write(header.data(), header.size());
  file.write(ranges.data(), ranges.size());
  file.write(packed.data(), packed.size());
  const size_t terms = sh_terms(splats.sh_degree);
  Bytes row;
  for (const uint32_t i : order) {
    row.clear();
    bool is_limited = false;
    for (size_t channel = 0; channel < 3; ++channel) {
      for (size_t k = 1; k < terms; ++k) {
        const double value = static_cast<double>(splats.sh[3 * (terms * i + k) + channel]);
        is_limited = is_limited || std::fabs(value) > 4;
        row.push_back(code_of_harmonic(value));
      }
    }
    limited += is_limited;
    file.write(row.data(), row.size());
  }
  file.commit();
  if (limited == 0) return {};
  return {{"Gaussians had spherical harmonics outside -4 to 4, now limited", limited}};
}

}  // namespace l4d::io
