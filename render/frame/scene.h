// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "l4d/experimental/columns.h"
#include "l4d/members.h"
#include "libl4dcodec/base/memory.h"
#include "libl4dcodec/base/status.h"
#include "libl4dcodec/scene/prepare.h"
#include "render/frame/frame.h"

namespace l4d::render {

// A scene of 4D Gaussians, with what does not change from instant to instant worked out once. The
// arrays of `gaussians` are borrowed.
class Scene {
 public:
  // Checks the scene and holds it, for callers that prepare it themselves: nothing can be sliced
  // here.
  Status set(const l4d_gaussians& gaussians, const l4d_timeline& timeline);
  // The same, and all that slices need, which is charged to `memory`: one for the object's life.
  Status prepare(const l4d_gaussians& gaussians, const l4d_timeline& timeline, int threads,
                 MemoryBudget& memory);

  void forget(MemoryBudget& memory);  // what was prepared

  size_t count() const { return static_cast<size_t>(gaussians_.count); }
  const l4d_gaussians& gaussians() const { return gaussians_; }
  const l4d_timeline& timeline() const { return timeline_; }
  double time_end() const { return sequence_.end; }

  // The Gaussians visible at `time`, which lies in the sequence. Both forms hold the same Gaussians
  // in the same order; the second works everything out in double from the attributes as given.
  Status slice(double time, int threads, MemoryBudget& memory, Frame<float>* out);
  Status slice(double time, MemoryBudget& memory, Frame<double>* out) const;

 private:
  bool visible(size_t row, float t, uint32_t frame) const {
    return shown_[row].holds(t) && (window_.empty() || window_[row].shows(frame));
  }

  l4d_gaussians gaussians_{};
  l4d_timeline timeline_{};
  Sequence sequence_{};
  double center_ = 0;  // times below are seconds from here, so that binary32 holds them
  // Rows are in three groups, each in the order of the scene: still ones, which look the same at
  // all times; ones that only fade; ones that move.
  size_t num_still_ = 0;
  size_t num_unmoving_ = 0;                    // still and fading ones
  std::vector<uint32_t> id_;                   // [rows] index in the scene
  std::vector<float> position_[3];             // [rows] at time reference_
  std::vector<float> velocity_[3];             // [rows - num_unmoving_]
  std::vector<float> reference_;               // [rows - num_unmoving_]
  std::vector<float> covariance_[6];           // [rows]
  std::vector<float> opacity_;                 // [rows]
  std::vector<float> mean_;                    // [rows]
  std::vector<float> lambda_;                  // [rows]
  std::vector<VisibleInterval> shown_;         // [rows]
  std::vector<FrameWindow> window_;            // [rows]; empty where no Gaussian has one
  const Frame<float>* still_frame_ = nullptr;  // its beginning holds the still rows
};

// What streams show together; the ids of Gaussians are their places in the frame. In and out:
// still_key says which still Gaussians lie at the beginning of the frame (l4d_splat_columns); 0
// where the frame is another, or holds other ids. SH rows belong to the decoders until their next
// calls.
Status slice_streams(const std::vector<l4d_shown_stream>& streams, const l4d_operating_point& point,
                     MemoryBudget& memory, uint64_t* still_key, Frame<float>* out);

// Widens a frame. Only what is in `from` is known, so this is as exact as that.
Status widen(const Frame<float>& from, MemoryBudget& memory, Frame<double>* out);

}  // namespace l4d::render
