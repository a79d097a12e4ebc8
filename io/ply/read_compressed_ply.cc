// SPDX-License-Identifier: Apache-2.0
// Compressed 3DGS PLY: chunks of 256 Gaussians, whose numbers are fractions of the ranges of their
// chunk, and spherical harmonics of a byte each.
#include <algorithm>
#include <array>
#include <cmath>

#include "io/ply/compressed_ply.h"
#include "io/ply/read_ply.h"
#include "io/ply/static_scene.h"
#include "io/scene/counted.h"
#include "libl4dcodec/scene/sh.h"

namespace l4d::io {
namespace {

// The `bits` from `shift` on as a fraction of what they hold at most.
double fraction(uint32_t value, unsigned shift, unsigned bits) {
  const uint32_t most = (1U << bits) - 1;
  return static_cast<double>((value >> shift) & most) / most;
}

// x of 11 bits, y of 10 and z of 11, within the range of the chunk.
void unpack_in_range(uint32_t value, const float* range, float* out) {
  const double t[3] = {fraction(value, 21, 11), fraction(value, 11, 10), fraction(value, 0, 11)};
  for (size_t k = 0; k < 3; ++k) {
    const double least = static_cast<double>(range[k]), most = static_cast<double>(range[k + 3]);
    out[k] = static_cast<float>(least * (1 - t[k]) + most * t[k]);
  }
}

// Three numbers of w x y z, and the largest, which follows from them.
void unpack_rotation(uint32_t value, float* wxyz) {
  const size_t largest = value >> 30;
  double sum = 0;
  unsigned shift = 20;
  for (size_t k = 0; k < 4; ++k) {
    if (k == largest) continue;
    const double x = (fraction(value, shift, 10) - 0.5) * std::sqrt(2.0);
    wxyz[k] = static_cast<float>(x);
    sum += x * x;
    shift -= 10;
  }
  wxyz[largest] = static_cast<float>(std::sqrt(std::max(0.0, 1 - sum)));
}

// A byte is the middle of its step, but for the ends of the range of 8.
double harmonic_of_byte(double byte) {
  const double t = byte == 0 ? 0 : byte == 255 ? 1 : (byte + 0.5) / 256;
  return (t - 0.5) * 8;
}

size_t require(const PlyReader& reader, const std::string& property, PlyType type) {
  const PlyElement& element = reader.element();
  const size_t index = element.find(property);
  if (index == PlyElement::kNone || element.properties[index].type != type) {
    reader.fail(L4D_ERR_CORRUPT, "element " + element.name + ": property " + property +
                                     " is missing, or of another type than a compressed PLY has");
  }
  return index;
}

struct Packed {
  bool has_colors = false;        // ranges of them
  std::vector<float> ranges;      // [chunks, kRanges]
  std::vector<double> values;     // [N, 4] as kPackedNames; every uint32 is a double
  std::vector<std::string> left;  // names that nothing reads
};

std::vector<PlyColumn> columns_of_chunks(const PlyReader& reader, Packed* packed) {
  std::vector<PlyColumn> columns;
  packed->has_colors = reader.element().has("min_r");
  for (size_t k = 0; k < (packed->has_colors ? kRanges : kColorRange); ++k) {
    columns.push_back({require(reader, kRangeNames[k], PlyType::kFloat32), packed->ranges.data(),
                       nullptr, k, kRanges});
  }
  return columns;
}

std::vector<PlyColumn> columns_of_vertices(const PlyReader& reader, Packed* packed) {
  std::vector<PlyColumn> columns;
  for (size_t k = 0; k < 4; ++k) {
    columns.push_back(
        {require(reader, kPackedNames[k], PlyType::kUint32), nullptr, packed->values.data(), k, 4});
  }
  return columns;
}

// Channel-major in the file.
std::vector<PlyColumn> columns_of_harmonics(const PlyReader& reader, StaticRows* rows) {
  std::vector<PlyColumn> columns;
  const size_t rest = (size_t{rows->sh_degree} + 1) * (rows->sh_degree + 1) - 1;
  for (size_t channel = 0; channel < 3; ++channel) {
    for (size_t k = 0; k < rest; ++k) {
      const std::string name = "f_rest_" + std::to_string(channel * rest + k);
      columns.push_back({require(reader, name, PlyType::kUint8), rows->sh.data(), nullptr,
                         3 * (k + 1) + channel, 3 * (rest + 1)});
    }
  }
  return columns;
}

void read_elements(PlyReader& reader, Packed* packed, StaticRows* rows) {
  const PlyHeader header = reader.header();
  for (const PlyElement& element : header.elements) {
    std::vector<PlyColumn> columns;
    const bool is_known =
        element.name == "chunk" || element.name == "vertex" || element.name == "sh";
    if (!is_known) {
      packed->left.push_back(element.name);
      continue;
    }
    reader.select(element.name);
    if (element.name == "chunk") columns = columns_of_chunks(reader, packed);
    if (element.name == "vertex") columns = columns_of_vertices(reader, packed);
    if (element.name == "sh") columns = columns_of_harmonics(reader, rows);
    reader.read_rows(columns);
    for (size_t k = 0; k < element.properties.size(); ++k) {
      const bool is_read = std::any_of(columns.begin(), columns.end(),
                                       [&](const PlyColumn& c) { return c.property == k; });
      if (!is_read) packed->left.push_back(element.name + "." + element.properties[k].name);
    }
  }
}

// A range from its end to its begin would mirror what is in its chunk.
void check_ranges(const PlyReader& reader, const Packed& packed) {
  for (size_t i = 0; i < packed.ranges.size(); i += kRanges) {
    for (size_t k = 0; k < kRanges; k = k % 6 == 2 ? k + 4 : k + 1) {
      if (!(packed.ranges[i + k] > packed.ranges[i + k + 3])) continue;
      reader.fail(L4D_ERR_CORRUPT, "element chunk, row " + std::to_string(i / kRanges) + ": " +
                                       kRangeNames[k] + " is above " + kRangeNames[k + 3]);
    }
  }
}

void unpack(const Packed& packed, StaticRows* rows) {
  const size_t numbers = size_t{3} * (rows->sh_degree + 1) * (rows->sh_degree + 1);
  for (size_t i = 0; i < rows->opacity.size(); ++i) {
    const float* ranges = &packed.ranges[kRanges * (i / kPlyChunk)];
    std::array<uint32_t, 4> value{};
    for (size_t k = 0; k < 4; ++k) value[k] = static_cast<uint32_t>(packed.values[4 * i + k]);
    unpack_in_range(value[0], ranges + kPositionRange, &rows->position[3 * i]);
    unpack_rotation(value[1], &rows->rotation[4 * i]);
    unpack_in_range(value[2], ranges + kScaleRange, &rows->log_scale[3 * i]);
    for (unsigned k = 0; k < 3; ++k) {
      double color = fraction(value[3], 24 - 8 * k, 8);
      if (packed.has_colors) {
        color = static_cast<double>(ranges[kColorRange + k]) * (1 - color) +
                static_cast<double>(ranges[kColorRange + 3 + k]) * color;
      }
      rows->sh[numbers * i + k] =
          static_cast<float>((color - 0.5) / static_cast<double>(sh_constant::k0));
    }
    for (size_t k = 3; k < numbers; ++k) {
      float& x = rows->sh[numbers * i + k];
      x = static_cast<float>(harmonic_of_byte(static_cast<double>(x)));
    }
    rows->opacity[i] = static_cast<float>(fraction(value[3], 0, 8));
  }
}

}  // namespace

bool is_compressed_ply(const PlyElement& vertex) { return vertex.has("packed_position"); }

namespace {

uint32_t degree_of(const PlyReader& reader) {
  const ShColumns sh = sh_columns_of(reader);
  if (!sh.note.empty()) {
    reader.fail(L4D_ERR_FEATURE_UNSUPPORTED, "spherical harmonics of degree 4 in the element sh");
  }
  return sh.degree;
}

}  // namespace

uint64_t compressed_ply_bytes(PlyReader& reader) {
  const uint64_t count = reader.element().count;
  uint32_t degree = 0;
  if (reader.header().find("sh") != nullptr) {
    reader.select("sh");
    degree = degree_of(reader);
  }
  reader.select("chunk");
  const uint64_t chunks = reader.element().count;
  reader.select("vertex");
  return static_scene_bytes(count, degree) + count * 4 * sizeof(double) +
         chunks * kRanges * sizeof(float);
}

Scene read_compressed_ply(PlyReader& reader, const ImportOptions& options) {
  refuse_unread_time(reader);
  const uint64_t count = reader.element().count;
  uint32_t degree = 0;
  // select() compares each count with the file before anything is allocated for it.
  if (reader.header().find("sh") != nullptr) {
    reader.select("sh");
    degree = degree_of(reader);
    if (reader.element().count != count) {
      reader.fail(L4D_ERR_CORRUPT, std::to_string(reader.element().count) +
                                       " rows of spherical harmonics for " + std::to_string(count) +
                                       " Gaussians");
    }
  }
  reader.select("chunk");
  const uint64_t chunks = reader.element().count;
  if (chunks != (count + kPlyChunk - 1) / kPlyChunk) {
    reader.fail(L4D_ERR_CORRUPT, std::to_string(chunks) + " chunks of 256 for " +
                                     std::to_string(count) + " Gaussians");
  }
  Packed packed;
  packed.ranges.resize(static_cast<size_t>(chunks) * kRanges);
  packed.values.resize(static_cast<size_t>(count) * 4);
  StaticRows rows(static_cast<size_t>(count), degree);
  read_elements(reader, &packed, &rows);
  check_ranges(reader, packed);
  unpack(packed, &rows);
  Scene scene = static_scene(std::move(rows), "compressed_ply", options);
  read_placement(reader, scene);
  if (!packed.left.empty()) {
    scene.notes.push_back(counted(packed.left.size(), "column was", "columns were") +
                          " not read: " + list_of_names(packed.left) + ".");
  }
  return scene;
}

}  // namespace l4d::io
