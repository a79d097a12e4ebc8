// SPDX-License-Identifier: Apache-2.0
#include "render/cpu/fast/fast.h"

#include <algorithm>
#include <array>
#include <chrono>

#include "libl4dcodec/base/threads.h"
#include "render/cpu/fast/bins.h"
#include "render/cpu/fast/blend_simd.h"
#include "render/cpu/fast/project_simd.h"
#include "render/frame/importance_numbers.h"

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

// Lists of splats by tile take no more than this at a time, even if more would fit: with
// larger ones a band of the image is made after the other, for a pass over the splats' boxes each.
constexpr uint64_t kBandBytes = uint64_t{256} << 20;

class FastRasterizer : public Rasterizer<float> {
 public:
  FastRasterizer(int threads, bool fast_exponential, MemoryBudget& memory, const int32_t* cancel)
      : cancel_(cancel),
        threads_(threads),
        fast_exponential_(fast_exponential),
        kernels_(render_kernels()),
        memory_(memory) {}

  Status forward(const Frame<float>& frame, const View<float>& view, const float* background,
                 float* rgb, float* alpha, Stats* stats) override {
    L4D_RETURN_IF_ERROR(prepare(frame, view, stats));
    const auto blend = fast_exponential_ ? kernels_.blend_fast_exp : kernels_.blend;
    return for_bands(0, false, stats, [&](const Band& band, bool) -> Status {
      const Watch watch(&stats->seconds[L4D_RENDER_PASS_BLEND]);
      for_tiles(view, band, [&](size_t, const TileInput& tile) {
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
      return {};
    });
  }

  Status backward(const Frame<float>& frame, const View<float>& view, const float* background,
                  const BackwardInput& input, ViewGradients<float>* out, Stats* stats) override {
    const size_t splats = input.geometry ? frame.count() : 0;
    L4D_RETURN_IF_ERROR(renew(memory_, &out->coverage, frame.count(), "gradients"));
    L4D_RETURN_IF_ERROR(renew(memory_, &out->splat, splats, "gradients"));
    std::fill(out->coverage.begin(), out->coverage.end(), 0.0f);
    std::fill(out->splat.begin(), out->splat.end(), SplatGradient2D<float>{});
    L4D_RETURN_IF_ERROR(prepare(frame, view, stats));
    const uint64_t pair_bytes = input.geometry ? sizeof(InstanceGradient) : sizeof(float);
    return for_bands(pair_bytes, true, stats, [&](const Band& band, bool last) {
      const Watch watch(&stats->seconds[L4D_RENDER_PASS_BACKWARD]);
      return input.geometry ? geometry(view, band, last, background, input, out)
                            : coverage(frame, view, band, input.seen, out);
    });
  }

  void forget() override {
    forget_lists();
    bins_.forget(memory_);
    sort_.forget(memory_);
    l4d::forget(memory_, &counts_);
    l4d::forget(memory_, &projected_);
    l4d::forget(memory_, &splats_);
  }

 private:
  // Splats of the view, front to back, and their boxes.
  Status prepare(const Frame<float>& frame, const View<float>& view, Stats* stats) {
    const size_t n = frame.count();
    {
      const Watch watch(&stats->seconds[L4D_RENDER_PASS_PROJECT]);
      const size_t parts = (n + DepthSort::kPart - 1) / DepthSort::kPart;
      L4D_RETURN_IF_ERROR(renew(memory_, &counts_, parts, "splats"));
      // Parts are whole; a small frame does not shrink what a large one needed.
      if (projected_.size() < DepthSort::kPart * parts) {
        L4D_RETURN_IF_ERROR(renew(memory_, &projected_, DepthSort::kPart * parts, "splats"));
      }
      parallel_for(threads_, n, DepthSort::kPart, [&](size_t begin, size_t end) {
        counts_[begin / DepthSort::kPart] =
            kernels_.project(frame, view, begin, end, projected_.data() + begin);
      });
    }
    {
      const Watch watch(&stats->seconds[L4D_RENDER_PASS_SORT]);
      L4D_RETURN_IF_ERROR(sort_.sort(projected_.data(), counts_, threads_, memory_, &splats_));
    }
    const Watch watch(&stats->seconds[L4D_RENDER_PASS_BIN]);
    stats->projected = splats_.size();
    return bins_.start(splats_, view.width, view.height, threads_, memory_);
  }

  // Calls body(band, whether it is the last) with the lists of one band of the image after the
  // other. pair_bytes: what the body keeps for each pair of splat and tile.
  template <typename Body>
  Status for_bands(uint64_t pair_bytes, bool with_places, Stats* stats, const Body& body) {
    std::vector<Band> bands;
    stats->instances = 0;
    uint64_t bytes = 0;
    const auto cut = [&] {
      // Arrays may be an eighth larger than asked for.
      bytes = std::min(kBandBytes, memory_.capacity() / 9 * 8);
      return bins_.cut(bytes, pair_bytes, with_places, memory_, &bands);
    };
    {
      const Watch watch(&stats->seconds[L4D_RENDER_PASS_BIN]);
      // Where the view does not fit beside what other calls left, that gives way.
      if (!cut().ok() || bands.size() > 1) {
        forget_lists();
        L4D_RETURN_IF_ERROR(cut());
      }
    }
    for (size_t k = 0; k < bands.size(); ++k) {
      {
        const Watch watch(&stats->seconds[L4D_RENDER_PASS_BIN]);
        if (k > 0 && memory_.capacity() < bytes) forget_lists();
        L4D_RETURN_IF_ERROR(bins_.build(splats_, bands[k], with_places, threads_, memory_));
      }
      stats->instances += bins_.instances();
      L4D_RETURN_IF_ERROR(body(bands[k], k + 1 == bands.size()));
      if (cancelled()) return Status(L4D_ERR_CANCELLED, "cancelled");
    }
    // Other calls need room too.
    if (memory_.capacity() < memory_.used()) forget_lists();
    return {};
  }

  // What is kept for each pair of splat and tile.
  void forget_lists() {
    bins_.forget_lists(memory_);
    l4d::forget(memory_, &instance_coverage_);
    l4d::forget(memory_, &instances_);
  }

  template <typename Body>
  void for_tiles(const View<float>& view, const Band& band, const Body& body) const {
    const size_t columns = static_cast<size_t>(band.columns());
    parallel_for(threads_, band.tiles(), 4, [&](size_t begin, size_t end) {
      for (size_t t = begin; t < end && !cancelled(); ++t) {
        TileInput tile;
        tile.splats = splats_.data();
        tile.list = bins_.list(t);
        tile.count = bins_.count(t);
        tile.x = (band.column_begin + static_cast<int>(t % columns)) * kTile;
        tile.y = (band.row_begin + static_cast<int>(t / columns)) * kTile;
        tile.width = std::min(kTile, view.width - tile.x);
        tile.height = std::min(kTile, view.height - tile.y);
        tile.max_alpha = view.rules.max_alpha;
        body(t, tile);
      }
    });
  }

  Status coverage(const Frame<float>& frame, const View<float>& view, const Band& band,
                  const uint8_t* seen, ViewGradients<float>* out) {
    const auto wanted = [&](size_t i) {
      return seen == nullptr || seen[frame.id[splats_[i].row]] == 0;
    };
    L4D_RETURN_IF_ERROR(renew(memory_, &instance_coverage_, bins_.instances(), "coverage by tile"));
    for_tiles(view, band, [&](size_t t, const TileInput& tile) {
      // Most tiles show nothing new once a few views have been seen.
      bool any = false;
      for (size_t n = 0; n < tile.count && !any; ++n) any = wanted(tile.list[n]);
      if (any) kernels_.coverage(tile, instance_coverage_.data() + bins_.first(t));
    });
    parallel_for(threads_, splats_.size(), DepthSort::kPart, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        if (!wanted(i)) continue;
        // Bands follow each other as the tiles of one band do: the sums are those of one.
        float sum = out->coverage[splats_[i].row];
        for (size_t e = bins_.emitted(i); e < bins_.emitted(i + 1); ++e) {
          sum += instance_coverage_[bins_.place(e)];
        }
        out->coverage[splats_[i].row] = sum;
      }
    });
    return {};
  }

  Status geometry(const View<float>& view, const Band& band, bool last, const float* background,
                  const BackwardInput& input, ViewGradients<float>* out) {
    L4D_RETURN_IF_ERROR(renew(memory_, &instances_, bins_.instances(), "gradients by tile"));
    for_tiles(view, band, [&](size_t t, const TileInput& tile) {
      TileUpstream upstream;
      const float* given = input.rgb_gradient;
      upstream.one_channel = given == nullptr && input.signs == nullptr;
      const size_t channels = upstream.one_channel ? 1 : 3;
      for (size_t c = 0; c < channels; ++c) std::fill_n(upstream.gradient[c], kTilePixels, 0.0f);
      for (int y = 0; y < tile.height; ++y) {
        for (int x = 0; x < tile.width; ++x) {
          const size_t pixel = static_cast<size_t>(tile.y + y) * static_cast<size_t>(view.width) +
                               static_cast<size_t>(tile.x + x);
          const int at = y * kTile + x;
          const uint64_t bits = input.signs != nullptr ? mix(*input.signs + pixel) : 0;
          for (size_t c = 0; c < channels; ++c) {
            upstream.gradient[c][at] = upstream.one_channel ? 1.0f
                                       : given != nullptr   ? given[3 * pixel + c]
                                                            : sign_of(bits, static_cast<int>(c));
          }
        }
      }
      kernels_.backward(tile, upstream, background, instances_.data() + bins_.first(t));
    });
    parallel_for(threads_, splats_.size(), DepthSort::kPart, [&](size_t begin, size_t end) {
      for (size_t i = begin; i < end; ++i) {
        const FastSplat& s = splats_[i];
        SplatGradient2D<float>& g = out->splat[s.row];
        // By the natural logarithm of the opacity, until the last band.
        float log_opacity = g.opacity, covered = out->coverage[s.row];
        for (size_t e = bins_.emitted(i); e < bins_.emitted(i + 1); ++e) {
          const InstanceGradient& part = instances_[bins_.place(e)];
          for (size_t k = 0; k < 2; ++k) g.mean[k] += part.mean[k];
          for (size_t k = 0; k < 3; ++k) g.conic[k] += part.conic[k];
          for (size_t k = 0; k < 3; ++k) g.color[k] += part.color[k];
          log_opacity += part.log_opacity;
          covered += part.coverage;
        }
        g.opacity = log_opacity;
        out->coverage[s.row] = covered;
        if (!last) continue;
        // From the factors of log2(alpha) to the conic itself; the natural logarithm is already in.
        constexpr float kHalfLog2E = 0.72134752f;
        g.conic[0] *= -kHalfLog2E;
        g.conic[1] *= -2 * kHalfLog2E;
        g.conic[2] *= -kHalfLog2E;
        g.opacity = log_opacity / s.opacity;
      }
    });
    return {};
  }

  bool cancelled() const {
    return cancel_ != nullptr && *static_cast<const volatile int32_t*>(cancel_) != 0;
  }

  const int32_t* cancel_;
  int threads_;
  bool fast_exponential_;
  const RenderKernels& kernels_;
  MemoryBudget& memory_;
  // Kept between calls: the memory of a frame is that of the next one.
  std::vector<FastSplat> projected_;  // in parts of DepthSort::kPart
  std::vector<size_t> counts_;        // of each part
  DepthSort sort_;
  std::vector<FastSplat> splats_;
  TileBins bins_;
  std::vector<float> instance_coverage_;
  std::vector<InstanceGradient> instances_;
};

}  // namespace

std::unique_ptr<Rasterizer<float>> make_fast_rasterizer(int threads, bool fast_exponential,
                                                        MemoryBudget& memory,
                                                        const int32_t* cancel) {
  return std::make_unique<FastRasterizer>(threads, fast_exponential, memory, cancel);
}

}  // namespace l4d::render
