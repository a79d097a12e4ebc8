// SPDX-License-Identifier: Apache-2.0
// A scene, or pieces of one as they arrive, as the members of a file (spec: section 20.2): media
// members of some seconds, which hold what is visible in their span, and standing members of what
// lives longer.
#pragma once

#include <cmath>
#include <cstdint>
#include <deque>
#include <vector>

#include "decoder/copy/copy_stream.h"
#include "encoder/encoder.h"
#include "encoder/session/session_pool.h"

namespace l4d {

struct SessionOptions {
  double segment = 2;              // seconds of a media member
  unsigned standing_segments = 3;  // what is visible in so many of them goes to a standing member
  double end = HUGE_VAL;           // of the presentation, where that is known
  uint64_t stream = 0;             // as Member has it; 0 = made from the first piece
  uint64_t max_memory_bytes = UINT64_MAX;  // of the pool
};

class Session {
 public:
  explicit Session(const SessionOptions& options) : options_(options) {}

  // The scene of the encoder is the next piece: what it shows from its begin to its end, with what
  // lives on of the pieces before. All members of those have been coded.
  Status add(const Encoder& encoder);
  // A piece in which nothing becomes known.
  Status add_empty(const Encoder& encoder, const l4d_timeline& timeline,
                   const l4d_placement& placement);
  // Codes the next member of the piece. `out->bytes` is 0 if there is none left.
  Status next(const Encoder& encoder, const WriteFn& write, ListedMember* out);

 private:
  // A member that is not coded yet.
  struct Planned {
    Member about;
    l4d_timeline timeline{};
    double price_seconds = 0;  // that its importances are averages over
    double density = 0;        // Gaussians coded for each second that it shows, with what it needs
    double shared_count = 0;   // as EncoderInput has it
    std::vector<uint32_t> rows;  // of the pool
  };
  // One that media members need.
  struct Standing {
    uint32_t number = 0;
    double end = 0;
    size_t count = 0;    // Gaussians
    double density = 0;  // of them, for each second of price_seconds
  };
  // The segments of a piece: begins[k] to begins[k + 1].
  struct Grid {
    l4d_timeline piece{};
    uint32_t frames = 0;  // of a segment
    std::vector<double> begins;
    std::vector<uint32_t> num_frames;

    uint32_t count() const { return static_cast<uint32_t>(begins.size()) - 1; }
    l4d_timeline timeline(uint32_t segment) const;
    // As if segments followed behind the last one.
    uint32_t segment_of(double time) const;
  };

  Status check_piece(const EncoderInput& input) const;
  // Whether the Gaussians that live on at `now` and so many more fit.
  Status check_memory(const EncoderInput& input, double now, size_t more) const;
  void plan(const Grid& grid);
  Grid make_grid(const l4d_timeline& piece) const;
  // Members have fewer frames: half as many again as a segment, and no more than round to the
  // seconds that a segment rounds to, or to one, as playlists promise them.
  uint32_t longest_segment(const l4d_timeline& piece, uint32_t frames) const;
  void drop_past(double now);
  void retire_standing();
  // Gaussians of the others belong to none then.
  template <typename Keep>  // bool(const Standing&, size_t index)
  void keep_standing(const Keep& keep);
  Sequence shown(const PooledGaussian& row, const Grid& grid) const;
  std::vector<uint32_t> long_lived(const Grid& grid) const;
  void plan_standing(const Grid& grid);
  void plan_media(const Grid& grid);
  void plan_prices();
  Member about(MemberRole role);
  SceneHeader empty_header(const Encoder& encoder, const Planned& planned) const;
  Status code(const Encoder& encoder, const Planned& planned, Bytes* out) const;

  SessionOptions options_;
  SessionPool pool_;
  std::vector<Standing> standing_;  // PooledGaussian::standing counts in it
  std::deque<Planned> planned_;
  EncoderInput piece_;      // the last one, without its Gaussians
  double end_ = -HUGE_VAL;  // of the pieces so far
  double density_ = 0;      // of the first piece
  uint32_t number_ = 0;     // of the next member
  uint64_t bytes_ = 0;      // of the members so far
};

}  // namespace l4d
