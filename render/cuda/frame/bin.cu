// SPDX-License-Identifier: Apache-2.0
// From splats front to back to pairs of tile and splat, and from sorted pairs to the list of each
// tile.
#include "render/cuda/frame/frame.h"
#include "render/cuda/frame/tiles.cuh"
#include "render/cuda/kernel/launch.cuh"
#include "render/cuda/kernel/ordered.cuh"

namespace l4d::render {
namespace {

constexpr int kThreads = kEmitPiece;
// Rows of tiles of a block's splats that are kept in shared memory; of more, spans are worked out
// twice.
constexpr uint32_t kKeptRows = 1024;
static_assert(kKeptRows % kThreads == 0, "whole turns");

// The splats of a block, and the rows of tiles that their boxes touch one after another: work that
// is shared out by rows, for splats are of very different size.
struct BlockSplats {
  float4 first[kThreads], second[kThreads];  // what SplatTiles holds
  ushort4 box[kThreads];                     // tiles: first row, end, first column, end
  uint32_t row_sum[kThreads + 1];            // rows of the splats before
  uint32_t index[kThreads];
};

// The last of the splats that begin at `row` or before.
__device__ uint32_t splat_of_row(const BlockSplats& block, uint32_t row) {
  uint32_t low = 0;
#pragma unroll
  for (uint32_t step = kThreads / 2; step > 0; step /= 2) {
    if (block.row_sum[low + step] <= row) low += step;
  }
  return low;
}

// Columns of tiles in a row that a splat touches.
struct RowSpan {
  uint32_t splat;  // of the block
  int row, begin, width;
};

__device__ RowSpan span_of(const BlockSplats& block, const FrameInput& input, uint32_t item) {
  const uint32_t k = splat_of_row(block, item);
  const ushort4 box = block.box[k];
  const int row = box.x + static_cast<int>(item - block.row_sum[k]);
  TileSpan span{box.z, box.w};
  // One row or column of tiles: the box is as good as the ellipse.
  if (box.y - box.x > 1 && box.w - box.z > 1) {
    span = span_of_row(block.first[k], block.second[k], row, input.columns);
  }
  return {k, row, span.begin, max(span.end - span.begin, 0)};
}

// Width, first column and splat: up to 1024 columns and 256 splats.
__device__ uint32_t packed(const RowSpan& span) {
  return static_cast<uint32_t>(span.width) << 18 | static_cast<uint32_t>(span.begin) << 8 |
         span.splat;
}

__global__ void __launch_bounds__(kThreads)
    emit(FrameInput input, const uint32_t* order, FrameMemory memory) {
  await_predecessor();
  __shared__ BlockSplats block;
  __shared__ uint32_t kept_place[kKeptRows], kept_span[kKeptRows];
  __shared__ uint32_t first_of[kThreads],
      end_of[kThreads];  // on the backward pass: instances of each splat
  __shared__ uint32_t digits[kMaxSortPasses * kSortRadix];
  __shared__ uint32_t base;
  FrameCounts* counts = memory.counts;
  const uint32_t n = counts->projected, t = threadIdx.x;
  const EmitPieces pieces(n);
  if (pieces.first(blockIdx.x) >= n) return;
  const uint32_t piece = take_ticket(&counts->emit_ticket);
  const uint32_t rank = pieces.first(piece) + t, end = min(n, pieces.first(piece + 1));
  uint32_t own_rows = 0;
  if (rank < end) {
    const uint32_t index = order[rank];
    const float4* words = reinterpret_cast<const float4*>(memory.splats + index);
    const float4 a = words[0], b = words[1];
    const TileSpan rows = tiles_between<kTileHeight>(a.y - b.w, a.y + b.w, input.rows);
    const TileSpan columns = tiles_between<kTileWidth>(a.x - b.z, a.x + b.z, input.columns);
    block.index[t] = index;
    block.box[t] = make_ushort4(
        static_cast<unsigned short>(rows.begin), static_cast<unsigned short>(rows.end),
        static_cast<unsigned short>(columns.begin), static_cast<unsigned short>(columns.end));
    prepare_ellipse(a, b, &block.first[t], &block.second[t]);
    if (columns.end > columns.begin)
      own_rows = static_cast<uint32_t>(max(rows.end - rows.begin, 0));
  }
  first_of[t] = end_of[t] = 0;
  clear_digits<kThreads>(input.tile_digits, digits);
  uint32_t num_rows;
  block.row_sum[t] = block_sum_before<kThreads>(own_rows, &num_rows);
  if (t == 0) block.row_sum[kThreads] = num_rows;
  __syncthreads();

  uint32_t total = 0, kept_total = 0;
  for (uint32_t turn = 0; turn < num_rows; turn += kThreads) {
    if (turn == kKeptRows) kept_total = total;
    const uint32_t item = turn + t;
    RowSpan span{};
    if (item < num_rows) span = span_of(block, input, item);
    uint32_t here;
    const uint32_t place =
        total + block_sum_before<kThreads>(static_cast<uint32_t>(span.width), &here);
    total += here;
    if (item < kKeptRows) {
      kept_place[item] = place;
      kept_span[item] = packed(span);
    }
  }
  if (t < 32) {
    const uint32_t sum = sum_before(memory.emit_states, piece, total);
    if (t == 0) {
      base = sum;
      if (end == n) {
        const uint32_t all = sum + min(total, kMostCounted);
        counts->instances = min(all, memory.max_instances);
        counts->wanted = all;
      }
    }
  }
  __syncthreads();

  // An instance of a row of a splat.
  const auto put = [&](uint32_t at, uint32_t tile, uint32_t splat) {
    if (at >= memory.max_instances) return;
    memory.tile_keys[0][at] = tile;
    count_digits(input.tile_digits, tile, digits);
    memory.tile_values[0][at] = input.backward ? at : splat;
    if (input.backward) memory.splat_of[at] = splat;
  };
  for (uint32_t turn = 0; turn < num_rows; turn += kThreads) {
    const uint32_t item = turn + t, slot = item % kKeptRows;
    if (turn >= kKeptRows) {
      RowSpan span{};
      if (item < num_rows) span = span_of(block, input, item);
      uint32_t here;
      const uint32_t place =
          kept_total + block_sum_before<kThreads>(static_cast<uint32_t>(span.width), &here);
      kept_total += here;
      kept_place[slot] = place;
      kept_span[slot] = packed(span);
    }
    const auto splat_of = [&](uint32_t kept) { return kept & 255; };
    const auto tile_of = [&](uint32_t kept, uint32_t its_item) {
      const uint32_t k = splat_of(kept);
      const uint32_t row = block.box[k].x + (its_item - block.row_sum[k]);
      return row * static_cast<uint32_t>(input.columns) + (kept >> 8 & 1023);
    };
    if (input.backward && item < num_rows) {
      const uint32_t k = splat_of(kept_span[slot]), width = kept_span[slot] >> 18;
      if (item == block.row_sum[k]) first_of[k] = kept_place[slot];
      if (item + 1 == block.row_sum[k + 1]) end_of[k] = kept_place[slot] + width;
    }
    __syncthreads();
    // Shared out by instances, as a row may have one or hundreds.
    const uint32_t begin = slot - t, rows = min(num_rows - turn, uint32_t{kThreads});
    const uint32_t last = begin + rows - 1, after = kept_place[last] + (kept_span[last] >> 18);
    for (uint32_t place = kept_place[begin] + t; place < after; place += kThreads) {
      uint32_t row = begin;  // the last that begins there or before
#pragma unroll
      for (uint32_t step = kThreads / 2; step > 0; step /= 2) {
        if (row + step <= last && kept_place[row + step] <= place) row += step;
      }
      const uint32_t kept = kept_span[row];
      const uint32_t tile = tile_of(kept, turn + row - begin) + place - kept_place[row];
      put(base + place, tile, block.index[splat_of(kept)]);
    }
  }
  __syncthreads();
  add_digits<kThreads>(input.tile_digits, digits, memory.tile_histograms);
  if (input.backward && rank < end) {
    memory.first_instance[block.index[t]] = base + first_of[t];
    memory.num_tiles[block.index[t]] = end_of[t] - first_of[t];
  }
}

// Tiles by the lengths of their lists, the long ones first: those begin while there is other work
// to run beside them. In classes of kClass, without order within a class.
constexpr uint32_t kClass = 32, kClasses = 256;

__device__ void order_tiles(uint32_t tiles, const uint2* ranges, uint32_t* order) {
  __shared__ uint32_t begin[kClasses];
  static_assert(kClasses == kThreads, "one class per thread");
  const auto class_of = [&](uint32_t tile) {
    const uint2 range = __ldcg(ranges + tile);  // written by other blocks
    return kClasses - 1 - min((range.y - range.x) / kClass, kClasses - 1);
  };
  // Several tiles at once, so that waiting for memory is shared.
  constexpr uint32_t kAtOnce = 8;
  const auto for_tiles = [&](const auto& body) {
    for (uint32_t first = threadIdx.x; first < tiles; first += kAtOnce * kThreads) {
      uint32_t classes[kAtOnce];
#pragma unroll
      for (uint32_t k = 0; k < kAtOnce; ++k) {
        const uint32_t tile = first + k * kThreads;
        classes[k] = tile < tiles ? class_of(tile) : 0;
      }
#pragma unroll
      for (uint32_t k = 0; k < kAtOnce; ++k) {
        const uint32_t tile = first + k * kThreads;
        if (tile < tiles) body(tile, classes[k]);
      }
    }
  };
  begin[threadIdx.x] = 0;
  __syncthreads();
  for_tiles([&](uint32_t, uint32_t its_class) { atomicAdd(begin + its_class, 1u); });
  __syncthreads();
  uint32_t unused;
  const uint32_t before = block_sum_before<kThreads>(begin[threadIdx.x], &unused);
  __syncthreads();
  begin[threadIdx.x] = before;
  __syncthreads();
  for_tiles(
      [&](uint32_t tile, uint32_t its_class) { order[atomicAdd(begin + its_class, 1u)] = tile; });
}

__global__ void __launch_bounds__(kThreads)
    find_ranges(const uint32_t* tiles, uint32_t num_tiles, FrameMemory memory) {
  await_predecessor();
  const uint32_t n = memory.counts->instances;
  const uint32_t stride = gridDim.x * kThreads;
  for (uint32_t i = blockIdx.x * kThreads + threadIdx.x; i < n; i += stride) {
    const uint32_t tile = tiles[i];
    if (i == 0 || tiles[i - 1] != tile) memory.ranges[tile].x = i;
    if (i + 1 == n || tiles[i + 1] != tile) memory.ranges[tile].y = i + 1;
  }
  // The block that is done last has all ranges before it.
  __threadfence();
  if (take_ticket(&memory.counts->range_ticket) + 1 != gridDim.x) return;
  __threadfence();
  order_tiles(num_tiles, memory.ranges, memory.tile_order);
}

}  // namespace

void launch_emit(const FrameInput& input, const uint32_t* order, const FrameMemory& memory,
                 cudaStream_t stream) {
  launch(emit, EmitPieces::most(memory.max_visible), kThreads, stream, input, order, memory);
}

void launch_ranges(const FrameInput& input, const uint32_t* tiles, const FrameMemory& memory,
                   cudaStream_t stream) {
  const unsigned wanted = (memory.max_instances + kThreads - 1) / kThreads;
  const uint32_t num_tiles = static_cast<uint32_t>(input.columns * input.rows);
  launch(find_ranges, wanted < 1056 ? wanted : 1056, kThreads, stream, tiles, num_tiles, memory);
}

}  // namespace l4d::render
