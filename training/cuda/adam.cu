// SPDX-License-Identifier: Apache-2.0
#include "training/cuda/adam_device.h"
#include "training/step/adam_row.h"

namespace l4d::train {
namespace {

constexpr uint32_t kThreads = 128;
constexpr uint32_t kShAtOnce = 2;  // words of SH that a thread has in flight
constexpr float kAverage = 0.1f;   // weight of a new observation

constexpr uint32_t kLeft = 0, kCleared = 1, kUpdated = 2;  // states of an ShUpdate

__device__ bool is_finite(const float4& v) { return (v.x + v.y + v.z + v.w) * 0 == 0; }

__device__ void update_four(const AdamStep& s, const RowUpdate& u, uint32_t first, float4* x,
                            float4* m, float4* v, const float4& g) {
  const uint32_t active = sh_values(s.active_sh_degree);
  float *xs = &x->x, *ms = &m->x, *vs = &v->x;
  const float* gs = &g.x;
#pragma unroll
  for (uint32_t k = 0; k < 4; ++k) {
    if (first + k >= active) continue;
    update_number(u, xs[k], ms[k], vs[k], gs[k], first + k < 3 ? s.rates.sh_dc : s.rates.sh_rest);
  }
}

// All of a row but its SH, in registers: rows lie side by side in whole words of 16 bytes, and a
// number at a time would move each word once for each of its numbers.
struct LocalRow {
  float position[3], mean_t, log_scale[4], rotor[8], opacity;
  __device__ void load(const Rows<float>& from, uint64_t i) {
    for (uint64_t k = 0; k < 3; ++k) position[k] = from.position[3 * i + k];
    mean_t = from.mean_t[i];
    load4(from.log_scale + 4 * i, log_scale);
    load4(from.rotor + 8 * i, rotor);
    load4(from.rotor + 8 * i + 4, rotor + 4);
    opacity = from.opacity[i];
  }
  __device__ void store(const Rows<float>& to, uint64_t i) const {
    for (uint64_t k = 0; k < 3; ++k) to.position[3 * i + k] = position[k];
    to.mean_t[i] = mean_t;
    store4(log_scale, to.log_scale + 4 * i);
    store4(rotor, to.rotor + 8 * i);
    store4(rotor + 4, to.rotor + 8 * i + 4);
    to.opacity[i] = opacity;
  }
  // Arrays of this row alone.
  __device__ Rows<float> rows() { return {position, &mean_t, log_scale, rotor, &opacity, nullptr}; }

 private:
  __device__ static void load4(const float* from, float* to) {
    const float4 v = *reinterpret_cast<const float4*>(from);
    to[0] = v.x;
    to[1] = v.y;
    to[2] = v.z;
    to[3] = v.w;
  }
  __device__ static void store4(const float* from, float* to) {
    *reinterpret_cast<float4*>(to) = make_float4(from[0], from[1], from[2], from[3]);
  }
};

// A thread has a row, and updates all of it but its SH: that is three quarters of all numbers,
// which move faster where nothing else is done. kWords: of a row of SH.
template <uint32_t kWords>
__global__ void __launch_bounds__(kThreads)
    adam_shape(AdamStep s, AdamArrays a, ShUpdate* updates, const uint32_t* stop,
               unsigned long long* skipped) {
  if (*stop != 0) return;
  __shared__ uint32_t is_bad[kThreads];
  const uint64_t first = uint64_t{blockIdx.x} * kThreads;
  const uint32_t t = threadIdx.x;
  const uint32_t rows =
      static_cast<uint32_t>(s.count - first < kThreads ? s.count - first : uint64_t{kThreads});
  const bool shown = t < rows && !(s.sparse && a.shown[first + t] == 0);
  is_bad[t] = shown ? 0 : 1;  // what is not shown is not looked at
  __syncthreads();
  const auto* gradients = reinterpret_cast<const float4*>(a.gradient.sh) + first * kWords;
#pragma unroll
  for (uint32_t k = 0; k < kWords; ++k) {
    const uint32_t word = k * kThreads + t, row = word / kWords;
    if (row < rows && is_bad[row] == 0 && !is_finite(gradients[word])) is_bad[row] = 1;
  }
  __syncthreads();
  if (t >= rows) return;
  const uint64_t i = first + t;
  ShUpdate out{0, 0, 0, kLeft};
  if (shown) {
    LocalRow value, m, v, g;
    value.load(a.value, i);
    m.load(a.m, i);
    v.load(a.v, i);
    g.load(a.gradient, i);
    const AdamArrays own{value.rows(),   m.rows(),
                         v.rows(),       g.rows(),
                         a.shown + i,    a.updates + i,
                         a.prepared + i, a.born + i,
                         a.id + i,       a.motion == nullptr ? nullptr : a.motion + 3 * i};
    const RowShape shape = row_shape(s, own, 0);
    float sum = static_cast<float>(is_bad[t]);
    for_each_shape_number(s, own, 0, shape.span,
                          [&](float&, float&, float&, float& d, float) { sum += d * 0; });
    if (sum == 0) {
      const RowUpdate update = count_update(s, own, 0);
      update_shape(s, own, 0, shape, update);
      value.store(a.value, i);
      m.store(a.m, i);
      v.store(a.v, i);
      g.store(a.gradient, i);
      out = {update.factor, update.correct1, update.correct2, kUpdated};
    } else {
      clear_shape_gradient(a, i);
      out.state = kCleared;
      atomicAdd(skipped, 1ull);
    }
  }
  updates[i] = out;
}

// A thread has words of 16 bytes, several at a time: compilers do not move loads before stores.
template <uint32_t kWords>
__global__ void __launch_bounds__(kThreads)
    adam_sh(AdamStep s, AdamArrays a, const ShUpdate* updates, const uint32_t* stop) {
  if (*stop != 0) return;
  auto* gradients = reinterpret_cast<float4*>(a.gradient.sh);
  auto* values = reinterpret_cast<float4*>(a.value.sh);
  auto* means = reinterpret_cast<float4*>(a.m.sh);
  auto* squares = reinterpret_cast<float4*>(a.v.sh);
  const uint64_t first = uint64_t{blockIdx.x} * kShAtOnce * kThreads + threadIdx.x;
  ShUpdate u[kShAtOnce];
  float4 x[kShAtOnce], m[kShAtOnce], v[kShAtOnce], g[kShAtOnce];
#pragma unroll
  for (uint32_t k = 0; k < kShAtOnce; ++k) {
    const uint64_t word = first + k * kThreads;
    u[k] = word < kWords * s.count ? updates[word / kWords] : ShUpdate{0, 0, 0, kLeft};
    if (u[k].state == kUpdated && 4 * (word % kWords) >= sh_values(s.active_sh_degree)) {
      u[k].state = kCleared;
    }
    if (u[k].state != kUpdated) continue;
    g[k] = gradients[word];
    x[k] = values[word];
    m[k] = means[word];
    v[k] = squares[word];
  }
#pragma unroll
  for (uint32_t k = 0; k < kShAtOnce; ++k) {
    const uint64_t word = first + k * kThreads;
    if (u[k].state == kLeft) continue;
    gradients[word] = make_float4(0, 0, 0, 0);
    if (u[k].state == kCleared) continue;
    const RowUpdate update{u[k].factor, 1, u[k].correct1, u[k].correct2};
    update_four(s, update, static_cast<uint32_t>(4 * (word % kWords)), &x[k], &m[k], &v[k], g[k]);
    values[word] = x[k];
    means[word] = m[k];
    squares[word] = v[k];
  }
}

// Where the SH of a row is not whole words of 16 bytes.
__global__ void __launch_bounds__(kThreads)
    adam_by_rows(AdamStep s, AdamArrays a, const uint32_t* stop, unsigned long long* skipped) {
  if (*stop != 0) return;
  const uint64_t i = uint64_t{blockIdx.x} * kThreads + threadIdx.x;
  if (i < s.count && !adam_row(s, a, i)) atomicAdd(skipped, 1ull);
}

__global__ void __launch_bounds__(kThreads) catch_up(AdamStep s, AdamArrays a, double time) {
  const uint64_t i = uint64_t{blockIdx.x} * kThreads + threadIdx.x;
  if (i < s.count) catch_up_row(s, a, time, i);
}

__global__ void __launch_bounds__(kThreads)
    note_shown(uint64_t count, uint32_t step, ShownRows rows, RowAverages averages,
               const uint32_t* stop) {
  const uint64_t i = uint64_t{blockIdx.x} * kThreads + threadIdx.x;
  if (i >= count || *stop != 0) return;
  if (rows.shown[i] != 0) averages.last_shown[i] = step;
  if (rows.screen_gradient != nullptr && rows.views[i] != 0) {
    averages.screen_gradient[i] += rows.screen_gradient[i];
    averages.screen_views[i] += rows.views[i];
  }
  if (rows.coverage == nullptr || !(rows.coverage[i] > 0)) return;
  averages.coverage[i] += kAverage * (rows.coverage[i] * rows.each - averages.coverage[i]);
  averages.error[i] += kAverage * (rows.error_coverage[i] * rows.each - averages.error[i]);
}

unsigned grid_of(uint64_t count) {
  return static_cast<unsigned>((count + kThreads - 1) / kThreads);
}

bool in_words(const AdamArrays& a) {
  for (const Rows<float>& rows : {a.value, a.m, a.v, a.gradient}) {
    for (const float* array : {rows.log_scale, rows.rotor, rows.sh}) {
      if (reinterpret_cast<uintptr_t>(array) % sizeof(float4) != 0) return false;
    }
  }
  return true;
}

template <uint32_t kWords>
void launch_in_words(const AdamStep& step, const AdamArrays& arrays, ShUpdate* updates,
                     const uint32_t* stop, unsigned long long* skipped, cudaStream_t stream) {
  adam_shape<kWords>
      <<<grid_of(step.count), kThreads, 0, stream>>>(step, arrays, updates, stop, skipped);
  adam_sh<kWords>
      <<<grid_of((kWords * step.count + kShAtOnce - 1) / kShAtOnce), kThreads, 0, stream>>>(
          step, arrays, updates, stop);
}

}  // namespace

void launch_adam(const AdamStep& step, const AdamArrays& arrays, ShUpdate* updates,
                 const uint32_t* stop, unsigned long long* skipped, cudaStream_t stream) {
  if (step.count == 0) return;
  if (in_words(arrays) && step.sh_degree == 3) {
    launch_in_words<12>(step, arrays, updates, stop, skipped, stream);
  } else if (in_words(arrays) && step.sh_degree == 1) {
    launch_in_words<3>(step, arrays, updates, stop, skipped, stream);
  } else {
    adam_by_rows<<<grid_of(step.count), kThreads, 0, stream>>>(step, arrays, stop, skipped);
  }
}

void launch_catch_up(const AdamStep& step, const AdamArrays& arrays, double time,
                     cudaStream_t stream) {
  if (step.count == 0) return;
  catch_up<<<grid_of(step.count), kThreads, 0, stream>>>(step, arrays, time);
}

void launch_note_shown(const AdamStep& step, const ShownRows& rows, const RowAverages& averages,
                       const uint32_t* stop, cudaStream_t stream) {
  if (step.count == 0) return;
  note_shown<<<grid_of(step.count), kThreads, 0, stream>>>(
      step.count, static_cast<uint32_t>(step.step), rows, averages, stop);
}

}  // namespace l4d::train
