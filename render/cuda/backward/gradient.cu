// SPDX-License-Identifier: Apache-2.0
#include "render/cuda/backward/gradient.h"
#include "render/cuda/kernel/launch.cuh"
#include "render/frame/project_gradient.h"
#include "render/frame/slice_gradient.h"
#include "render/frame/view_gradient.h"

namespace l4d::render {
namespace {

constexpr int kThreads = 128;

// A Gaussian that a frame shows, and how.
template <uint32_t kDegree>
struct Shown {
  uint32_t id;
  SplatSums sums;
  float color[3];      // derivatives by the colour, without the clamp
  float direction[3];  // in which the camera sees it
  double by_mean[2];   // derivatives by the mean in the image, pixels
  Gaussian4D<double> gaussian;
  Instant<double> at;
  SplatGradient3D<double> by_slice;
};

// Times count from the instant itself: that is where differences matter.
__device__ Instant<double> instant_of(const GradientInput& input) {
  return {0.0, input.sequence.begin - input.time, input.sequence.end - input.time,
          (input.gaussians.flags & L4D_POSITION_AT_MEAN_TIME) != 0,
          (input.gaussians.flags & L4D_OPACITY_LOGIT) != 0};
}

__device__ Gaussian4D<double> attributes_of(const GradientInput& input, size_t id) {
  return read_gaussian<double>(input.gaussians, id, input.time);
}

// A Gaussian's numbers in an array, four at a time where they lie so.
template <size_t kCount>
struct Row {
  __device__ static bool in_fours(const float* array, size_t stride) {
    return kCount % 4 == 0 && stride % 4 == 0 &&
           reinterpret_cast<uintptr_t>(array) % sizeof(float4) == 0;
  }
  __device__ static void read(const float* array, size_t id, float* out, size_t stride = kCount) {
    const float* row = array + stride * id;
    if (in_fours(array, stride)) {
#pragma unroll
      for (size_t k = 0; k + 3 < kCount; k += 4) {
        const float4 v = *reinterpret_cast<const float4*>(row + k);
        out[k] = v.x;
        out[k + 1] = v.y;
        out[k + 2] = v.z;
        out[k + 3] = v.w;
      }
    } else {
#pragma unroll
      for (size_t k = 0; k < kCount; ++k) out[k] = row[k];
    }
  }
  template <typename T>
  __device__ static void add(float* array, size_t id, const T* values, size_t stride = kCount) {
    if (array == nullptr) return;
    float sums[kCount];
    read(array, id, sums, stride);
#pragma unroll
    for (size_t k = 0; k < kCount; ++k) sums[k] += static_cast<float>(values[k]);
    float* row = array + stride * id;
    if (in_fours(array, stride)) {
#pragma unroll
      for (size_t k = 0; k + 3 < kCount; k += 4) {
        *reinterpret_cast<float4*>(row + k) =
            make_float4(sums[k], sums[k + 1], sums[k + 2], sums[k + 3]);
      }
    } else {
#pragma unroll
      for (size_t k = 0; k < kCount; ++k) row[k] = sums[k];
    }
  }
};

// Derivatives by the slice, in double and from the slice in double: behind a long splat stand small
// differences of large numbers, which binary32 does not hold. Colour alone goes back in binary32.
// False beyond the last splat that the frame shows, and where the frame is not whole.
template <uint32_t kDegree>
__device__ bool back_to_slice(const GradientInput& input, const View<float>& view,
                              const ResidentGaussians& rows, const FrameMemory& memory,
                              const BackwardMemory& back, bool one_channel, Shown<kDegree>* out,
                              float* by_sh /* [terms, 3] or NULL */) {
  const uint32_t at = blockIdx.x * kThreads + threadIdx.x;
  if (at >= memory.counts->shown || !is_whole(memory)) return false;
  const uint32_t splat = back.shown[at];
  out->sums = back.splats[splat];
  out->color[0] = one_channel ? out->sums.coverage : out->sums.red;
  out->color[1] = one_channel ? out->sums.coverage : out->sums.green;
  out->color[2] = one_channel ? out->sums.coverage : out->sums.blue;
  out->id = rows.id[memory.splats[splat].slot & kSlotMask];
  out->at = instant_of(input);
  out->gaussian = attributes_of(input, out->id);
  const Slice3D<double> slice = slice_at(out->gaussian, out->at);
  const float position[3] = {static_cast<float>(slice.position[0]),
                             static_cast<float>(slice.position[1]),
                             static_cast<float>(slice.position[2])};
  view_direction(view, position, out->direction);
  Projection<double> projection;
  if (!project_geometry(input.view, slice.position, slice.covariance, &projection)) {
    out->by_slice = {};
    out->by_mean[0] = out->by_mean[1] = 0;
    return true;
  }
  // The sums hold derivatives by ln(alpha) = ln(opacity) - q/2 times what q is made of.
  const double* c = projection.covariance;
  const double det = c[0] * c[2] - c[1] * c[1];
  const double conic[3] = {c[2] / det, -c[1] / det, c[0] / det};
  const double x = static_cast<double>(out->sums.x), y = static_cast<double>(out->sums.y);
  SplatGradient2D<double> g;
  g.mean[0] = conic[0] * x + conic[1] * y;
  g.mean[1] = conic[1] * x + conic[2] * y;
  out->by_mean[0] = g.mean[0];
  out->by_mean[1] = g.mean[1];
  g.conic[0] = -0.5 * static_cast<double>(out->sums.xx);
  g.conic[1] = -static_cast<double>(out->sums.xy);
  g.conic[2] = -0.5 * static_cast<double>(out->sums.yy);
  geometry_gradient(input.view, slice.covariance, projection, g, slice.opacity, &out->by_slice);
  out->by_slice.opacity = static_cast<double>(out->sums.one) / slice.opacity;
  constexpr size_t kNumbers = 3 * sh_terms(kDegree);
  float by_direction[3] = {0, 0, 0}, sh[kNumbers];
  Row<kNumbers>::read(input.gaussians.sh, out->id, sh, input.sh_stride);
  shade_gradient(view, kDegree, position, sh, out->color, true, by_direction, by_sh);
  for (int k = 0; k < 3; ++k) {
    out->by_slice.direction[k] = static_cast<double>(by_direction[k]);
    out->by_slice.position[k] += out->by_slice.direction[k];
  }
  return true;
}

// Views that add to the same arrays follow each other, and each shows a Gaussian once.
template <uint32_t kDegree>
__device__ void add_statistics(const View<float>& view, const Shown<kDegree>& shown,
                               const ViewStatistics& out) {
  const uint32_t id = shown.id;
  if (out.shown != nullptr) out.shown[id] = 1;
  if (out.views != nullptr) out.views[id] += 1;
  if (out.coverage != nullptr) out.coverage[id] += shown.sums.coverage;
  if (out.error_coverage != nullptr) out.error_coverage[id] += shown.sums.error;
  if (out.screen_gradient != nullptr) {
    const float x = 0.5f * static_cast<float>(view.width) * static_cast<float>(shown.by_mean[0]);
    const float y = 0.5f * static_cast<float>(view.height) * static_cast<float>(shown.by_mean[1]);
    out.screen_gradient[id] += sqrtf(x * x + y * y);
  }
}

// Splats come in any order, and sums of floating-point numbers would depend on it. So numbers of
// like magnitude, which is a range of kMagnitudeBits of exponents from 2^kLeastExponent on, add up
// as whole multiples of a unit that is 2^-kUnitBits of the range's least.
constexpr int kMagnitudes = 32, kMagnitudeBits = 16, kLeastExponent = -256, kUnitBits = 20;
constexpr int kViewParts = kViewNumbers * kMagnitudes;

__device__ int unit_exponent(int magnitude) {
  return kLeastExponent + kMagnitudeBits * magnitude - kUnitBits;
}

__device__ void add_by_magnitude(double value, unsigned long long* parts /* [kMagnitudes] */) {
  if (value == 0) return;
  const int above = (ilogb(value) - kLeastExponent) / kMagnitudeBits;
  const int magnitude = min(max(above, 0), kMagnitudes - 1);
  const long long units = __double2ll_rn(ldexp(value, -unit_exponent(magnitude)));
  atomicAdd(parts + magnitude, static_cast<unsigned long long>(units));
}

template <uint32_t kDegree>
__device__ void add_view_parts(const GradientInput& input, const Shown<kDegree>& shown,
                               double by_time, unsigned long long* parts /* [kViewParts] */) {
  const Slice3D<double> slice = slice_at(shown.gaussian, shown.at);
  double own[kViewNumbers] = {};
  add_view_gradient(input.view, slice.position, slice.covariance, shown.by_slice, by_time, own);
  bool finite = true;
  for (double v : own) finite = finite && isfinite(v);
  if (!finite) return;
#pragma unroll
  for (int k = 0; k < kViewNumbers; ++k) add_by_magnitude(own[k], parts + kMagnitudes * k);
}

__global__ void sum_view_parts(const long long* parts, double* by_view) {
  await_predecessor();
  double sum = 0;
  for (int m = 0; m < kMagnitudes; ++m) {
    sum += ldexp(static_cast<double>(parts[kMagnitudes * threadIdx.x + m]), unit_exponent(m));
  }
  by_view[threadIdx.x] += sum;
}

// by_view: also that of out, in parts.
template <uint32_t kDegree, bool by_view>
__global__ void __launch_bounds__(kThreads)
    add_gradients(GradientInput input, View<float> view, bool one_channel, ResidentGaussians rows,
                  FrameMemory memory, BackwardMemory back, l4d_gradients out,
                  ViewStatistics statistics) {
  await_predecessor();
  constexpr size_t kNumbers = 3 * sh_terms(kDegree);
  Shown<kDegree> shown;
  float by_sh[kNumbers] = {};
  const bool is_shown = back_to_slice(input, view, rows, memory, back, one_channel, &shown, by_sh);
  Gradient4D<double> g;
  if (is_shown) g = slice_gradient(shown.gaussian, shown.at, shown.by_slice);
  if constexpr (by_view) {
    __shared__ unsigned long long parts[kViewParts];
    for (int k = threadIdx.x; k < kViewParts; k += kThreads) parts[k] = 0;
    __syncthreads();
    if (is_shown) add_view_parts(input, shown, g.time, parts);
    __syncthreads();
    auto* sums = reinterpret_cast<unsigned long long*>(back.by_view);
    for (int k = threadIdx.x; k < kViewParts; k += kThreads) {
      if (parts[k] != 0) atomicAdd(sums + k, parts[k]);
    }
  }
  if (!is_shown) return;
  Row<3>::add(out.position, shown.id, g.position);
  Row<1>::add(out.mean_t, shown.id, &g.mean_t);
  Row<4>::add(out.log_scale, shown.id, g.log_scale);
  Row<8>::add(out.rotor, shown.id, g.rotor);
  Row<1>::add(out.opacity, shown.id, &g.opacity);
  Row<kNumbers>::add(out.sh, shown.id, by_sh, input.sh_stride);
  add_statistics(view, shown, statistics);
}

// A sum and a number that is not negative.
__device__ long long add_fixed(long long sum, double value, int bits) {
  const double scaled = value * static_cast<double>(1ll << bits);
  const long long term =
      scaled < static_cast<double>(kMostWhole) ? __double2ll_rn(scaled) : kMostWhole;  // NaN too
  return min(sum + term, static_cast<long long>(kMostWhole));
}

// Adds a row of squares: coverage, SH, and geometry by attributes.
__device__ void add_squares(long long* numbers, double coverage, double sh, const double* parts) {
  // A row is 64 bytes.
  static_assert(kNumGeometryParts == 6, "a row of four pairs");
  auto* pairs = reinterpret_cast<longlong2*>(numbers);
  longlong2 pair = pairs[0];
  pair.x = add_fixed(pair.x, coverage, kCoverageBits);
  pair.y = add_fixed(pair.y, sh, kShBits);
  pairs[0] = pair;
#pragma unroll
  for (int p = 0; p < 3; ++p) {
    pair = pairs[1 + p];
    pair.x = add_fixed(pair.x, parts[2 * p], kGeometryBits);
    pair.y = add_fixed(pair.y, parts[2 * p + 1], kGeometryBits);
    pairs[1 + p] = pair;
  }
}

template <uint32_t kDegree>
__global__ void __launch_bounds__(kThreads)
    add_importance(GradientInput input, View<float> view, bool one_channel, bool squared,
                   ResidentGaussians rows, FrameMemory memory, BackwardMemory back,
                   ImportanceSums sums) {
  await_predecessor();
  Shown<kDegree> shown;
  float* const no_sh = nullptr;
  if (!back_to_slice(input, view, rows, memory, back, one_channel, &shown, no_sh)) return;
  const size_t id = shown.id;
  sums.seen[id] = 1;
  const double coverage = static_cast<double>(shown.sums.coverage);
  long long* const numbers = sums.numbers + size_t{sums.row.width()} * id;

  constexpr uint32_t kTerms = sh_terms(kDegree);
  float basis[kTerms];
  sh_basis(kDegree, shown.direction[0], shown.direction[1], shown.direction[2], basis);
  // The backward pass asks for the instant of the position, not for the position.
  Gaussian4D<double>& gaussian = shown.gaussian;
  gaussian.opacity = linear_opacity(gaussian, shown.at);
  Instant<double> derived = shown.at;
  derived.logit = false;
  if (squared) {
    derived.at_mean_time = false;
    normalize_rotor(gaussian.rotor, gaussian.rotor);
  }
  const Gradient4D<double> g = slice_gradient(gaussian, derived, shown.by_slice);
  if (squared) {
    // With random signs the channels are three estimates of one square.
    const float* c = shown.color;
    const float square = (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]) / 3;
    double sh = 0;
#pragma unroll
    for (uint32_t k = 0; k < kTerms; ++k) sh += static_cast<double>(square * basis[k] * basis[k]);
    const auto sum_of = [](const double* v, int count) {
      double sum = 0;
      for (int k = 0; k < count; ++k) sum += v[k] * v[k];
      return sum;
    };
    const double parts[kNumGeometryParts] = {sum_of(g.log_scale, 4), sum_of(g.rotor, 4),
                                             sum_of(g.rotor + 4, 4), sum_of(g.position, 3),
                                             g.opacity * g.opacity,  g.mean_t * g.mean_t};
    add_squares(numbers, coverage, sh, parts);
    return;
  }
  uint32_t at = 0;
  const auto add = [&](double v, int bits) {
    numbers[at] = add_fixed(numbers[at], fabs(v), bits);
    ++at;
  };
  add(coverage, kCoverageBits);
#pragma unroll
  for (uint32_t k = 0; k < kTerms; ++k) {
    add(static_cast<double>(shown.color[0] * basis[k]), kShBits);
  }
  for (int k = 0; k < 4; ++k) add(g.log_scale[k], kGeometryBits);
  for (int k = 0; k < 8; ++k) add(g.rotor[k], kGeometryBits);
  for (int k = 0; k < 3; ++k) add(g.position[k], kGeometryBits);
  add(g.opacity, kGeometryBits);
  add(g.mean_t, kGeometryBits);
}

__global__ void __launch_bounds__(kThreads)
    add_visible_only(ResidentGaussians rows, FrameMemory memory, const unsigned long long* coverage,
                     ImportanceSums sums) {
  await_predecessor();
  const uint32_t splat = blockIdx.x * kThreads + threadIdx.x;
  if (splat >= memory.counts->projected || coverage[splat] == 0 || !is_whole(memory)) return;
  const uint32_t id = rows.id[memory.splats[splat].slot & kSlotMask];
  if (!sums.sum_visible_only && sums.seen[id] != 0) return;
  sums.seen[id] = 1;
  sums.visible_only[id] += static_cast<long long>(coverage[splat]);
}
__global__ void __launch_bounds__(kThreads)
    add_sums(const long long* from, long long* to, size_t count) {
  await_predecessor();
  const size_t i = size_t{blockIdx.x} * kThreads + threadIdx.x;
  if (i < count) to[i] = min(to[i] + from[i], static_cast<long long>(kMostWhole));
}

__global__ void __launch_bounds__(kThreads)
    add_flags(const uint8_t* from, uint8_t* to, size_t count) {
  await_predecessor();
  const size_t i = size_t{blockIdx.x} * kThreads + threadIdx.x;
  if (i < count) to[i] |= from[i];
}

static_assert(kCoverageUnit * (1 << kCoverageBits) == 1, "one unit of coverage");

template <class Body>
void for_degree(uint32_t degree, const Body& body) {
  switch (degree) {
    case 0:
      return body(std::integral_constant<uint32_t, 0>());
    case 1:
      return body(std::integral_constant<uint32_t, 1>());
    case 2:
      return body(std::integral_constant<uint32_t, 2>());
    default:
      return body(std::integral_constant<uint32_t, 3>());
  }
}

View<float> narrow(const View<double>& v) {
  View<float> out;
  const auto f = [](double x) { return static_cast<float>(x); };
  out.width = v.width;
  out.height = v.height;
  out.fx = f(v.fx);
  out.fy = f(v.fy);
  out.cx = f(v.cx);
  out.cy = f(v.cy);
  out.near_plane = f(v.near_plane);
  for (int k = 0; k < 9; ++k) out.rotation[k] = f(v.rotation[k]);
  for (int k = 0; k < 3; ++k) out.translation[k] = f(v.translation[k]);
  for (int k = 0; k < 3; ++k) out.center[k] = f(v.center[k]);
  for (int k = 0; k < 2; ++k) out.min_slope[k] = f(v.min_slope[k]);
  for (int k = 0; k < 2; ++k) out.max_slope[k] = f(v.max_slope[k]);
  return out;
}

}  // namespace

void launch_gradients(const GradientInput& input, const BackwardTask& task,
                      const ResidentGaussians& rows, const FrameMemory& memory,
                      const BackwardMemory& back, const l4d_gradients& out,
                      const ViewStatistics& statistics, cudaStream_t stream) {
  const unsigned grid = (memory.max_visible + kThreads - 1) / kThreads;
  const bool by_view = out.view != nullptr;
  if (by_view) cudaMemsetAsync(back.by_view, 0, view_parts_bytes(), stream);
  for_degree(input.gaussians.sh_degree, [&](auto degree) {
    constexpr uint32_t kDegree = decltype(degree)::value;
    launch(by_view ? add_gradients<kDegree, true> : add_gradients<kDegree, false>, grid, kThreads,
           stream, input, narrow(input.view), task.upstream == Upstream::kOnes, rows, memory, back,
           out, statistics);
  });
  if (by_view) launch(sum_view_parts, 1, kViewNumbers, stream, back.by_view, out.view);
}

size_t view_parts_bytes() { return kViewParts * sizeof(long long); }

void launch_importance(const GradientInput& input, const BackwardTask& task, bool squared,
                       const ResidentGaussians& rows, const FrameMemory& memory,
                       const BackwardMemory& back, const ImportanceSums& sums,
                       cudaStream_t stream) {
  const unsigned grid = (memory.max_visible + kThreads - 1) / kThreads;
  for_degree(input.gaussians.sh_degree, [&](auto degree) {
    launch(add_importance<decltype(degree)::value>, grid, kThreads, stream, input,
           narrow(input.view), task.upstream == Upstream::kOnes, squared, rows, memory, back, sums);
  });
}

void launch_add_sums(const ImportanceSums& from, size_t count, const ImportanceSums& to,
                     cudaStream_t stream) {
  if (count == 0) return;
  const auto grid = [](size_t n) { return static_cast<unsigned>((n + kThreads - 1) / kThreads); };
  const size_t numbers = count * from.row.width();
  launch(add_sums, grid(numbers), kThreads, stream, from.numbers, to.numbers, numbers);
  launch(add_sums, grid(count), kThreads, stream, from.visible_only, to.visible_only, count);
  launch(add_flags, grid(count), kThreads, stream, from.seen, to.seen, count);
}

void launch_visible_only(const ResidentGaussians& rows, const FrameMemory& memory,
                         const unsigned long long* coverage, const ImportanceSums& sums,
                         cudaStream_t stream) {
  const unsigned grid = (memory.max_visible + kThreads - 1) / kThreads;
  launch(add_visible_only, grid, kThreads, stream, rows, memory, coverage, sums);
}

}  // namespace l4d::render
