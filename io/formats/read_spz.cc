// SPDX-License-Identifier: Apache-2.0
// SPZ, versions 2 to 4: one stream of gzip, or since 4 streams of zstd behind a table.
#include <array>
#include <cmath>
#include <cstring>

#include "io/file/little_endian.h"
#include "io/formats/inflate.h"
#include "io/formats/readers.h"
#include "io/ply/static_scene.h"

namespace l4d::io {
namespace {

constexpr uint32_t kMagic = 0x5053474e;  // "NGSP"
constexpr size_t kHeader = 16, kHeader4 = 32, kEntry = 16;
constexpr uint8_t kAntialiased = 1, kExtensions = 2;
constexpr size_t kMostStreams = 6;
constexpr uint32_t kAxes = 0xADBE0003;  // the extension SPZ_ADOBE_coordinate_system
constexpr uint32_t kRightUpBack = 4, kRightDownForward = 6;
constexpr size_t kMostOfExtensions = 65536;

struct Header {
  uint32_t version = 0, count = 0;
  uint8_t sh_degree = 0, fractional_bits = 0, flags = 0, last = 0;

  size_t coefficients() const { return (size_t{sh_degree} + 1) * (sh_degree + 1) - 1; }
  // Bytes of a Gaussian in each stream: positions, opacities, colours, scales, rotations, SH.
  std::array<size_t, kMostStreams> widths() const {
    return {9, 1, 3, 3, version == 2 ? size_t{3} : 4, 3 * coefficients()};
  }
};

Header parse_header(const uint8_t* bytes, const std::string& path) {
  Header h;
  h.version = little_endian32(bytes + 4);
  h.count = little_endian32(bytes + 8);
  h.sh_degree = bytes[12];
  h.fractional_bits = bytes[13];
  h.flags = bytes[14];
  h.last = bytes[15];
  if (little_endian32(bytes) != kMagic) throw Error(L4D_ERR_CORRUPT, path + ": no SPZ file");
  if (h.version < 2 || h.version > 4) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                path + ": version " + std::to_string(h.version) + " of SPZ; 2 to 4 are read");
  }
  if (h.sh_degree > 3) {
    throw Error(L4D_ERR_FEATURE_UNSUPPORTED,
                path + ": spherical harmonics of degree " + std::to_string(h.sh_degree));
  }
  if (h.fractional_bits > 23) {
    throw Error(L4D_ERR_CORRUPT, path + ": " + std::to_string(h.fractional_bits) +
                                     " fractional bits of positions; at most 23 are possible");
  }
  return h;
}

// Three numbers of a quaternion and the largest, which follows from them.
void largest_of_four(uint32_t bits, float* wxyz) {
  constexpr uint32_t kMask = 511;
  const size_t largest = bits >> 30;
  double xyzw[4], sum = 0;
  for (size_t k = 4; k-- > 0;) {
    if (k == largest) continue;
    const double magnitude = std::sqrt(0.5) * (bits & kMask) / kMask;
    xyzw[k] = ((bits >> 9) & 1) != 0 ? -magnitude : magnitude;
    sum += xyzw[k] * xyzw[k];
    bits >>= 10;
  }
  xyzw[largest] = std::sqrt(std::max(0.0, 1 - sum));
  for (size_t k = 0; k < 4; ++k) wxyz[k] = static_cast<float>(xyzw[(k + 3) % 4]);
}

void first_three(const uint8_t* bytes, float* wxyz) {
  double sum = 0;
  for (size_t k = 0; k < 3; ++k) {
    const double x = bytes[k] / 127.5 - 1;
    wxyz[k + 1] = static_cast<float>(x);
    sum += x * x;
  }
  wxyz[0] = static_cast<float>(std::sqrt(std::max(0.0, 1 - sum)));
}

// body: the streams one after the other.
void expand(const Header& h, const uint8_t* body, StaticRows* rows) {
  const std::array<size_t, kMostStreams> widths = h.widths();
  const uint8_t* at[kMostStreams];
  for (size_t s = 0; s < kMostStreams; ++s) {
    at[s] = body;
    body += widths[s] * h.count;
  }
  const double step = std::ldexp(1.0, -h.fractional_bits);
  const size_t numbers = 3 * (h.coefficients() + 1);
  for (size_t i = 0; i < h.count; ++i) {
    for (size_t k = 0; k < 3; ++k) {
      const uint8_t* p = at[0] + 9 * i + 3 * k;
      const uint32_t raw = static_cast<uint32_t>(p[0]) << 8 | static_cast<uint32_t>(p[1]) << 16 |
                           static_cast<uint32_t>(p[2]) << 24;
      int32_t value = 0;
      std::memcpy(&value, &raw, sizeof(value));
      rows->position[3 * i + k] = static_cast<float>(value / 256 * step);
      rows->log_scale[3 * i + k] = static_cast<float>(at[3][3 * i + k] / 16.0 - 10);
      rows->sh[numbers * i + k] = static_cast<float>((at[2][3 * i + k] / 255.0 - 0.5) / 0.15);
    }
    rows->opacity[i] = static_cast<float>(at[1][i] / 255.0);
    if (h.version == 2) {
      first_three(at[4] + 3 * i, &rows->rotation[4 * i]);
    } else {
      largest_of_four(little_endian32(at[4] + 4 * i), &rows->rotation[4 * i]);
    }
    for (size_t k = 3; k < numbers; ++k) {
      rows->sh[numbers * i + k] =
          static_cast<float>((at[5][(numbers - 3) * i + k - 3] - 128.0) / 128);
    }
  }
}

// The streams of version 4, one after the other.
std::vector<uint8_t> expand_streams(const Header& h, const std::vector<uint8_t>& file,
                                    const std::string& path) {
  const auto fail = [&](const char* message) {
    throw Error(L4D_ERR_CORRUPT, path + ": " + message);
  };
  const uint64_t table = little_endian32(&file[16]), streams = h.last;
  if (table < kHeader4 || streams > kMostStreams || table + streams * kEntry > file.size()) {
    fail("the table of streams does not fit into the file");
  }
  std::vector<uint8_t> body;
  uint64_t at = table + streams * kEntry, stream = 0;
  for (const size_t width : h.widths()) {
    const uint64_t bytes = uint64_t{width} * h.count;
    if (bytes == 0) continue;  // is left out
    if (stream == streams) fail("a stream is missing");
    const uint8_t* entry = &file[static_cast<size_t>(table + stream++ * kEntry)];
    const uint64_t stored = little_endian64(entry);
    if (little_endian64(entry + 8) != bytes)
      fail("a stream has another length than its Gaussians need");
    if (stored > file.size() - at) fail("a stream reaches beyond the file");
    const std::vector<uint8_t> part =
        expand_zstd(file.data() + at, static_cast<size_t>(stored), bytes, path);
    if (part.size() != bytes) fail("a stream ends early");
    body.insert(body.end(), part.begin(), part.end());
    at += stored;
  }
  if (stream != streams) fail("there are more streams than Gaussians have attributes");
  if (at != file.size() && (h.flags & kExtensions) == 0) fail("more bytes follow the streams");
  return body;
}

// Records of extensions: type, length, payload. Only that of axes is read: without it they are
// those of SPZ.
void read_extensions(const uint8_t* at, size_t size, Scene* scene) {
  bool are_all_read = size > 0;
  while (size >= 8 && little_endian32(at + 4) <= size - 8) {
    const uint32_t length = little_endian32(at + 4);
    if (little_endian32(at) == kAxes && length == 4) {
      const uint32_t axes = little_endian32(at + 8);
      if (axes == kRightDownForward) {
        scene->placement.coordinate_system = L4D_COORDINATES_RIGHT_DOWN_FORWARD;
      } else if (axes != 0 && axes != kRightUpBack) {  // 0: not stated
        scene->placement.coordinate_system = L4D_COORDINATES_UNKNOWN;
        scene->notes.push_back("The SPZ file has axes of its own, number " + std::to_string(axes) +
                               " of SPZ_ADOBE_coordinate_system, which stay as they are.");
      }
    } else {
      are_all_read = false;
    }
    at += 8 + length;
    size -= 8 + length;
  }
  if (!are_all_read || size > 0) {
    scene->notes.push_back("Extensions of the SPZ file were not read.");
  }
}

}  // namespace

Scene read_spz(InputFile input, const ImportOptions& options) {
  const std::string path = input.path();
  std::shared_ptr<void> file_memory;
  const std::vector<uint8_t> file = read_counted(&input, options.holder, &file_memory);
  const bool is_gzip = file.size() > 2 && file[0] == 0x1f && file[1] == 0x8b;
  const std::vector<uint8_t> begin =
      is_gzip ? expand_gzip(file.data(), file.size(), kHeader, path) : file;
  if (begin.size() < (is_gzip ? kHeader : kHeader4)) {
    throw Error(L4D_ERR_CORRUPT, path + ": the header ends early");
  }
  const Header h = parse_header(begin.data(), path);
  if (is_gzip != (h.version < 4)) {
    throw Error(L4D_ERR_CORRUPT,
                path + ": version " + std::to_string(h.version) +
                    (is_gzip ? " is not compressed as a whole" : " is compressed as a whole"));
  }
  uint64_t bytes = 0;
  for (const size_t width : h.widths()) bytes += uint64_t{width} * h.count;
  // The bytes once as they grow and once more, and the scene.
  std::shared_ptr<void> memory =
      hold(options.holder, 3 * bytes + static_scene_bytes(h.count, h.sh_degree), path);
  const bool has_extensions = (h.flags & kExtensions) != 0;
  // One byte more than there should be is seen, and so is the end of the compressed data.
  // Extensions are last.
  const uint64_t most = kHeader + bytes + (has_extensions ? kMostOfExtensions : 1);
  std::vector<uint8_t> body =
      is_gzip ? expand_gzip(file.data(), file.size(), most, path) : expand_streams(h, file, path);
  const size_t skipped = is_gzip ? kHeader : 0;
  if (body.size() < skipped + bytes || (!has_extensions && body.size() > skipped + bytes)) {
    const std::string what = body.size() > skipped + bytes
                                 ? "more bytes of Gaussians than stated"
                                 : std::to_string(body.size() - skipped) + " bytes of Gaussians";
    throw Error(L4D_ERR_CORRUPT, path + ": " + what + "; " + std::to_string(h.count) +
                                     " of them take " + std::to_string(bytes));
  }
  StaticRows rows(h.count, h.sh_degree);
  expand(h, body.data() + skipped, &rows);
  Scene scene = static_scene(std::move(rows), "spz", options);
  scene.placement.coordinate_system = L4D_COORDINATES_RIGHT_UP_BACK;
  if ((h.flags & kAntialiased) != 0) scene.rendering.compensation = 1;
  if (has_extensions && is_gzip) {
    read_extensions(body.data() + skipped + bytes, body.size() - skipped - bytes, &scene);
  } else if (has_extensions) {  // between the header and the table
    read_extensions(&file[kHeader4], little_endian32(&file[16]) - kHeader4, &scene);
  }
  scene.memory = std::move(memory);
  return scene;
}

}  // namespace l4d::io
