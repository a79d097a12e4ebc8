// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "cli/camera_arguments.h"
#include "cli/common.h"
#include "cli/verbs/importance.h"
#include "eval/encoding.h"

namespace l4d::cli {

// What a refit is made of, borrowed.
struct RefitInput {
  const io::Scene& scene;
  const eval::CameraViews& views;
  const MeasureArguments& measure;
  double fidelity;  // dB that the coded scene is to have
  uint32_t passes;
  bool all_views;  // whether a Gaussian that no view shows is dropped
};

// What renders of a stream have of a scene's.
struct CheckedStream {
  uint64_t views;
  double fidelity;  // dB
};
// In those of `views` by which a refit would be judged.
CheckedStream check_stream(Context& context, const std::string& name, const io::Scene& scene,
                           const eval::CameraViews& views,
                           const std::vector<unsigned char>& stream);

// A scene whose Gaussians were pruned and whose opacities were fitted, in views of the scene. A
// build without the renderer has one that refuses to be made.
class Refit {
 public:
  // weights: of all Gaussians of the scene.
  Refit(Context& context, const std::string& name, const RefitInput& input,
        const io::Weights& weights);
  ~Refit();
  Refit(const Refit&) = delete;
  Refit& operator=(const Refit&) = delete;

  // [N] as the scene has them.
  const std::vector<float>& opacity() const;
  // Measured again, of all Gaussians: alpha_t is 0 for those that go.
  const io::Weights& weights() const;
  // Encodes the encoder's scene over and over, until its renders have the fidelity. The quality of
  // the encoder is that of the last.
  void encode(const EncoderHandle& encoder, eval::Encoding* encoding);

  double fidelity() const;  // dB aimed at
  double seconds() const;
  // After the encode.
  Json json() const;
  std::string text() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace l4d::cli
