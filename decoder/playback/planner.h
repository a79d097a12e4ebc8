// SPDX-License-Identifier: Apache-2.0
// What of the streams on a path is wanted next, and how far they can be shown: from their maps, the
// path and what is held. Plans of a path are in cells of half a second.
#pragma once

#include <cstdint>
#include <vector>

#include "decoder/playback/part.h"
#include "decoder/playback/path.h"
#include "decoder/playback/rate_control.h"

namespace l4d::playback {

// How urgent a chunk is, most urgent first.
enum class Urgency : uint32_t {
  kTables = 0,     // and headers
  kDirectory = 1,  // of the path
  kInstant = 2,    // the lowest rung of the instant
  kStart = 3,      // and of what playback begins with
  kPath = 4,       // the rung that is chosen, along the path
  kFill = 5,       // the next one
  kIdle = 6,       // the rest of the directory
  kNone = 7
};

// What of the presentation is played; a change needs another order.
struct PlanSettings {
  Position position;
  double rate = 1;   // seconds of the presentation a second, above or equal 0
  double ahead = 6;  // seconds
  double start_ahead = 0.5;
  uint32_t levels = 0;                                // as in l4d_operating_point
  uint32_t floor = 0, target = 0, fill = 0, top = 0;  // rungs
  uint32_t network = L4D_NETWORK_ALL;
  bool instant_only = false;
  bool tolerant = true;
  uint64_t pool_bytes = 0;  // that a path may take

  // Whether both put chunks into the same order, if their time does. What else changes an order
  // belongs here.
  bool same_order(const PlanSettings& other) const {
    return floor == other.floor && target == other.target && fill == other.fill &&
           rate == other.rate && top == other.top && network == other.network &&
           instant_only == other.instant_only && pool_bytes == other.pool_bytes &&
           position.direction == other.position.direction;
  }
  // Seconds of the presentation.
  double path_length() const {
    return instant_only || network != L4D_NETWORK_ALL ? 0 : ahead * rate;
  }
};

struct WantedRange {
  uint64_t begin = 0, end = 0;
  Urgency urgency = Urgency::kNone;
  uint32_t rung = 0;
  bool fresh = false;
  uint32_t step = 0;   // of the path
  uint64_t chunk = 0;  // fresh: where the chunk begins
  Part* part = nullptr;
};

struct RangeShape {
  uint64_t merge_gap = 0, max_bytes = 0;
};

// Bytes that are under way, which nobody has to ask for.
struct UnderWay {
  uint64_t begin = 0, end = 0;
  bool fresh = false;  // replaces what is here
  const Part* part = nullptr;
};

// What can be shown around an instant, if `ready`; else both ends are the instant.
struct ReadyInterval {
  bool ready = false;
  double from = 0, until = 0;
};

class Planner {
 public:
  static constexpr double kCellSeconds = 0.5;
  static constexpr uint32_t kMostSteps = 0xffffff;

  explicit Planner(Blocks& blocks) : blocks_(blocks) {}

  // Follows the path, which has given `parts` their segments. Names chunks anew where the cells of
  // a part are others, or its map can name more. *changed: whether it did.
  Status follow(const std::vector<Part*>& parts, const PlanSettings& settings, uint32_t num_rungs,
                double now, bool* changed, std::vector<ChunkEvent>* events);
  // Other rungs for what it follows: refresh() needs to sort then.
  void set_rungs(const PlanSettings& settings) { settings_ = settings; }
  // Before parts go.
  void forget_parts();
  // Before the map of a part is another one.
  void forget_order() { order_.clear(); }
  // After bytes, losses or loads: what lacks and what can be shown. Needs follow() before.
  // update(part, &item) sets Item::hidden and Item::loaded. sorts: chunks get an order, too, which
  // is needed after follow() has changed something, and where Item::loaded or the settings differ.
  template <typename Update>
  void refresh(const Update& update, bool sorts) {
    for (Part* part : parts_) {
      forget_evicted(part);
      part->map.refresh(settings_.tolerant);
      for (Item& item : part->map.items()) update(*part, &item);
    }
    if (sorts) sort();
    find_states();
  }
  // After follow() alone, where it has changed nothing.
  void find_states();

  // How many seconds of the path lack nothing of a rung; infinity: all of it.
  double ready_distance(uint32_t rung) const { return ready_[rung]; }
  // Bytes of the path that lack, and those of them that are to be requested.
  uint64_t missing_bytes(uint32_t rung) const { return missing_[rung]; }
  uint64_t wanted_bytes(uint32_t rung) const { return wanted_[rung]; }
  uint32_t num_rungs() const { return static_cast<uint32_t>(ready_.size()); }
  // Of a part that is on the path, in its own time.
  ReadyInterval ready_interval(const Part& part, uint32_t rung, double time) const;
  // The parts of its cells in which a rung can be shown.
  void find_buffered(const Part& part, uint32_t rung, std::vector<Interval>* out) const;
  // Why a chunk that a part needs at an instant is lost; NONE where none is.
  uint32_t cause_at(const Part& part, uint32_t rung, double time) const;
  // The pool does not hold what the path needs, or not even what the instant needs.
  bool is_cut() const { return is_cut_; }
  bool overflows() const { return overflows_; }

  // The range that is the most urgent one to request; none: Urgency::kNone. *next: when a chunk
  // that waits may be requested, infinity where none waits.
  WantedRange find_wanted(const std::vector<UnderWay>& under_way, const RangeShape& shape,
                          double now, double* next) const;
  // Whether some byte of a range is wanted, in urgencies up to one.
  bool is_wanted(const Part& part, uint64_t begin, uint64_t end, Urgency least) const;
  // Marks all chunks of the order as used.
  void use_blocks();
  // On the path, in its order.
  const std::vector<Part*>& parts() const { return parts_; }

 private:
  struct Wanted {
    uint64_t order;
    uint32_t part, chunk;  // in parts_, and in its map
  };
  static Urgency urgency_in(uint64_t order) { return static_cast<Urgency>(order >> 56); }
  Chunk& chunk_of(const Wanted& w) const { return parts_[w.part]->map.chunks()[w.chunk]; }
  void find_cells(const Part& part);
  void sort();
  void set_orders(Part* part);
  void cut_to_pool();
  void forget_evicted(Part* part);
  Urgency urgency_of(const Part& part, const Item& item, uint32_t rung) const;
  Urgency urgency_ahead(double distance) const;
  bool may_request(Urgency urgency) const;
  // Cuts [*begin, *end) to its first part that is not in [from, until).
  static void clip(uint64_t from, uint64_t until, uint64_t* begin, uint64_t* end);
  bool may_bridge(const WantedRange& range, uint64_t begin,
                  const std::vector<UnderWay>& under_way) const;
  // Adds what of a chunk is neither here nor under way to *out. Returns whether it may get more.
  bool add_pieces(Part* part, const Chunk& chunk, const std::vector<UnderWay>& under_way,
                  const RangeShape& shape, WantedRange* out) const;

  Blocks& blocks_;
  PlanSettings settings_;
  std::vector<Part*> parts_;
  std::vector<Interval> new_cells_;
  std::vector<Wanted> order_;               // chunks that are wanted or in use
  std::vector<double> ready_;               // by rung
  std::vector<uint64_t> missing_, wanted_;  // by rung
  bool is_cut_ = false, overflows_ = false;
};

}  // namespace l4d::playback
