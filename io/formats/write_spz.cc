// SPDX-License-Identifier: Apache-2.0
#include "io/formats/write_spz.h"

#include <zstd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "io/file/file.h"
#include "io/file/little_endian.h"
#include "io/scene/shape3.h"

namespace l4d::io {
namespace {

using Bytes = std::vector<uint8_t>;

constexpr uint32_t kSpzVersion = 4, kSpzHeader = 32;
constexpr int kMostFractionalBits = 16, kZstdLevel = 9;
constexpr int32_t kLargestPosition = (1 << 23) - 1;

uint8_t byte_of(double value, bool* limited) {
  const double rounded = std::round(value);
  *limited |= rounded < 0 || rounded > 255;
  return static_cast<uint8_t>(std::clamp(rounded, 0.0, 255.0));
}

int fractional_bits(const Splats& splats, const std::string& path) {
  double most = 0;
  for (const float x : splats.position) most = std::max(most, std::fabs(static_cast<double>(x)));
  int bits = kMostFractionalBits;
  while (bits >= 0 && std::ldexp(most, bits) > kLargestPosition) --bits;
  if (bits >= 0) return bits;
  throw Error(L4D_ERR_LIMIT_EXCEEDED,
              path + ": positions of SPZ are below 2^23; those of this scene reach further");
}

// The largest number of the quaternion is left out, and positive.
uint32_t pack_rotation(const Vec4& wxyz) {
  double xyzw[4];
  for (size_t k = 0; k < 4; ++k) xyzw[k] = wxyz[(k + 1) % 4];
  uint32_t largest = 0;
  for (uint32_t k = 1; k < 4; ++k) {
    if (std::fabs(xyzw[k]) > std::fabs(xyzw[largest])) largest = k;
  }
  uint32_t bits = largest;
  for (size_t k = 0; k < 4; ++k) {
    if (k == largest) continue;
    const double magnitude = std::round(std::fabs(xyzw[k]) * std::sqrt(2.0) * 511);
    const bool is_negative = (xyzw[k] < 0) != (xyzw[largest] < 0);
    bits =
        bits << 10 | (is_negative ? 512U : 0U) | static_cast<uint32_t>(std::min(magnitude, 511.0));
  }
  return bits;
}

// Positions, opacities, colours, scales, rotations, spherical harmonics.
std::array<Bytes, 6> streams_of(const Splats& splats, int bits, WriteNotes* notes) {
  std::array<Bytes, 6> out;
  uint64_t scales = 0, colors = 0, harmonics = 0;
  const size_t numbers = size_t{3} * (splats.sh_degree + 1) * (splats.sh_degree + 1);
  for (size_t i = 0; i < splats.count(); ++i) {
    bool scale_limited = false, color_limited = false, harmonic_limited = false, ignored = false;
    const Shape3 shape = shape_of_covariance(&splats.covariance[6 * i]);
    const float* sh = &splats.sh[numbers * i];
    for (size_t k = 0; k < 3; ++k) {
      const double position = static_cast<double>(splats.position[3 * i + k]);
      const auto fixed = static_cast<int32_t>(std::lround(std::ldexp(position, bits)));
      append_little_endian(&out[0], static_cast<uint32_t>(fixed), 3);
      const double color = 255 * (0.5 + 0.15 * static_cast<double>(sh[k]));
      out[2].push_back(byte_of(color, &color_limited));
      out[3].push_back(byte_of(16 * (std::log(shape.scale[k]) + 10), &scale_limited));
    }
    out[1].push_back(byte_of(255 * static_cast<double>(splats.opacity[i]), &ignored));
    append_little_endian(&out[4], pack_rotation(shape.wxyz), 4);
    for (size_t k = 3; k < numbers; ++k) {
      out[5].push_back(byte_of(128 * (1 + static_cast<double>(sh[k])), &harmonic_limited));
    }
    scales += scale_limited;
    colors += color_limited;
    harmonics += harmonic_limited;
  }
  if (scales > 0)
    notes->emplace("Gaussians had a scale outside e^-10 to e^5.9, now limited", scales);
  if (colors > 0) notes->emplace("Gaussians had a colour that SPZ has not, now limited", colors);
  if (harmonics > 0) {
    notes->emplace("Gaussians had spherical harmonics outside -1 to 1, now limited", harmonics);
  }
  return out;
}

Bytes compress(const Bytes& bytes, const std::string& path) {
  Bytes out(ZSTD_compressBound(bytes.size()));
  const size_t size = ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), kZstdLevel);
  if (ZSTD_isError(size) != 0) throw Error(L4D_ERR_OUT_OF_MEMORY, path);
  out.resize(size);
  return out;
}

}  // namespace

WriteNotes write_spz(const std::string& path, Splats splats, const InstantSetting& setting) {
  require_finite(splats, path);
  if (splats.count() > UINT32_MAX) {
    throw Error(L4D_ERR_LIMIT_EXCEEDED, path + ": an SPZ file has at most 2^32 - 1 Gaussians");
  }
  WriteNotes notes;
  turn_axes(setting.placement, L4D_COORDINATES_RIGHT_UP_BACK, &splats);
  if (setting.placement.coordinate_system == L4D_COORDINATES_UNKNOWN) {
    notes.emplace("the axes of the scene are not known; they are taken for those of SPZ, with y up",
                  0);
  }
  const int bits = fractional_bits(splats, path);
  // Bytes of each stream, of its growth, packed, and of the file.
  constexpr uint64_t kBytes = 9 + 1 + 3 + 3 + 4, kForms = 4;
  const uint64_t harmonics = uint64_t{3} * splats.sh_degree * (splats.sh_degree + 2);
  const auto memory =
      hold(setting.holder, kForms * (kBytes + harmonics) * splats.count(), path + " as SPZ");
  Bytes table, body;
  uint8_t streams = 0;
  for (const Bytes& stream : streams_of(splats, bits, &notes)) {
    if (stream.empty()) continue;
    call(setting.check);
    const Bytes packed = compress(stream, path);
    append_little_endian(&table, packed.size(), 8);
    append_little_endian(&table, stream.size(), 8);
    body.insert(body.end(), packed.begin(), packed.end());
    ++streams;
  }
  Bytes header = {'N', 'G', 'S', 'P'};
  append_little_endian(&header, kSpzVersion, 4);
  append_little_endian(&header, splats.count(), 4);
  header.push_back(static_cast<uint8_t>(splats.sh_degree));
  header.push_back(static_cast<uint8_t>(bits));
  header.push_back(setting.rendering.compensation != 0 ? 1 : 0);  // trained with antialiasing
  header.push_back(streams);
  append_little_endian(&header, kSpzHeader, 4);  // where the table is
  header.resize(kSpzHeader);
  OutputFile file(path, setting.check);
  for (const Bytes* part : {&header, &table, &body}) file.write(part->data(), part->size());
  file.commit();
  return notes;
}

}  // namespace l4d::io
