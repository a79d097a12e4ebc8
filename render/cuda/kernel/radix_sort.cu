// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/kernel/launch.cuh"
#include "render/cuda/kernel/ordered.cuh"
#include "render/cuda/kernel/radix_sort.h"

namespace l4d::render {
namespace {

constexpr int kThreads = 256;  // one per digit
constexpr int kWarps = kThreads / 32;
constexpr int kItems = 12;  // keys per thread
constexpr uint32_t kPiece = kThreads * kItems;

size_t pieces_of(uint32_t capacity) { return (size_t{capacity} + kPiece - 1) / kPiece; }

struct Pass {
  const uint32_t* keys_in;
  const uint32_t* values_in;
  uint32_t* keys_out;
  uint32_t* values_out;
  const uint32_t* count;
  const uint32_t* histogram;  // [kSortRadix]
  uint32_t* states;           // [pieces, kSortRadix]
  uint32_t* ticket;
  int shift;
};

// Where the digit's keys of this piece begin: one thread per digit. `start` is where the digit's
// keys begin in all.
__device__ uint32_t digit_base(uint32_t* states, uint32_t piece, uint32_t count, uint32_t start) {
  uint32_t* own = states + size_t{piece} * kSortRadix + threadIdx.x;
  if (piece == 0) {
    store_state(own, kAllCounts | (start + count));
    return start;
  }
  store_state(own, kOwnCount | count);
  // The nearest one first; the others then are there as well, mostly, and come several at a time.
  constexpr int kAhead = 8;
  uint32_t sum = 0;
  bool done = false;
  for (int64_t at = int64_t{piece} - 1; !done;) {
    uint32_t state[kAhead];
    const uint32_t* nearest = states + at * kSortRadix + threadIdx.x;
    while (((state[0] = load_state(nearest)) >> 30) == 0) __nanosleep(40);
    if ((state[0] >> 30) == 2) {
      sum += state[0] & kCountMask;
      break;
    }
#pragma unroll
    for (int k = 1; k < kAhead; ++k) {
      state[k] = at >= k ? load_state(nearest - k * kSortRadix) : 0;
    }
#pragma unroll
    for (int k = 0; k < kAhead; ++k) {
      if (done || (state[k] >> 30) == 0) break;
      sum += state[k] & kCountMask;
      done = (state[k] >> 30) == 2;
      --at;
    }
  }
  store_state(own, kAllCounts | (sum + count));
  return sum;
}

template <bool kIota, int kBits>
__global__ void __launch_bounds__(kThreads, 3) sort_pass(Pass pass) {
  await_predecessor();
  __shared__ uint32_t counts[kWarps][kSortRadix];
  __shared__ uint32_t sorted_keys[kPiece], sorted_values[kPiece];
  __shared__ uint32_t
      target[kSortRadix];  // where a digit's keys go, less where they lie in the piece
  const uint32_t n = *pass.count;
  if (blockIdx.x * kPiece >= n) return;
  const uint32_t piece = take_ticket(pass.ticket);
  const uint32_t first = piece * kPiece;
  const uint32_t lane = threadIdx.x & 31, warp = threadIdx.x / 32;
  constexpr uint32_t kDigitMask = (1u << kBits) - 1;
  for (int w = 0; w < kWarps; ++w) counts[w][threadIdx.x] = 0;
  __syncthreads();

  // A key that there is not has the highest digit and comes last.
  uint32_t key[kItems], value[kItems], rank[kItems];
#pragma unroll
  for (int k = 0; k < kItems; ++k) {
    const uint32_t at = first + warp * (32 * kItems) + static_cast<uint32_t>(k) * 32 + lane;
    key[k] = at < n ? pass.keys_in[at] : 0xffffffffu;
  }
  // Lanes with the same digit: of all keys first, for none of this waits for the counts.
#pragma unroll
  for (int k = 0; k < kItems; ++k) {
    const uint32_t digit = (key[k] >> pass.shift) & kDigitMask;
    uint32_t same = kFullWarp;
#pragma unroll
    for (int b = 0; b < kBits; ++b) {
      const bool set = ((digit >> b) & 1) != 0;
      const uint32_t votes = __ballot_sync(kFullWarp, set);
      same &= set ? votes : ~votes;
    }
    rank[k] = same;
  }
#pragma unroll
  for (int k = 0; k < kItems; ++k) {
    const uint32_t digit = (key[k] >> pass.shift) & kDigitMask;
    const uint32_t same = rank[k];
    const uint32_t before = counts[warp][digit];
    __syncwarp();
    const uint32_t lower = same & ((1u << lane) - 1);
    rank[k] = before + static_cast<uint32_t>(__popc(lower));
    if (lower == 0) counts[warp][digit] = before + static_cast<uint32_t>(__popc(same));
    __syncwarp();
  }
#pragma unroll
  for (int k = 0; k < kItems; ++k) {
    const uint32_t at = first + warp * (32 * kItems) + static_cast<uint32_t>(k) * 32 + lane;
    value[k] = kIota ? at : at < n ? pass.values_in[at] : 0;
  }
  __syncthreads();

  // A thread per digit: where each warp's keys of it lie, in the piece and in all.
  uint32_t total = 0;
  for (int w = 0; w < kWarps; ++w) {
    const uint32_t here = counts[w][threadIdx.x];
    counts[w][threadIdx.x] = total;
    total += here;
  }
  uint32_t unused;
  const uint32_t in_piece = block_sum_before<kThreads>(total, &unused);
  for (int w = 0; w < kWarps; ++w) counts[w][threadIdx.x] += in_piece;
  uint32_t start = 0;
  if (piece == 0) start = block_sum_before<kThreads>(pass.histogram[threadIdx.x], &unused);
  target[threadIdx.x] = digit_base(pass.states, piece, total, start) - in_piece;
  __syncthreads();

#pragma unroll
  for (int k = 0; k < kItems; ++k) {
    const uint32_t at = counts[warp][(key[k] >> pass.shift) & kDigitMask] + rank[k];
    sorted_keys[at] = key[k];
    sorted_values[at] = value[k];
  }
  __syncthreads();
  const uint32_t here = min(kPiece, n - first);
  for (uint32_t at = threadIdx.x; at < here; at += kThreads) {
    const uint32_t k = sorted_keys[at];
    const uint32_t to = target[(k >> pass.shift) & kDigitMask] + at;
    pass.keys_out[to] = k;
    pass.values_out[to] = sorted_values[at];
  }
}

template <bool kIota>
void (*kernel_of(int bits))(Pass) {
  switch (bits) {
    case 5:
      return sort_pass<kIota, 5>;
    case 6:
      return sort_pass<kIota, 6>;
    case 7:
      return sort_pass<kIota, 7>;
    default:
      return sort_pass<kIota, 8>;  // fewer bits are a wider digit whose rest is 0
  }
}
void (*kernel_of(int bits, bool iota))(Pass) {
  return iota ? kernel_of<true>(bits) : kernel_of<false>(bits);
}

}  // namespace

SortDigits sort_digits(int bits) {
  SortDigits d{};
  d.passes = (bits + 7) / 8;
  int shift = 0;
  for (int p = 0; p < d.passes; ++p) {
    d.bits[p] = (bits - shift + d.passes - p - 1) / (d.passes - p);
    d.shift[p] = shift;
    shift += d.bits[p];
  }
  return d;
}

size_t sort_state_words(uint32_t capacity, int bits) {
  const size_t passes = static_cast<size_t>(sort_digits(bits).passes);
  return passes * kSortRadix * pieces_of(capacity);
}

void sort_pairs(const SortBuffers& b, int bits, bool iota, int* where, cudaStream_t stream) {
  const SortDigits digits = sort_digits(bits);
  const size_t pieces = pieces_of(b.capacity);
  const unsigned grid = static_cast<unsigned>(pieces);
  int from = 0;
  for (int p = 0; p < digits.passes; ++p, from ^= 1) {
    const Pass pass{b.keys[from],
                    b.values[from],
                    b.keys[from ^ 1],
                    b.values[from ^ 1],
                    b.count,
                    b.histograms + p * kSortRadix,
                    b.states + static_cast<size_t>(p) * pieces * kSortRadix,
                    b.tickets + p,
                    digits.shift[p]};
    const bool first = p == 0 && iota;
    launch(kernel_of(digits.bits[p], first), grid, kThreads, stream, pass);
  }
  *where = from;
}

}  // namespace l4d::render
