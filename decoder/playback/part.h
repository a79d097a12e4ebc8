// SPDX-License-Identifier: Apache-2.0
// A stream that is played, alone or as a member of a playlist: what is known of its file and of
// what it is needed for.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "decoder/playback/blocks.h"
#include "decoder/playback/ledger.h"
#include "decoder/playback/path.h"
#include "decoder/playback/playlist.h"
#include "decoder/playback/stream_map.h"

namespace l4d::playback {

// Makes the decoders of parts.
class Decoders {
 public:
  virtual ~Decoders() = default;
  // accepts_needs: of a stream that is shown with others.
  virtual Decoder& make(bool accepts_needs) = 0;
  virtual void free(Decoder& decoder) = 0;
};

class OwnDecoder {
 public:
  OwnDecoder(Decoders& decoders, bool accepts_needs)
      : decoders_(decoders), decoder_(decoders.make(accepts_needs)) {}
  ~OwnDecoder() { decoders_.free(decoder_); }
  OwnDecoder(const OwnDecoder&) = delete;
  OwnDecoder& operator=(const OwnDecoder&) = delete;
  Decoder& get() { return decoder_; }

 private:
  Decoders& decoders_;
  Decoder& decoder_;
};

struct Part {
  // slot: below 2^24; no other open part has it.
  Part(const Member& member, bool is_member, uint32_t slot_number, Blocks& pool, Decoders& decoders)
      : own_decoder(decoders, is_member),
        decoder(own_decoder.get()),
        entry(member),
        slot(slot_number),
        blocks(pool, slot_number),
        map(decoder, blocks, ledger, member.number) {}
  Part(const Part&) = delete;
  Part& operator=(const Part&) = delete;

  // A file of which nothing is known but its size, UINT64_MAX = not known.
  void begin(uint64_t file_size);
  // In seconds of the stream, within its sequence.
  double time_of(double time) const {
    return std::clamp(time - entry.shift, sequence.begin, sequence.end);
  }
  // The last time of the presentation that is no later in the stream than `time`, and the first one
  // that is no earlier: rounding goes neither way.
  double last_at(double time) const;
  double first_at(double time) const;
  bool is_open() const { return map.is_open(); }
  // It has just been opened.
  void set_open();
  bool is_lost() const { return lost != L4D_CAUSE_NONE; }
  bool is_on_path() const { return !segments.empty(); }
  // The rung of this stream that stands for one of the presentation.
  uint32_t rung_of(uint32_t rung) const { return rung < limit ? rung : limit; }

  OwnDecoder own_decoder;
  Decoder& decoder;
  Member entry;
  Interval sequence{-HUGE_VAL, HUGE_VAL};  // of the stream, once it is open
  uint32_t slot;
  Ledger ledger;
  FileBlocks blocks;
  StreamMap map;

  uint64_t version = 0;       // of the file; 0: not known
  bool no_ranges = false;     // its server answers with the whole file
  bool guesses_size = false;  // from where an answer ended
  uint32_t failures = 0;      // of requests, in a row
  double failed_at = 0;       // the first of them

  // Why nothing of it can be had, and when to try again.
  uint32_t lost = L4D_CAUSE_NONE;
  double retry_at = 0;
  uint32_t losses = 0;  // in a row
  bool told_lost = false;

  // Of the path, in its own time; none: it is not on the path.
  std::vector<Segment> segments;
  std::vector<Interval> cells;  // disjoint, ascending
  uint32_t limit = 0;           // the highest rung that is wanted at all
  uint64_t evicted = 0;         // blocks of the pool, when chunks were last looked at
  uint64_t last_use = 0;
};

}  // namespace l4d::playback
