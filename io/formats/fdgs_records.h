// SPDX-License-Identifier: Apache-2.0
// The records of a .4dgs file, walked from its begin to its end.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "io/formats/fdgs.h"
#include "io/formats/fdgs_streams.h"

namespace l4d::io::fdgs {

// The Gaussians of an interval, as they lie in the file.
struct ChunkPlace {
  uint32_t count = 0;
  std::string compression;
  uint64_t expanded = 0;  // bytes
  const uint8_t* data = nullptr;
  uint64_t bytes = 0;
  // Of band 1 to 3; without payload where it is missing.
  std::array<PackedStream, 3> bands;
};

struct Window {
  double begin = 0, end = 0;  // seconds
};

struct FirstView {
  double fov_degrees = 0;  // vertical; 0: the file has none
  std::array<double, 3> position{}, target{};
};

struct Contents {
  double seconds = 0, cutoff = 0;
  uint64_t count = 0;  // Gaussians of all chunks
  uint32_t sh_degree = 0;
  Texts attributes;  // the header's, and entries of Metadata records
  Grids grids;
  std::vector<Window> windows;  // at least one
  std::vector<ChunkPlace> chunks;
  uint32_t coordinate_system = 0;  // L4D_COORDINATES_*
  double metres_per_unit = 0;
  FirstView view;
  bool has_other_axes = false;       // than those that have a name
  std::set<uint32_t> moved_objects;  // that have a track
  std::vector<std::string> unread;   // kinds of records, in words
};

// Checks order, lengths, counts and the checksum of the summary. The result refers to `bytes`.
// Throws Error, whose message begins with `path`.
Contents walk_records(const std::vector<uint8_t>& bytes, const std::string& path);

}  // namespace l4d::io::fdgs
