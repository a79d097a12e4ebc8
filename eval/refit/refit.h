// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "eval/image/fidelity_meter.h"
#include "eval/refit/pruning.h"
#include "eval/target/encoding.h"
#include "eval/target/quality_search.h"

namespace l4d::eval {

// For an effort of the encoder, and a back end, L4D_BACKEND_*.
struct RefitDefaults {
  uint32_t passes;   // that pay
  size_t fit_views;  // that are worth their time
  // To measure before, whether they agree or not, since what is pruned by them is gone; and again
  // of what stays. 0: until they agree.
  size_t views_before, views_after;
};
RefitDefaults refit_defaults(uint32_t backend, double effort = 7);
// Whether the encoder drops what costs more than it shows, by a quality.
bool can_refit(const EncoderHandle& encoder);

// What a refit is made of, borrowed.
struct RefitInput {
  const io::Scene& scene;      // of the encoder
  const io::Weights& weights;  // of all its Gaussians, measured from the views
  const CameraViews& views;
  Rendering rendering;  // of two scenes at a time
  // dB that the coded scene is to have; 0: what weights alone reach, and what a fit gains at as
  // many bytes.
  double fidelity = 0;
  uint32_t passes = 1;
  size_t fit_views = 1;  // about
  uint64_t max_render_bytes = FittingViews::kRenderBytes;
  bool drop_unseen = false;  // whether a Gaussian that no view shows is dropped
  bool always = false;       // also where weights alone are as good
  // Where a fit would take long: only if weights alone miss the fidelity.
  bool only_if_missed = false;
  // Of the encoder. Bounds of colours follow a quality below that of the preset; those of a refit
  // follow the fidelity, unless they are among the parameters that were set.
  std::string preset = {};
  std::function<bool(const char* parameter)> is_set = [](const char*) { return false; };
};

// What a refit calls as it goes on.
struct RefitCalls {
  // Before each step; hears of it. Returns what lives until the next one. label: "" but for trials.
  std::function<Observer&(const std::string& label)> begin;
  // Encodes with the weights alone.
  std::function<Encoding()> encode_plain;
  // The weights of the part of the scene that stays.
  std::function<io::Weights(const io::Scene& part)> measure;
  // Gives the encoder weights [N], of which alpha_t is 0 for those that go. They live as long as
  // the result.
  std::function<void(const io::Weights& weights)> set_weights;
  // Encodes what was fitted, or returns nothing where that is no good. Without it: until renders
  // have the fidelity aimed at.
  std::function<std::optional<Encoding>()> encode_fitted;
  io::Hold holder;  // counts the streams that are kept, at most two
};

// A stream, and what renders of it have of the scene's in views that no fit used.
struct CheckedStream {
  uint64_t bytes = 0;
  CheckedFidelity fidelity;

  double worst() const { return std::min(fidelity.worst_camera, fidelity.worst_instant); }
};

struct Refit {
  Encoding encoding;                           // the better one
  bool is_kept = false;                        // that is what was fitted
  bool is_left_out = false;                    // nothing was, since it would take long
  std::optional<CheckedStream> plain, fitted;  // by weights alone; by the fit
  size_t fit_views = 0, check_views = 0;
  double fidelity = 0;   // that was aimed at, dB
  PrunedScene pruned;    // without its part
  io::Weights weights;   // of what was fitted
  QualitySearch search;  // empty with encode_fitted
  double seconds = 0;    // but for what the caller encodes, and the encode that is kept

  const CheckedStream& checked() const { return is_kept ? *fitted : *plain; }
  bool is_pruned() const { return pruned.result < pruned.trials.size(); }
  // Whether the encoding has less than was aimed at: weights alone may miss it by a little.
  static constexpr double kMissed = 0.5;  // dB
  bool is_missed() const { return checked().fidelity.psnr < fidelity - (is_kept ? 0 : kMissed); }
};

// Prunes the scene of an encoder and fits the opacities of what stays, in views of the scene, and
// encodes it so that its renders have the fidelity that is aimed at. The encoder is left with what
// was fitted, which it borrows from the result, whether that is kept or not.
Refit refit(const RefitInput& input, const EncoderHandle& encoder, const RefitCalls& calls);

}  // namespace l4d::eval
