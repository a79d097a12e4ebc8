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
  return {arrays.position.data(), arrays.mean_t.data(),  arrays.log_scale.data(),
          arrays.rotor.data(),    arrays.opacity.data(), arrays.sh.data()};
}

}  // namespace l4d::train
