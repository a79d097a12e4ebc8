// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "libl4dcodec/base/memory.h"

namespace l4d::render {

// 3D Gaussians at one instant, structure of arrays: what every rasteriser takes. All cameras of an
// instant share one. The order is that of the scene.
template <typename T>
struct Frame {
  uint32_t sh_degree = 0;
  std::vector<uint32_t> id;      // index in the scene
  std::vector<T> position[3];    // scene units
  std::vector<T> covariance[6];  // xx xy xz yy yz zz, scene units^2
  std::vector<T> opacity;        // temporal falloff applied
  std::vector<const float*> sh;  // [(D+1)^2, 3] of each, owned by the scene

  // Numbers that vectors may read beyond the last row, without meaning.
  static constexpr size_t kPadding = 16;

  size_t count() const { return count_; }
  // For how many the arrays have room.
  size_t capacity() const { return id.size(); }
  // Keeps the Gaussians that there are, and room that there is.
  Status resize(size_t n, MemoryBudget& memory) {
    count_ = 0;
    L4D_RETURN_IF_ERROR(reserve(n, memory));
    count_ = n;
    return {};
  }
  Status reserve(size_t n, MemoryBudget& memory) {
    if (n <= capacity()) return {};
    constexpr const char* kWhat = "the Gaussians of an instant";
    for (auto& axis : position) L4D_RETURN_IF_ERROR(grow(memory, &axis, n + kPadding, kWhat));
    for (auto& entry : covariance) L4D_RETURN_IF_ERROR(grow(memory, &entry, n + kPadding, kWhat));
    L4D_RETURN_IF_ERROR(grow(memory, &opacity, n + kPadding, kWhat));
    L4D_RETURN_IF_ERROR(grow(memory, &sh, n, kWhat));
    return grow(memory, &id, n, kWhat);  // last, since it tells the room of all
  }
  void forget(MemoryBudget& memory) {
    count_ = 0;
    l4d::forget(memory, &id);
    for (auto& axis : position) l4d::forget(memory, &axis);
    for (auto& entry : covariance) l4d::forget(memory, &entry);
    l4d::forget(memory, &opacity);
    l4d::forget(memory, &sh);
  }

 private:
  size_t count_ = 0;
};

// Derivatives of a scalar by what a Frame holds of one Gaussian.
template <typename T>
struct SplatGradient3D {
  T position[3]{};
  T direction[3]{};   // the part of it that is of the colour, which the direction alone changes
  T covariance[6]{};  // of xy, xz, yz: by the number itself, which stands for both places
  T opacity{};
};

}  // namespace l4d::render
