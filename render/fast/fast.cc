// SPDX-License-Identifier: Apache-2.0
#include "render/fast/fast.h"

#include <algorithm>
#include <array>
#include <chrono>

#include "libl4dcodec/base/threads.h"
#include "render/fast/bins.h"
#include "render/fast/blend_simd.h"
#include "render/fast/project_simd.h"

namespace l4d::render {

const RenderKernels& render_kernels() {
  static const RenderKernels kernels = [] {
    const BlendKernels blend = blend_kernels();
    return RenderKernels{project_kernel(), blend.blend, blend.blend_fast_exp, blend.coverage,
                         blend.backward};
  }();
  return kernels;
}

namespace {

constexpr size_t kGrain = DepthSort::kPart;

class Watch {
 public:
  explicit Watch(double* seconds) : seconds_(seconds), begin_(Clock::now()) {}
  ~Watch() { *seconds_ += std::chrono::duration<double>(Clock::now() - begin_).count(); }
  Watch(const Watch&) = delete;
  Watch& operator=(const Watch&) = delete;

 private:
  using Clock = std::chrono::steady_clock;
  double* seconds_;
  Clock::time_point begin_;
};

class FastRasterizer : public Rasterizer<float> {
 public:
  FastRasterizer(int threads, bool fast_exponential)
      : threads_(threads), fast_exponential_(fast_exponential), kernels_(render_kernels()) {}

  void forward(const Frame<float>& frame, const View<float>& view, const float* background,
               float* rgb, float* alpha, Stats* stats) override {
    prepare(frame, view, false, stats);
    const Watch watch(&stats->seconds[L4D_RENDER_STAGE_BLEND]);
    const auto blend = fast_exponential_ ? kernels_.blend_fast_exp : kernels_.blend;
    for_tiles(view, [&](size_t, const TileInput& tile) {
      TileImage image;
      blend(tile, &image);
      const size_t width = static_cast<size_t>(view.width);
      for (int y = 0; y < tile.height; ++y) {
        const size_t from = static_cast<size_t>(y * kTile);
        const size_t to = static_cast<size_t>(tile.y + y) * width + static_cast<size_t>(tile.x);
        for (size_t x = 0; x < static_cast<size_t>(tile.width); ++x) {
          const float t = image.transmittance[from + x];
          if (rgb != nullptr) {
            for (size_t c = 0; c < 3; ++c) {
              rgb[3 * (to + x) + c] = image.rgb[c][from + x] + t * background[c];
            }
          }
          if (alpha != nullptr) alpha[to + x] = 1.0f - t;
        }
      }
    });
  }

  void backward(const Frame<float>& frame, const View<float>& view, const float* background,
                const BackwardInput& input, ViewGradients<float>* out, Stats* stats) override {
    prepare(frame, view, true, stats);
    const Watch watch(&stats->seconds[L4D_RENDER_STAGE_BACKWARD]);
    out->coverage.assign(frame.count(), 0.0f);
    out->splat.assign(input.geometry ? frame.count() : 0, {});
    if (input.geometry) {
      geometry(view, background, input, out);
    } else {
      coverage(frame, view, input.seen, out);
    }
  }

 private:
  void prepare(const Frame<float>& frame, const View<float>& view, bool with_places, Stats* stats) {
    const size_t n = frame.count();
    {
      const Watch watch(&stats->seconds[L4D_RENDER_STAGE_PROJECT]);
      counts_.resize((n + kGrain - 1) / kGrain);
      if (projected_.size() < kGrain * counts_.size()) projected_.resize(kGrain * counts_.size());
      parallel_for(threads_, n, kGrain, [&](size_t begin, size_t end) {
        counts_[begin / kGrain] =
            kernels_.project(frame, view, begin, end, projected_.data() + begin);
      });
    }
    {
      const Watch watch(&stats->seconds[L4D_RENDER_STAGE_SORT]);
      sort_.sort(projected_.data(), counts_, threads_, &splats_);
    }
    {
      const Watch watch(&stats->seconds[L4D_RENDER_STAGE_BIN]);
      bins_.build(splats_, view.width, view.height, with_places, threads_);
    }
    stats->projected = splats_.size();
    stats->instances = bins_.instances();
  }

  template <typename Body>
  void for_tiles(const View<float>& view, const Body& body) const {
    const size_t columns = static_cast<size_t>(bins_.columns());
    const size_t tiles = columns * static_cast<size_t>(bins_.rows());
    parallel_for(threads_, tiles, 4, [&](size_t begin, size_t end) {
      for (size_t t = begin; t < end; ++t) {
        TileInput tile;
        tile.splats = splats_.data();
        tile.list = bins_.list(t);
        tile.count = bins_.count(t);
        tile.x = static_cast<int>(t % columns) * kTile;
        tile.y = static_cast<int>(t / columns) * kTile;
        tile.width = std::min(kTile, view.width - tile.x);
        tile.height = std::min(kTile, view.height - tile.y);
        body(t, tile);
      }
    });
  }

  void coverage(const Frame<float>& frame, const View<float>& view, const uint8_t* seen,
                ViewGradients<float>* out) {
    const auto wanted = [&](size_t i) {
      return seen == nullptr || seen[frame.id[splats_[i].row]] == 0;
    };
    instance_coverage_.resize(bins_.instances());
    for_tiles(view, [&](size_t t, const TileInput& tile) {
      // Most tiles show nothing new once a few views have been seen.
      bool any = false;
      for (size_t n = 0; n < tile.count && !any; ++n) any = wanted(tile.list[n]);
      if (any) kernels_.coverage(tile, instance_coverage_.data() + bins_.first(t));
    });
    parallel_for(threads_, splats_.size(), kGrain, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        if (!wanted(i)) continue;
        float sum = 0;
        for (size_t e = bins_.emitted(i); e < bins_.emitted(i + 1); ++e) {
          sum += instance_coverage_[bins_.place(e)];
        }
        out->coverage[splats_[i].row] = sum;
      }
    });
  }

  void geometry(const View<float>& view, const float* background, const BackwardInput& input,
                ViewGradients<float>* out) {
    instances_.resize(bins_.instances());
    for_tiles(view, [&](size_t t, const TileInput& tile) {
      TileUpstream upstream;
      upstream.one_channel = input.rgb_gradient == nullptr;
      const size_t channels = upstream.one_channel ? 1 : 3;
      for (size_t c = 0; c < channels; ++c) std::fill_n(upstream.gradient[c], kTilePixels, 0.0f);
      for (int y = 0; y < tile.height; ++y) {
        for (int x = 0; x < tile.width; ++x) {
          const size_t pixel = static_cast<size_t>(tile.y + y) * static_cast<size_t>(view.width) +
                               static_cast<size_t>(tile.x + x);
          const int at = y * kTile + x;
          for (size_t c = 0; c < channels; ++c) {
            upstream.gradient[c][at] =
                upstream.one_channel ? 1.0f : input.rgb_gradient[3 * pixel + c];
          }
        }
      }
      kernels_.backward(tile, upstream, background, instances_.data() + bins_.first(t));
    });
    parallel_for(threads_, splats_.size(), kGrain, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        const FastSplat& s = splats_[i];
        SplatGradient2D<float>& g = out->splat[s.row];
        float log_opacity = 0, covered = 0;
        for (size_t e = bins_.emitted(i); e < bins_.emitted(i + 1); ++e) {
          const InstanceGradient& part = instances_[bins_.place(e)];
          for (size_t k = 0; k < 2; ++k) g.mean[k] += part.mean[k];
          for (size_t k = 0; k < 3; ++k) g.conic[k] += part.conic[k];
          for (size_t k = 0; k < 3; ++k) g.color[k] += part.color[k];
          log_opacity += part.log_opacity;
          covered += part.coverage;
        }
        // From the factors of log2(alpha) to the conic itself; the natural logarithm is already in.
        constexpr float kHalfLog2E = 0.72134752f;
        g.conic[0] *= -kHalfLog2E;
        g.conic[1] *= -2 * kHalfLog2E;
        g.conic[2] *= -kHalfLog2E;
        g.opacity = log_opacity / s.opacity;
        out->coverage[s.row] = covered;
      }
    });
  }

  int threads_;
  bool fast_exponential_;
  const RenderKernels& kernels_;
  // Kept between calls: the memory of a frame is that of the next one.
  std::vector<FastSplat> projected_;  // in parts of kGrain
  std::vector<size_t> counts_;        // of each part
  DepthSort sort_;
  std::vector<FastSplat> splats_;
  TileBins bins_;
  std::vector<float> instance_coverage_;
  std::vector<InstanceGradient> instances_;
};

}  // namespace

std::unique_ptr<Rasterizer<float>> make_fast_rasterizer(int threads, bool fast_exponential) {
  return std::make_unique<FastRasterizer>(threads, fast_exponential);
}

}  // namespace l4d::render
