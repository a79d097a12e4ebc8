// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

#include "l4d/attributes.hpp"

namespace l4d::train {

// Pointers to the arrays of a model of fixed capacity, with the shapes of l4d_gaussians. Rows from
// the model's count on are free. Values have these meanings: `position` is the mean at the
// reference time (libl4dcodec/scene/timeline.h), `mean_t` is in seconds, `opacity` is a logit, and
// `rotor` has any length. Other arrays of these shapes are derivatives and moments of the values.
template <typename T>
struct Rows {
  T* position;   // [capacity, 3]
  T* mean_t;     // [capacity]
  T* log_scale;  // [capacity, 4]
  T* rotor;      // [capacity, 8]
  T* opacity;    // [capacity]
  T* sh;         // [capacity, (D+1)^2, 3]
};

// Rows of owned arrays. Arrays: AttributeArrays, possibly const.
template <typename T, typename Arrays>
Rows<T> rows_of(Arrays& arrays) {
  Rows<T> rows{};
  for_each_attribute([](const AttributeInfo&, auto& from, T*& to) { to = from.data(); }, arrays,
                     rows);
  return rows;
}

}  // namespace l4d::train
