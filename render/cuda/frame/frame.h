// SPDX-License-Identifier: Apache-2.0
// What the kernels of one frame share, and the calls that launch them.
#pragma once

#include "render/cuda/frame/image_target.h"
#include "render/cuda/kernel/radix_sort.h"
#include "render/cuda/store/resident.h"

namespace l4d::render {

// Visible rows of a block, in the kernels that go through them in order. Of large blocks fewer wait
// for each other in turn, but with SH in binary32 two of them do not fit beside each other.
constexpr int project_piece(bool half_sh) { return half_sh ? 512 : 256; }
constexpr uint32_t kEmitPiece = 256;

// Splats front to back, in the pieces that blocks emit. The nearest are the largest, as a rule, and
// a frame of few has large ones and blocks to spare: pieces of 32 there.
class EmitPieces {
 public:
  // splats: of the frame.
  L4D_HOST_DEVICE constexpr explicit EmitPieces(uint32_t splats) {
    while (length_ < kEmitPiece && splats / length_ >= kFew) length_ *= 2;
  }
  L4D_HOST_DEVICE constexpr uint32_t first(uint32_t piece) const {
    return piece < kNear ? piece * 32 : kNear * 32 + (piece - kNear) * length_;
  }
  // Of a frame of so many splats or fewer.
  static constexpr uint32_t most(uint32_t splats) {
    const uint32_t long_ones = splats / kEmitPiece, short_ones = splats / 32;
    return kNear + 1 + (long_ones > kFew ? long_ones : short_ones < kFew ? short_ones : kFew);
  }

 private:
  static constexpr uint32_t kNear = 128, kFew = 4096;
  uint32_t length_ = 32;
};

// Device memory of a frame.
struct FrameMemory {
  uint32_t max_visible, max_instances;
  SliceCounts* slice_counts;
  uint32_t* slice_states;  // [chunks] of look-back, as the states below
  FrameCounts* counts;
  uint32_t* project_states;  // [pieces of visible]
  uint32_t* emit_states;     // [pieces of visible]
  uint32_t* depth_states;
  uint32_t* tile_states;
  uint32_t* depth_histograms;  // [kMaxSortPasses, kSortRadix], as the next set to 0
  uint32_t* tile_histograms;

  uint32_t* visible;         // [max_visible] rows, with their group
  DeviceSplat* splats;       // [max_visible] in the order of the scene
  uint32_t* num_tiles;       // [max_visible] that the splat touches
  uint32_t* first_instance;  // [max_visible] emission of the splat's first instance
  uint32_t* depth_keys[2];   // [max_visible]
  uint32_t* depth_order[2];  // [max_visible] splats, front to back
  uint32_t* tile_keys[2];    // [max_instances]
  uint32_t* tile_values[2];  // [max_instances] splats, or emissions on the backward pass
  uint32_t* splat_of;        // [max_instances] of each emission; NULL unless there is a way back
  uint2* ranges;             // [tiles] instances of each tile; set to 0 before each frame
  uint32_t* tile_order;      // [tiles] those with long lists first
};

#ifdef __CUDACC__
// Whether all of the frame fitted.
__device__ inline bool is_whole(const FrameMemory& memory) {
  return memory.slice_counts->wanted <= memory.max_visible &&
         memory.counts->wanted <= memory.max_instances;
}
#endif

struct FrameInput {
  View<float> view;
  double time;  // seconds from the middle of the sequence
  uint32_t sh_degree;
  bool half_sh;
  bool backward;  // instances are identified by the order of their emission
  float background[3];
  int columns, rows;  // of tiles
  SortDigits depth_digits, tile_digits;
};

constexpr int kDepthBits = 31;  // of a float that is not negative
inline int tile_bits(int tiles) {
  int bits = 1;
  while ((1 << bits) < tiles) ++bits;
  return bits;
}

// Tiles of an image.
inline size_t image_tiles(int width, int height) {
  const int columns = (width + kTileWidth - 1) / kTileWidth;
  const int rows = (height + kTileHeight - 1) / kTileHeight;
  return static_cast<size_t>(columns) * static_cast<size_t>(rows);
}

// Rows of the chunks that are visible at the time, in order. frame: that the time belongs to.
void launch_slice(const ResidentGaussians& rows, const Chunk* chunks, uint32_t num_chunks,
                  double time, uint32_t frame, const FrameMemory& memory, cudaStream_t stream);
// The splats of the visible rows that touch a tile, with their colours; keys of their depths.
void launch_project(const ResidentGaussians& rows, const FrameInput& input,
                    const FrameMemory& memory, cudaStream_t stream);
// Pairs of tile and splat, front to back.
void launch_emit(const FrameInput& input, const uint32_t* order, const FrameMemory& memory,
                 cudaStream_t stream);
// Where each tile's instances lie among the sorted ones.
void launch_ranges(const FrameInput& input, const uint32_t* tiles, const FrameMemory& memory,
                   cudaStream_t stream);
void launch_blend(const FrameInput& input, const uint32_t* values, const FrameMemory& memory,
                  const ImageTarget& target, cudaStream_t stream);

}  // namespace l4d::render
