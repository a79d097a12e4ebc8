// SPDX-License-Identifier: Apache-2.0
// Fidelity: how far renders of a decoded scene are from renders of the original.
#pragma once

#include <vector>

#include "bench/accuracy/scene.h"
#include "eval/image/fidelity_meter.h"
#include "eval/image/image_comparison.h"

namespace l4d::bench {

using eval::kMaxDecibels;

// A meter whose views are all cameras of a scene at some frames.
class Judge {
 public:
  Judge(const BenchScene& scene, const std::vector<uint32_t>& frames);

  io::Fidelity of_file(const std::vector<unsigned char>& file, bool with_ssim = false) const;
  io::Fidelity of_scene(const io::Scene& scene, bool with_ssim = false) const;
  void visit_file(const std::vector<unsigned char>& file,
                  const eval::FidelityMeter::Visit& visit) const;

  // Frame by frame and there camera by camera.
  size_t num_views() const { return meter_.num_views(); }
  const io::Image& original(size_t index) const { return meter_.original(index); }
  uint32_t frame(size_t index) const { return meter_.views().views[index].frame; }
  size_t camera(size_t index) const { return meter_.views().views[index].camera; }

 private:
  io::Fidelity fidelity(eval::RenderedScene& coded, bool with_ssim) const;

  mutable eval::Observer quiet_;
  mutable eval::RenderedScene original_;
  mutable eval::FidelityMeter meter_;
};

}  // namespace l4d::bench
