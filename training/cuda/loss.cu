// SPDX-License-Identifier: Apache-2.0
// A block of threads has a tile of 32x32 pixels. It brings the pixels that the window reaches to
// shared memory, blurs along rows, four pixels a thread, then along columns, four again.
#include <cmath>

#include "training/cuda/loss_device.h"

namespace l4d::train {
namespace {

constexpr int kRadius = 5, kTaps = 2 * kRadius + 1;
constexpr int kTile = 32, kSpan = kTile + 2 * kRadius;
constexpr int kStride = 44;  // of a row with its margins: whole words of 16 bytes
constexpr int kThreads = 256, kEach = 4;
constexpr int kGroups = kTile / kEach;  // of a row's pixels
constexpr int kSums = 12;               // of a block, at most
static_assert(kThreads / kTile * kEach == kTile, "a thread has four pixels of a column");

struct Window {
  float tap[kTaps];
};

Window make_window() {
  Window w;
  double taps[kTaps], sum = 0;
  for (int k = 0; k < kTaps; ++k) sum += taps[k] = std::exp((k - kRadius) * (k - kRadius) / -4.5);
  for (int k = 0; k < kTaps; ++k) w.tap[k] = static_cast<float>(taps[k] / sum);
  return w;
}

__device__ bool counts(const LossView<float>& v, size_t pixel) {
  return v.mask == nullptr || v.mask[pixel] != 0;
}
__device__ float exposed(const LossView<float>& v, size_t pixel, int c) {
  const float* rgb = v.rendered + 3 * pixel;
  if (v.exposure == nullptr) return rgb[c];
  const float* e = v.exposure + 4 * c;
  return e[0] * rgb[0] + e[1] * rgb[1] + e[2] * rgb[2] + e[3];
}
__device__ float captured(const LossView<float>& v, size_t pixel, int c) {
  constexpr float kUnit = 1.0f / 255;
  const float value = static_cast<float>(v.target[3 * pixel + static_cast<size_t>(c)]) * kUnit;
  if (v.alpha == nullptr) return value;
  const float alpha = static_cast<float>(v.alpha[pixel]) * kUnit;
  return alpha * value + (1 - alpha) * v.background[c];
}

// A tile of a view.
struct Tile {
  int x, y, width, height;  // first pixel; of the image
  uint32_t index, tiles;    // of the view
  __device__ explicit Tile(const LossView<float>& v)
      : x(static_cast<int>(blockIdx.x) * kTile),
        y(static_cast<int>(blockIdx.y) * kTile),
        width(static_cast<int>(v.width)),
        height(static_cast<int>(v.height)) {
    const uint32_t columns = (v.width + kTile - 1) / kTile;
    index = blockIdx.y * columns + blockIdx.x;
    tiles = columns * ((v.height + kTile - 1) / kTile);
  }
  __device__ bool is_outside() const { return x >= width || y >= height; }
  // body(place in shared memory, whether there is a pixel, its number).
  template <class Body>
  __device__ void for_margins(const Body& body) const {
    // Unrolled, so that all loads are under way together.
#pragma unroll
    for (int turn = 0; turn < (kSpan * kSpan + kThreads - 1) / kThreads; ++turn) {
      const int i = turn * kThreads + static_cast<int>(threadIdx.x);
      if (i >= kSpan * kSpan) continue;
      const int row = i / kSpan, column = i % kSpan;
      const int px = x + column - kRadius, py = y + row - kRadius;
      const bool inside = px >= 0 && py >= 0 && px < width && py < height;
      body(row * kStride + column, inside,
           inside ? static_cast<size_t>(py) * static_cast<size_t>(width) + static_cast<size_t>(px)
                  : size_t{0});
    }
  }
  // The thread's pixels: body(k, whether it is in the image, its number).
  template <class Body>
  __device__ void for_own(const Body& body) const {
    const int px = x + static_cast<int>(threadIdx.x % kTile);
    const int first = y + static_cast<int>(threadIdx.x / kTile) * kEach;
#pragma unroll
    for (int k = 0; k < kEach; ++k) {
      body(k, px < width && first + k < height,
           static_cast<size_t>(first + k) * static_cast<size_t>(width) + static_cast<size_t>(px));
    }
  }
};

// Four pixels of a row, with what the window reaches.
__device__ void read_row(const float* from, float* out /* [16] */) {
#pragma unroll
  for (int k = 0; k < 16; k += 4) {
    const float4 v = *reinterpret_cast<const float4*>(from + k);
    out[k] = v.x;
    out[k + 1] = v.y;
    out[k + 2] = v.z;
    out[k + 3] = v.w;
  }
}

// body(item, where it begins in a plane with margins, where it goes).
template <class Body>
__device__ void for_row_groups(const Body& body) {
  for (int i = static_cast<int>(threadIdx.x); i < kSpan * kGroups; i += kThreads) {
    const int row = i / kGroups, group = i % kGroups;
    body(row * kStride + group * kEach, row * kTile + group * kEach);
  }
}

// The thread's pixels of a plane that is blurred along rows.
__device__ void blur_column(const Window& w, const float* plane, float* out /* [kEach] */) {
  const int column = static_cast<int>(threadIdx.x % kTile);
  const int first = static_cast<int>(threadIdx.x / kTile) * kEach;
#pragma unroll
  for (int j = 0; j < kEach; ++j) out[j] = 0;
#pragma unroll
  for (int k = 0; k < kTaps + kEach - 1; ++k) {
    const float v = plane[(first + k) * kTile + column];
#pragma unroll
    for (int j = 0; j < kEach; ++j) {
      if (k - j >= 0 && k - j < kTaps) out[j] = fmaf(w.tap[k - j], v, out[j]);
    }
  }
}

// Sums over the block, in a fixed order; in all threads of warp 0. `own` is replaced.
template <int kCount>
__device__ void sum_block(float* own, double* out) {
  __shared__ float sums[kThreads / 32][kCount];
  const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32;
#pragma unroll
  for (int k = 0; k < kCount; ++k) {
    for (int step = 16; step > 0; step /= 2) own[k] += __shfl_xor_sync(~0u, own[k], step);
    if (lane == 0) sums[warp][k] = own[k];
  }
  __syncthreads();
  for (int k = 0; k < kCount; ++k) {
    out[k] = 0;
    for (int w = 0; w < kThreads / 32; ++w) out[k] += static_cast<double>(sums[w][k]);
  }
  __syncthreads();
}

// Keeps the block's sums; the last block of `blocks` adds up those of all, in order. True in thread
// 0 of that block, with the sums in `sums`.
template <int kCount>
__device__ bool add_blocks(const DeviceLossView& v, uint32_t block, uint32_t blocks, double* sums) {
  __shared__ bool last;
  __shared__ double total[kThreads];
  if (threadIdx.x == 0) {
    for (int k = 0; k < kCount; ++k)
      v.partial[size_t{block} * kSums + static_cast<size_t>(k)] = sums[k];
    __threadfence();
    last = atomicAdd(&v.sums->ticket, 1u) + 1 == blocks;
  }
  __syncthreads();
  if (!last) return false;
  __threadfence();
  for (int k = 0; k < kCount; ++k) {
    double sum = 0;
    for (uint32_t b = threadIdx.x; b < blocks; b += kThreads) {
      sum += __ldcg(v.partial + size_t{b} * kSums + static_cast<size_t>(k));
    }
    total[threadIdx.x] = sum;
    __syncthreads();
    for (uint32_t half = kThreads / 2; half > 0; half /= 2) {
      if (threadIdx.x < half) total[threadIdx.x] += total[threadIdx.x + half];
      __syncthreads();
    }
    sums[k] = total[0];
    __syncthreads();
  }
  if (threadIdx.x == 0) v.sums->ticket = 0;
  return threadIdx.x == 0;
}

// S, and the factors of its derivative, from blurred x, y, xx, yy and xy.
__device__ float similarity_of(const float* m, float* a, float* b, float* c) {
  constexpr float kC1 = 0.01f * 0.01f, kC2 = 0.03f * 0.03f;
  const float mx = m[0], my = m[1];
  const float big_a = mx * mx + my * my + kC1;
  const float big_b = (m[2] - mx * mx) + (m[3] - my * my) + kC2;
  const float big_c = 2 * mx * my + kC1;
  const float big_d = 2 * (m[4] - mx * my) + kC2;
  const float by_a = __fdividef(1.0f, big_a), by_b = __fdividef(1.0f, big_b), both = by_a * by_b;
  const float s = big_c * big_d * both;
  *a = 2 * my * (big_d - big_c) * both + 2 * mx * s * (by_b - by_a);
  *b = -s * by_b;
  *c = 2 * big_c * both;
  return s;
}

// A channel of a view.
__global__ void __launch_bounds__(kThreads)
    forward(DeviceLossBatch batch, Window w, uint32_t* stop) {
  __shared__ __align__(16) float image[2][kSpan * kStride];
  __shared__ __align__(16) float rows[5][kSpan * kTile];
  const DeviceLossView& v = batch.views[blockIdx.z / 3];
  const int channel = static_cast<int>(blockIdx.z % 3);
  const Tile tile(v.view);
  if (tile.is_outside()) return;
  tile.for_margins([&](int place, bool inside, size_t pixel) {
    const bool counted = inside && counts(v.view, pixel);
    image[0][place] = counted ? exposed(v.view, pixel, channel) : 0.0f;
    image[1][place] = counted ? captured(v.view, pixel, channel) : 0.0f;
  });
  __syncthreads();
  for_row_groups([&](int from, int to) {
    float x[16], y[16], out[5][kEach] = {};
    read_row(image[0] + from, x);
    read_row(image[1] + from, y);
#pragma unroll
    for (int i = 0; i < kTaps + kEach - 1; ++i) {
      const float xx = x[i] * x[i], yy = y[i] * y[i], xy = x[i] * y[i];
#pragma unroll
      for (int j = 0; j < kEach; ++j) {
        if (i - j < 0 || i - j >= kTaps) continue;
        const float tap = w.tap[i - j];
        out[0][j] = fmaf(tap, x[i], out[0][j]);
        out[1][j] = fmaf(tap, y[i], out[1][j]);
        out[2][j] = fmaf(tap, xx, out[2][j]);
        out[3][j] = fmaf(tap, yy, out[3][j]);
        out[4][j] = fmaf(tap, xy, out[4][j]);
      }
    }
#pragma unroll
    for (int p = 0; p < 5; ++p) {
      *reinterpret_cast<float4*>(rows[p] + to) =
          make_float4(out[p][0], out[p][1], out[p][2], out[p][3]);
    }
  });
  __syncthreads();
  float blurred[5][kEach], own[4] = {};
#pragma unroll
  for (int p = 0; p < 5; ++p) blur_column(w, rows[p], blurred[p]);
  const size_t n = size_t{v.view.width} * v.view.height;
  float* const factors = v.factors + 3 * n * static_cast<size_t>(channel);
  const int column = static_cast<int>(threadIdx.x % kTile) + kRadius;
  const int first = static_cast<int>(threadIdx.x / kTile) * kEach + kRadius;
  tile.for_own([&](int k, bool inside, size_t pixel) {
    if (!inside) return;
    const bool counted = counts(v.view, pixel);
    const float moments[5] = {blurred[0][k], blurred[1][k], blurred[2][k], blurred[3][k],
                              blurred[4][k]};
    float a, b, c;
    const float s = similarity_of(moments, &a, &b, &c);
    factors[pixel] = counted ? a : 0.0f;
    factors[n + pixel] = counted ? b : 0.0f;
    factors[2 * n + pixel] = counted ? c : 0.0f;
    if (!counted) return;
    const int place = (first + k) * kStride + column;
    const float difference = image[0][place] - image[1][place];
    own[0] += fabsf(difference);
    own[1] = fmaf(difference, difference, own[1]);
    own[2] += s;
    own[3] += 1;
  });
  double sums[4];
  sum_block<4>(own, sums);
  const uint32_t block = tile.index * 3 + static_cast<uint32_t>(channel);
  if (!add_blocks<4>(v, block, 3 * tile.tiles, sums)) return;
  v.sums->absolute = sums[0];
  v.sums->squared = sums[1];
  v.sums->similarity = sums[2];
  v.sums->values = static_cast<unsigned long long>(sums[3]);
  if (!isfinite(sums[0] + sums[1] + sums[2])) atomicExch(stop, 1u);
}

__global__ void __launch_bounds__(kThreads) backward(DeviceLossBatch batch, Window w) {
  __shared__ __align__(16) float planes[3][kSpan * kStride];
  __shared__ __align__(16) float rows[3][kSpan * kTile];
  const DeviceLossView& v = batch.views[blockIdx.z];
  const Tile tile(v.view);
  if (tile.is_outside()) return;
  const size_t n = size_t{v.view.width} * v.view.height;
  const double values = static_cast<double>(v.sums->values);
  const float each = values > 0 ? static_cast<float>(static_cast<double>(v.weight) / values) : 0.0f;
  const float of_l1 = each * (1 - v.view.ssim_weight), of_s = -each * v.view.ssim_weight;
  float gradient[kEach][3] = {}, error[kEach] = {}, by_exposure[kSums] = {};
#pragma unroll
  for (int channel = 0; channel < 3; ++channel) {
    const float* factors = v.factors + 3 * n * static_cast<size_t>(channel);
    __syncthreads();
    tile.for_margins([&](int place, bool inside, size_t pixel) {
#pragma unroll
      for (size_t f = 0; f < 3; ++f) {
        planes[f][place] = inside ? factors[f * n + pixel] : 0.0f;
      }
    });
    __syncthreads();
    for_row_groups([&](int from, int to) {
#pragma unroll
      for (int f = 0; f < 3; ++f) {
        float in[16], out[kEach] = {};
        read_row(planes[f] + from, in);
#pragma unroll
        for (int k = 0; k < kTaps; ++k) {
#pragma unroll
          for (int j = 0; j < kEach; ++j) out[j] = fmaf(w.tap[k], in[j + k], out[j]);
        }
        *reinterpret_cast<float4*>(rows[f] + to) = make_float4(out[0], out[1], out[2], out[3]);
      }
    });
    __syncthreads();
    float a[kEach], b[kEach], g[kEach];
    blur_column(w, rows[0], a);
    blur_column(w, rows[1], b);
    blur_column(w, rows[2], g);
    tile.for_own([&](int k, bool inside, size_t pixel) {
      if (!inside || !counts(v.view, pixel)) return;
      const float* rgb = v.view.rendered + 3 * pixel;
      const float x = exposed(v.view, pixel, channel), y = captured(v.view, pixel, channel);
      const float sign = static_cast<float>((x > y) - (x < y));
      const float by_x = of_l1 * sign + of_s * (a[k] + 2 * x * b[k] + y * g[k]);
      error[k] += fabsf(rgb[channel] - y);
      if (v.view.exposure == nullptr) {
        gradient[k][channel] = by_x;
        return;
      }
      const float* e = v.view.exposure + 4 * channel;
#pragma unroll
      for (int i = 0; i < 3; ++i) {
        gradient[k][i] = fmaf(e[i], by_x, gradient[k][i]);
        by_exposure[4 * channel + i] = fmaf(by_x, rgb[i], by_exposure[4 * channel + i]);
      }
      by_exposure[4 * channel + 3] += by_x;
    });
  }
  tile.for_own([&](int k, bool inside, size_t pixel) {
    if (!inside) return;
#pragma unroll
    for (size_t c = 0; c < 3; ++c) v.rgb_gradient[3 * pixel + c] = gradient[k][c];
    if (v.error != nullptr) v.error[pixel] = error[k] / 3;
  });
  if (v.view.exposure == nullptr) return;
  double sums[kSums];
  sum_block<kSums>(by_exposure, sums);
  if (!add_blocks<kSums>(v, tile.index, tile.tiles, sums)) return;
  for (int k = 0; k < kSums; ++k) v.sums->by_exposure[k] = sums[k];
}

dim3 grid_of(const DeviceLossBatch& batch, uint32_t parts) {
  uint32_t width = 1, height = 1;
  for (uint32_t v = 0; v < batch.count; ++v) {
    width = batch.views[v].view.width > width ? batch.views[v].view.width : width;
    height = batch.views[v].view.height > height ? batch.views[v].view.height : height;
  }
  return dim3((width + kTile - 1) / kTile, (height + kTile - 1) / kTile, parts * batch.count);
}

}  // namespace

size_t loss_partial_size(uint32_t width, uint32_t height) {
  return size_t{3} * kSums * ((width + kTile - 1) / kTile) * ((height + kTile - 1) / kTile);
}

void launch_loss_forward(const DeviceLossBatch& batch, uint32_t* stop, cudaStream_t stream) {
  if (batch.count == 0) return;
  forward<<<grid_of(batch, 3), kThreads, 0, stream>>>(batch, make_window(), stop);
}

void launch_loss_backward(const DeviceLossBatch& batch, cudaStream_t stream) {
  if (batch.count == 0) return;
  backward<<<grid_of(batch, 1), kThreads, 0, stream>>>(batch, make_window());
}

}  // namespace l4d::train
