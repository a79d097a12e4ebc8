// SPDX-License-Identifier: Apache-2.0
// Transform and scalar quantisation of one component: principal axes of the weighted vectors, or
// the vectors' own numbers, in uniform steps that each Gaussian's importance sets by octaves.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "libl4dcodec/container/scene_header.h"

namespace l4d {

// Whether row i may be decoded to `decoded`, [dim]. Any thread may call it.
using RowCheck = std::function<bool(size_t i, const float* decoded)>;

struct TransformSettings {
  double distortion = 0;  // weighted squared error that a number may have: steps follow from it
  double max_step = 0;    // however little a Gaussian weighs
  bool principal_axes = false;
  // With principal axes: so many leading numbers of a row come first, alone with what they tell of
  // the others, so that as many leading coefficients are an approximation of them. 0 = freely
  // chosen axes.
  size_t base = 0;
  bool integers = false;     // rows are sums of integers, as those of SH are
  bool zero_origin = false;  // a row of zeros is coded as such
  // Keep coefficients that are 0 in all rows, for rows that may be coded again by code_row.
  bool all_coefficients = false;
  // With principal axes: a row that it refuses is coded in finer steps until it does not. Empty:
  // all rows are fine.
  RowCheck keeps;
  // How far off a number of the base may be, as `keeps` has it: the base has finer steps than the
  // rest if that is cheaper than finer steps for both. 0 = any distance.
  double base_error = 0;
  int threads = 0;
};

// A component of a set of Gaussians, as a decoder will have it.
struct CodedRows {
  size_t n = 0;
  size_t dim = 0;
  std::vector<float> decoded;  // [n, dim], bit-exact
};

// As coefficients, valid below what the EOB index has.
struct CodedTransform : CodedRows {
  size_t base = 0;           // leading coefficients that make the base
  std::vector<float> basis;  // [coefficients + 1, dim], the origin first, binary16 values
  std::vector<float> steps;  // [coefficients]
  std::vector<uint8_t> eob_table;
  std::vector<uint8_t> step_exponent;             // [n]
  std::vector<uint8_t> eob_index;                 // [n]
  std::vector<std::vector<int16_t>> coefficient;  // per coefficient [n]
};

// rows: [n, dim]. weights: [n], mean squared change of the image by a change of one number of a
// row.
CodedTransform code_transform(const float* rows, const float* weights, size_t n, size_t dim,
                              const TransformSettings& settings);

// Codes row i once more, in the next finer steps. False, with nothing changed, where there are none
// or a coefficient would be too large for them. Without principal axes only.
bool refine_row(const float* row, size_t i, CodedTransform& coded);

// Drops trailing coefficients that are 0 in all rows, of transforms without principal axes.
void drop_unused_coefficients(CodedTransform& coded);

}  // namespace l4d
