// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "eval/jod/jod.h"
#include "eval/observer.h"
#include "eval/target/encoding.h"
#include "eval/target/quality_search.h"

namespace l4d::eval {

// What an encode may be asked to reach, in place of a quality.
struct Target {
  enum class Kind { kSize, kBitrate, kFidelity, kPsnrLoss, kMaxError, kJod };
  Kind kind = Kind::kSize;
  double requested = 0;   // bytes, bytes per second, dB, dB, unit of the error, JOD; positive
  std::string attribute;  // of a largest error: one of error_names()
  const JodDisplay* display = nullptr;  // of JOD
  double tolerance = 0;  // dB of fidelity above what is requested that are near enough; 0 = 0.1
  size_t most_trials = 16;

  bool needs_views() const {
    return kind == Kind::kFidelity || kind == Kind::kPsnrLoss || kind == Kind::kJod;
  }
};

// The figure of a target that needs no views, of an encoding of `scene` in memory whose order is
// known.
double measure_target(const Target& target, const Decoding& decoding, Observer& observer,
                      const io::Scene& scene, const Encoding& encoding);

// What a search calls as it goes on.
struct TargetCalls {
  // Before each trial; hears of its encode. Returns what lives until the next trial or the end.
  std::function<Observer&(size_t trial, double quality)> begin;
  // The figure of the trial's encoding: measure_target, a FidelityMeter's, or JOD. The observer is
  // that of the trial.
  std::function<double(const Encoding& encoding, Observer& observer)> measure;
  io::Hold holder;  // counts the streams that are kept, at most two
};

struct TargetResult {
  QualitySearch search;
  double seconds = 0;  // of all but the encode that is kept
};

// Encodes the encoder's scene over and over. *encoding is the one that reaches the target best; the
// encoder's quality is that of the last. Bounds that the encoder itself keeps for each Gaussian are
// set in it, unless it has a tighter one.
TargetResult encode_to_target(const Target& target, const EncoderHandle& encoder,
                              const TargetCalls& calls, Encoding* encoding);

}  // namespace l4d::eval
