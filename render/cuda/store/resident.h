// SPDX-License-Identifier: Apache-2.0
// Where things lie in device memory.
#pragma once

#include <cuda_runtime_api.h>

#include <cstddef>
#include <cstdint>

#include "l4d/l4d.h"
#include "libl4dcodec/scene/prepare.h"
#include "libl4dcodec/scene/sh.h"
#include "render/view/view.h"

namespace l4d::render {

// Pixels of a tile: of what a block of threads blends, 8x8 of them each warp.
constexpr int kTileWidth = 32;
constexpr int kTileHeight = 16;

// log2(kMinAlpha)
constexpr float kDeviceLog2MinAlpha = -7.99435344f;

// Rows that are looked at together, all of one group.
struct Chunk {
  uint32_t first, count, group;
};
constexpr uint32_t kChunkSlots = 1024;

// A Gaussian made ready for slicing: 64 bytes, its window and its SH, in columns. Times are seconds
// from the middle of the sequence, or from what `origin` says: in a sequence of many hours,
// binary32 from its middle would not tell frames apart. `motion` is read of slots that move, the
// second half of `shape1` of slots that fade.
struct ResidentGaussians {
  VisibleInterval* interval;  // [slots] when it is visible
  float4* place;              // [slots] position at the reference time; opacity
  float4* motion;             // [slots] velocity; reference time
  float4* shape0;             // [slots] covariance xx xy xz yy
  float4* shape1;             // [slots] covariance yz zz; mean time, lambda
  void* sh;                   // [slots, sh_words] binary32, or binary16 padded to whole 8 bytes
  uint32_t* id;               // [slots] index in the scene
  FrameWindow* window;        // [slots] flat windows; NULL: no slot has one
  double* origin;  // [slots / kChunkSlots] seconds from the middle of the sequence; NULL: 0 for all
  uint32_t sh_words;  // of 4 bytes, from one slot's SH to the next one's
};

#ifdef __CUDACC__
// The time of a slot's clock; `time` in seconds from the middle of the sequence.
__device__ inline float slot_time(const ResidentGaussians& slots, double time, uint32_t slot) {
  return static_cast<float>(slots.origin == nullptr ? time
                                                    : time - slots.origin[slot / kChunkSlots]);
}
#endif

// Numbers from one slot's SH to the next one's. binary16: whole sectors of 32 bytes where that is
// cheap.
L4D_HOST_DEVICE constexpr uint32_t sh_stride(uint32_t degree, bool half) {
  const uint32_t numbers = 3 * sh_terms(degree);
  const uint32_t unit = half && degree > 0 ? 16 : 4;
  return (numbers + unit - 1) / unit * unit;
}

// A slot of the list of visible ones: its place in the store, and its MotionGroup in the highest
// bits.
constexpr int kGroupShift = 30;
constexpr uint32_t kSlotMask = (1u << kGroupShift) - 1;

// A Gaussian in the image, three 16-byte words. At offset (dx, dy) from the mean
//   log2(alpha) = log2_opacity + dx (conic[0] dx + conic[1] dy) + conic[2] dy^2.
struct alignas(16) DeviceSplat {
  float mean[2];   // pixels
  float conic[2];  // xx, 2 xy times -log2(e)/2
  float conic_yy;  // yy times -log2(e)/2
  float log2_opacity;
  float extent[2];  // half-sizes of the box in which alpha reaches kMinAlpha, pixels
  float color[3];   // clamped below at 0
  uint32_t slot;    // in the store, with its group
};
static_assert(sizeof(DeviceSplat) == 48, "three words");

// What a slice counts; device memory that is set to 0 before it.
struct SliceCounts {
  uint32_t visible;  // Gaussians visible at the time
  uint32_t wanted;   // had there been room for all
  uint32_t ticket;
  uint32_t reserved;
};

// What a frame counts; likewise.
struct FrameCounts {
  uint32_t projected;  // visible ones that touch a tile
  uint32_t instances;  // pairs of Gaussian and tile
  uint32_t wanted;     // instances, had there been room for all
  uint32_t shown;      // on the backward pass: splats that a pixel shows
  uint32_t project_ticket, emit_ticket, range_ticket;
  uint32_t depth_tickets[4], tile_tickets[4];
  uint32_t reserved[1];
};

}  // namespace l4d::render
