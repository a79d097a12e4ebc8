// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "io/file/memory.h"
#include "io/scene/scene.h"

namespace l4d::io {

// How far a Gaussian of the scene may be from that of a frame.
struct SequenceTolerance {
  double position = 0.1;  // of the middle one of its three standard deviations
  double scale = 0.05;    // natural logarithm of a standard deviation
  double rotation = 2;    // degrees, less for Gaussians that are nearly round
  double color = 0.01;    // of 0 to 1, each coefficient of spherical harmonics times its basis
  double opacity = 0.01;  // of 0 to 1
};

// What the Gaussians of one frame have to do with those of the next.
enum class SequenceMatch {
  kAuto,     // kOrder if the numbers of Gaussians and a sample of them say so, else kContent
  kOrder,    // row k is the same Gaussian in all frames
  kContent,  // equal rows, then those that are nearest to each other in place, colour and size
  kNone,     // nothing: each Gaussian lives for its frame
};

struct SequenceOptions {
  std::vector<std::string> paths;  // a file for each frame
  double fps = 30;
  SequenceTolerance tolerance;
  SequenceMatch match = SequenceMatch::kAuto;
  bool activated = false;  // as ImportOptions has it
  int threads = 0;         // 0 = one per core
  Hold holder;
  // Called before each frame; may throw.
  std::function<void(size_t frame, size_t frames)> progress;
};

// What a scene has of a sequence.
struct SequenceReport {
  uint64_t rows = 0;      // Gaussians of all frames together
  uint64_t unseen = 0;    // of these, those fainter than 1/255, which are left out
  uint64_t matched = 0;   // of these, those that go on from the frame before
  uint64_t fading = 0;    // Gaussians of the scene without a window
  uint64_t windows = 0;   // Gaussians of the scene with one
  bool in_order = false;  // all frames were matched by the order of their rows
};

// Reads frames, each a file with a static scene, as one scene that shows frame k at k / fps
// seconds. Gaussians that go on from frame to frame become one that moves in a straight line, as
// long as that keeps the tolerance; it fades as a 4D Gaussian does if its opacities allow that, and
// else has a flat window. Scene::notes has those of the frames' readers. Memory: about 4 frames,
// and the Gaussians of the scene. Throws Error.
Scene read_sequence(const SequenceOptions& options, SequenceReport* report = nullptr);

}  // namespace l4d::io
