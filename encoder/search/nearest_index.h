// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <hwy/aligned_allocator.h>

#include <cstddef>
#include <cstdint>
#include <vector>

#include "encoder/search/principal_axes.h"

namespace l4d {

// A codebook arranged for exact search.
//
// Every vector has a short *sketch*, whose distances never exceed the true ones: its leading
// coordinates and the length of what is left over (by the triangle inequality that length is as
// good as one more coordinate). Up to kMaxPlainDim dimensions the sketch is the vector itself.
// Above, a rotation to principal axes, which keeps distances, first moves most of the energy to the
// front.
//
// The codewords are the leaves of a tree of fan-out kFan over the sketches with a bounding box for
// each node; a leaf holds kFan codewords. All arrays have kFan values side by side, for SIMD.
struct NearestIndex {
  static constexpr size_t kFan = 16;
  static constexpr size_t kMaxPlainDim = 8;
  // Sketch coordinates that bounding boxes cover, and that a leaf looks at first.
  static constexpr size_t kMaxBoxDim = 12;

  // codebook: [k, dim], must outlive the index. Without `rotate` the given axes are used.
  NearestIndex(const float* codebook, size_t k, size_t dim, bool rotate);

  bool plain() const { return dim <= kMaxPlainDim; }
  bool rotated() const { return !axes.basis.empty(); }
  size_t sketch_dim() const { return lead + (has_tail ? 1 : 0); }
  size_t num_leaves() const { return (k + kFan - 1) / kFan; }

  const float* codebook;
  size_t k;
  size_t dim;
  size_t lead = 0;        // leading coordinates in a sketch
  bool has_tail = false;  // whether the length of the rest follows them
  size_t box_dim = 0;

  // Rounding bound: a computed sketch is within error_scale x (length of the centred vector) of the
  // exact one.
  float error_scale = 0;

  PrincipalAxes axes;  // empty where not rotated

  // boxes[0] bounds leaves, boxes[l] bounds kFan nodes of level l - 1; the last one is a single
  // group. Each is [groups, box_dim, 2 (low, high), kFan]; lanes beyond level_size[l] are never
  // looked at.
  std::vector<hwy::AlignedFreeUniquePtr<float[]>> boxes;
  std::vector<size_t> level_size;

  hwy::AlignedFreeUniquePtr<float[]> leaves;  // [num_leaves, sketch_dim, kFan]
  // Codeword of each leaf slot. Spare slots of the last leaf repeat a codeword.
  std::vector<uint32_t> order;  // [num_leaves, kFan]
  // Codewords in that order, so that what survives a leaf is read from few pages. Not plain only.
  std::vector<float> rows;  // [num_leaves, kFan, dim]
};

}  // namespace l4d
