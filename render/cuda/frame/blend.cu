// SPDX-License-Identifier: Apache-2.0
// Front-to-back blending of tiles.
#include "render/cuda/frame/blend.cuh"
#include "render/cuda/kernel/launch.cuh"

namespace l4d::render {
namespace {

// Half a tile each: fewer warps that wait for each other.
using Block = BlockOfTile<kTileWidth / 2, 1>;
constexpr int kBatch = 128;
static_assert(kBatch <= Block::kThreads, "one thread fetches one splat");
constexpr float kStop = static_cast<float>(kMinTransmittance);
constexpr float kCut = static_cast<float>(kMaxAlpha);

struct Pixel {
  float transmittance = 1, red = 0, green = 0, blue = 0;
  // What log2(alpha) must reach to count; beyond all where the pixel is done.
  float threshold = kDeviceLog2MinAlpha;

  __device__ bool done() const { return threshold > 0; }
  // Without branches: of a warp nearly always some pixel counts.
  __device__ void blend(float log2_alpha, const DeviceSplat& s) {
    const float alpha = log2_alpha >= threshold ? fminf(exp2_fast(log2_alpha), kCut) : 0.0f;
    float weight = transmittance * alpha;
    const float left = transmittance - weight;
    // What is left of a pixel never falls below kStop, so that alpha 0 does not stop it.
    const bool stops = left < kStop;
    weight = stops ? 0.0f : weight;
    red = fmaf(weight, s.color[0], red);
    green = fmaf(weight, s.color[1], green);
    blue = fmaf(weight, s.color[2], blue);
    transmittance = stops ? transmittance : left;
    threshold = stops ? INFINITY : threshold;
  }
};

__device__ uint32_t to_byte(float v) {
  return static_cast<uint32_t>(__float2int_rn(255.0f * fminf(fmaxf(v, 0.0f), 1.0f)));
}

__device__ void store(const ImageTarget& target, const FrameInput& input, int x, int y,
                      const Pixel& pixel) {
  if (x >= input.view.width || y >= input.view.height) return;
  const size_t at =
      static_cast<size_t>(y) * static_cast<size_t>(input.view.width) + static_cast<size_t>(x);
  const float t = pixel.transmittance;
  const float rgb[3] = {fmaf(t, input.background[0], pixel.red),
                        fmaf(t, input.background[1], pixel.green),
                        fmaf(t, input.background[2], pixel.blue)};
  if (target.rgb != nullptr) {
    for (int c = 0; c < 3; ++c) target.rgb[3 * at + static_cast<size_t>(c)] = rgb[c];
  }
  if (target.alpha != nullptr) target.alpha[at] = 1.0f - t;
  if (target.rgba8 != nullptr) {
    target.rgba8[at] =
        to_byte(rgb[0]) | to_byte(rgb[1]) << 8 | to_byte(rgb[2]) << 16 | to_byte(1.0f - t) << 24;
  }
}

__global__ void __launch_bounds__(Block::kThreads)
    blend(FrameInput input, const uint32_t* values, FrameMemory memory, ImageTarget target) {
  await_predecessor();
  __shared__ DeviceSplat batch[2][kBatch];
  const Block block(input, memory);
  const WarpPixels pixels(block);
  const uint2 range = block.range;
  Pixel upper, lower;
  if (pixels.x >= input.view.width || pixels.y >= input.view.height) upper.threshold = INFINITY;
  if (pixels.x >= input.view.width || pixels.y + kRowStep >= input.view.height) {
    lower.threshold = INFINITY;
  }
  const float px = static_cast<float>(pixels.x) + 0.5f, py = static_cast<float>(pixels.y) + 0.5f;
  walk_tile<kBatch>(
      memory.splats, range.y - range.x, pixels, batch,
      [&](uint32_t entry) {
        const uint32_t value = values[range.x + entry];
        return input.backward ? memory.splat_of[value] : value;
      },
      [&](uint32_t, const DeviceSplat& s) {
        const float dx = px - s.mean[0], dy = py - s.mean[1];
        const float linear = s.conic[1] * dx;
        const float base = fmaf(s.conic[0] * dx, dx, s.log2_opacity);
        const float dy2 = dy + static_cast<float>(kRowStep);
        const float upper_alpha = fmaf(dy, fmaf(s.conic_yy, dy, linear), base);
        const float lower_alpha = fmaf(dy2, fmaf(s.conic_yy, dy2, linear), base);
        if (!__any_sync(kFullWarp,
                        upper_alpha >= upper.threshold || lower_alpha >= lower.threshold)) {
          return;
        }
        upper.blend(upper_alpha, s);
        lower.blend(lower_alpha, s);
      },
      [&] { return __all_sync(kFullWarp, upper.done() && lower.done()) != 0; },
      [](uint32_t, uint32_t) {});
  store(target, input, pixels.x, pixels.y, upper);
  store(target, input, pixels.x, pixels.y + kRowStep, lower);
}

}  // namespace

void launch_blend(const FrameInput& input, const uint32_t* values, const FrameMemory& memory,
                  const ImageTarget& target, cudaStream_t stream) {
  const unsigned grid = static_cast<unsigned>(input.columns * input.rows * Block::kParts);
  launch(blend, grid, Block::kThreads, stream, input, values, memory, target);
}

}  // namespace l4d::render
