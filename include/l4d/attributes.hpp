// SPDX-License-Identifier: Apache-2.0
// attributes.hpp: the attributes of a Gaussian, listed once: name, numbers, type, unit and flag of
// each, a visitor for all structs that hold arrays of them, and vectors that own such arrays.
// C++17, also in device code (but for the vectors).
#ifndef L4D_ATTRIBUTES_HPP
#define L4D_ATTRIBUTES_HPP

#include <cstddef>
#include <cstdint>
#include <vector>

#include "l4d/l4d.h"

namespace l4d {

enum class Attribute : uint32_t { kPosition, kMeanTime, kLogScale, kRotor, kOpacity, kSh };

struct AttributeInfo {
  const char* name;  // of the array, in l4d_gaussians and all structs like it
  uint32_t dim;      // numbers of each Gaussian; 0: 3 (D+1)^2, for SH of degree D
  const char* type;  // of each number, as NumPy names it
  const char* unit;
  uint32_t flag;  // L4D_CUDA_*
  constexpr size_t numbers(uint32_t sh_degree) const {
    return dim != 0 ? dim : size_t{3} * (sh_degree + 1) * (sh_degree + 1);
  }
};

inline constexpr AttributeInfo kAttributes[] = {
    {"position", 3, "float32", "scene units", 1u << 0},
    {"mean_t", 1, "float32", "seconds", 1u << 1},
    {"log_scale", 4, "float32", "natural logarithms of scene units, the last of seconds", 1u << 2},
    {"rotor", 8, "float32", "1", 1u << 3},
    {"opacity", 1, "float32", "1, or logits", 1u << 4},
    {"sh", 0, "float32", "colour, of 0 to 1", 1u << 5},
};
inline constexpr size_t kNumAttributes = sizeof kAttributes / sizeof *kAttributes;

constexpr const AttributeInfo& info_of(Attribute attribute) {
  return kAttributes[static_cast<size_t>(attribute)];
}

// Calls f(info, arrays.NAME...) for each attribute in the order of the table. Arrays: any structs
// with members of these names, as l4d_gaussians, l4d_gaussian_buffers and l4d_gradients.
template <typename F, typename... Arrays>
constexpr void for_each_attribute(F&& f, Arrays&... arrays) {
  f(info_of(Attribute::kPosition), arrays.position...);
  f(info_of(Attribute::kMeanTime), arrays.mean_t...);
  f(info_of(Attribute::kLogScale), arrays.log_scale...);
  f(info_of(Attribute::kRotor), arrays.rotor...);
  f(info_of(Attribute::kOpacity), arrays.opacity...);
  f(info_of(Attribute::kSh), arrays.sh...);
}

// The same, then f once more for `mean_t_local`, which the arrays that decoders fill have beside
// it.
template <typename F, typename... Arrays>
constexpr void for_each_decoded(F&& f, Arrays&... arrays) {
  for_each_attribute(f, arrays...);
  f(info_of(Attribute::kMeanTime), arrays.mean_t_local...);
}

// Floats that a Gaussian has in all attributes together.
constexpr size_t numbers_per_gaussian(uint32_t sh_degree) {
  size_t sum = 0;
  for (const AttributeInfo& a : kAttributes) sum += a.numbers(sh_degree);
  return sum;
}

// Keeps the rows of `dim` numbers whose mask is not 0, in their order.
template <typename T, typename Mask>
void keep_rows(const Mask& mask, size_t dim, std::vector<T>* rows) {
  size_t kept = 0;
  for (size_t i = 0; i * dim < rows->size(); ++i) {
    if (!mask[i]) continue;
    for (size_t k = 0; k < dim && kept != i; ++k) (*rows)[kept * dim + k] = (*rows)[i * dim + k];
    ++kept;
  }
  rows->resize(kept * dim);
}

// Gaussians with arrays of their own. Shapes and meanings as in l4d_gaussians.
struct AttributeArrays {
  uint32_t sh_degree = 0;
  uint32_t flags = 0;  // L4D_POSITION_AT_MEAN_TIME, L4D_OPACITY_LOGIT
  std::vector<float> position, mean_t, log_scale, rotor, opacity, sh;
  // [N] where binary32 does not hold times as they are, else empty.
  std::vector<double> mean_t_double;
  // [N, 2] where some Gaussians have flat windows, else empty.
  std::vector<uint32_t> window;

  size_t count() const { return mean_t.size(); }
  double mean_time(size_t i) const {
    return mean_t_double.empty() ? static_cast<double>(mean_t[i]) : mean_t_double[i];
  }
  // Sets the length of all arrays of float, for the SH degree as it is.
  void resize(size_t count) {
    for_each_attribute([&](const AttributeInfo& a,
                           std::vector<float>& v) { v.resize(count * a.numbers(sh_degree)); },
                       *this);
    if (!mean_t_double.empty()) mean_t_double.resize(count);
    if (!window.empty()) window.resize(2 * count);
  }
  // Keeps the Gaussians whose mask is not 0, in their order. mask: [count()].
  template <typename Mask>
  void keep(const Mask& mask) {
    for_each_attribute([&](const AttributeInfo& a,
                           std::vector<float>& v) { keep_rows(mask, a.numbers(sh_degree), &v); },
                       *this);
    keep_rows(mask, 1, &mean_t_double);
    keep_rows(mask, 2, &window);
  }
  // Borrows the arrays, until one of them is resized.
  l4d_gaussians view() const {
    l4d_gaussians g{};
    g.struct_size = sizeof g;
    g.count = count();
    g.sh_degree = sh_degree;
    g.flags = flags;
    for_each_attribute([](const AttributeInfo&, const std::vector<float>& from,
                          const float*& to) { to = from.data(); },
                       *this, g);
    g.mean_t_double = mean_t_double.empty() ? nullptr : mean_t_double.data();
    g.window = window.empty() ? nullptr : window.data();
    return g;
  }
};

}  // namespace l4d
#endif  // L4D_ATTRIBUTES_HPP
