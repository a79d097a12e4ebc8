// SPDX-License-Identifier: Apache-2.0
// Fidelity: how far renders of a decoded scene are from renders of the original.
#pragma once

#include <functional>
#include <vector>

#include "bench/accuracy/scene.h"
#include "io/image.h"
#include "io/metrics.h"
#include "l4d/render.hpp"

namespace l4d::bench {

// Figures of equal images, which have no finite one.
constexpr double kMaxDecibels = 100;

// Renders of the original from all cameras at some frames, made once and kept in memory. What is
// judged is set in the renderer by the caller.
class Judge {
 public:
  Judge(const BenchScene& scene, std::vector<uint32_t> frames);

  // index: into the views, frame by frame and there camera by camera.
  using Visit =
      std::function<void(size_t index, const io::Image& original, const io::Image& judged)>;

  io::Fidelity of_file(const std::vector<unsigned char>& file, bool with_ssim = false) const;
  io::Fidelity of_scene(const io::Scene& scene, bool with_ssim = false) const;
  void visit_file(const std::vector<unsigned char>& file, const Visit& visit) const;

  size_t num_views() const { return originals_.size(); }
  const io::Image& original(size_t index) const { return originals_[index]; }
  uint32_t frame(size_t index) const { return frames_[index / scene_.cameras.size()]; }
  size_t camera(size_t index) const { return index % scene_.cameras.size(); }

 private:
  void visit(RendererHandle& renderer, const Visit& visit) const;
  io::Fidelity judge(RendererHandle& renderer, bool with_ssim) const;

  const BenchScene& scene_;
  std::vector<uint32_t> frames_;
  std::vector<io::Image> originals_;
};

}  // namespace l4d::bench
