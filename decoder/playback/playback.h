// SPDX-License-Identifier: Apache-2.0
// Plays a stream, or the members of a playlist, over a link: ties together what the other files of
// this folder know. It has no thread, no clock and no sockets, and calls nothing back.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "decoder/playback/blocks.h"
#include "decoder/playback/clock.h"
#include "decoder/playback/link.h"
#include "decoder/playback/live.h"
#include "decoder/playback/path.h"
#include "decoder/playback/planner.h"
#include "decoder/playback/presentation.h"
#include "decoder/playback/rate_control.h"
#include "decoder/playback/residents.h"
#include "l4d/playback.h"

namespace l4d::playback {

// Fills in the defaults of options that are 0. Fails where one is out of range.
Status resolve(l4d_playback_options* options);

class Playback {
 public:
  static constexpr size_t kQueueItems = 256;

  // options: resolved. decoders: of this engine alone.
  Playback(const l4d_playback_options& options, Decoders& decoders);
  Playback(const Playback&) = delete;
  Playback& operator=(const Playback&) = delete;

  // As the functions of playback.h. `now` and other numbers are finite, but for the time of seek().
  void open(double now, const char* uri, uint32_t kind, uint64_t size);
  Status open_reader(double now, const l4d_reader& reader);
  void close(double now);
  Status play(double now);
  Status pause(double now);
  Status seek(double now, double time, double tolerance, uint32_t id);
  void set_rate(double now, double rate);
  void set_range(double now, uint32_t mode, double begin, double end);
  void set_quality(double now, const l4d_quality& quality);
  void retry(double now);
  void refresh(double now);
  void update(double now);
  uint32_t take(l4d_playback_item* items, uint32_t capacity);
  void answered(double now, uint32_t id, const l4d_answer& answer);
  void received(double now, uint32_t id, ByteSpan data);
  void finished(double now, uint32_t id, uint32_t outcome);
  void loaded(double now, uint32_t id, uint64_t units, l4d_status status);
  Status slice(double time, l4d_splat_buffers* out);
  l4d_playback_state state() const;
  void buffered(std::vector<l4d_time_span>* out) const;
  void shown(double begin, double end, std::vector<l4d_shown_member>* out) const;
  void losses(std::vector<l4d_playback_loss>* out) const;
  // Null where there is no such source.
  const char* uri(uint32_t source) const;
  // Null where there is no such stream, or it is not open.
  Decoder* decoder(uint32_t stream) const;
  bool is_closed() const { return stream_ == L4D_STREAM_CLOSED; }

  // For tests: what the parts hold.
  const Presentation& presentation() const { return presentation_; }
  const Planner& planner() const { return planner_; }
  const Link& link() const { return link_; }
  const Blocks& blocks() const { return blocks_; }
  const Residents& residents() const { return residents_; }
  const Live& live() const { return live_; }
  uint32_t floor_rung() const { return settings_.floor; }

 private:
  struct Search {
    bool active = false;
    uint32_t id = 0;
    double time = 0;
  };

  // playback.cc
  void advance(double now);
  void lower_rung_or_wait();
  void reset(double now, const char* uri);
  void set_motion(uint32_t motion);
  void set_stream(uint32_t stream, uint32_t cause);
  void show_rung(uint32_t rung);
  void move_to(double time);
  void set_path_range();
  double clamped(double time) const;
  void end_search(Search* search, uint32_t event, uint32_t cause);
  void end_searches(uint32_t event, uint32_t cause);
  l4d_playback_item& add_item(uint32_t kind);
  void add_event(uint32_t event, uint32_t id, uint32_t cause, double value);
  void add_chunk_events();
  // So that the next item cannot fail to get into the queue.
  void reserve_item() {
    if (queue_.size() == queue_.capacity()) queue_.reserve(2 * queue_.size() + 16);
  }
  bool has_room() const { return queue_.size() - queue_begin_ < kQueueItems; }
  Status check_open() const;
  // playback_plan.cc
  void plan();
  uint64_t bytes_for_path() const;
  void choose_rungs();
  void choose_shown();
  void update_items(bool changed);
  void serve_search();
  void resume();
  void add_loads();
  void order_loads();
  bool add_load(const Part& part, const Item& item);
  void unload(const Residents::Bucket& bucket);
  bool unload_one();
  void find_wake_at();
  // playback_parts.cc
  void set_limit(Part* part) const;
  bool follow();
  bool follow_parts(bool* changed);
  void on_opened();
  void begin_playback();
  void open_first();
  void lose_part(Part* part, uint32_t cause, double retry_at);
  void seek_part_again(Part* part);
  void fail_source(Part* part, uint32_t cause, double retry_at);
  void close_part(Part* part);
  void close_unused();
  void tell_closed(const Part& part);
  // playback_state.cc
  ReadyInterval stage_interval(size_t stage, uint32_t rung, double time) const;
  ReadyInterval ready_interval(uint32_t rung, double time) const;
  void find_ready();
  void buffered_stage(size_t stage, std::vector<Interval>* out) const;
  // playback_list.cc
  void add_list_request();
  void receive_list(ByteSpan data);
  void finish_list();
  void take_list(Playlist&& list);
  void set_list(Playlist&& list, bool grown);
  void restart(Playlist&& list);
  void fail_list(uint32_t cause, uint32_t line);
  void update_live();
  void jump_to(double time);
  bool follows_end() const;
  bool is_gone(double time) const;
  // transfers.cc
  void fail_stream(uint32_t cause, double retry_at);
  void try_again();
  void fail_request(uint32_t id, uint32_t cause, double retry_after, bool cancels);
  void fail_for_now(uint32_t id, uint32_t cause);
  void cancel(uint32_t id);
  void cancel_all(const Part* part);
  bool check_version(Part* part, const l4d_answer& answer);
  void take_whole_file(Request* request);
  void answered_list(Request* request, const l4d_answer& answer);
  void guess_size(Part* part, uint64_t bytes);
  void expect_more();
  void expire();
  // receiving.cc
  void read_wanted();
  void receive_fresh(Request* request, ByteSpan data);
  void replace_wrong(Part* part, uint64_t offset, ByteSpan data);
  void store(Request* request, ByteSpan data);
  // requests.cc
  bool comes_too_late(const Part& part, Urgency urgency, uint32_t rung) const;
  void cancel_unwanted();
  bool waits_its_turn(Urgency urgency) const;
  void add_requests();
  void add_request(const WantedRange& range);
  bool is_urgent(Urgency urgency) const;

  l4d_playback_options options_;
  Blocks blocks_;
  Presentation presentation_;
  Planner planner_;
  Link link_;
  Residents residents_;
  Clock clock_;
  Path path_;
  Live live_;
  RateControl rate_;
  RateChoice choice_{};
  l4d_reader reader_{};  // read_at is null without one
  std::string uri_;
  l4d_quality quality_{};
  PlanSettings settings_;
  PlanSettings sorted_;  // of the last order

  double now_ = 0;
  uint32_t stream_ = L4D_STREAM_CLOSED, cause_ = L4D_CAUSE_NONE;
  double retry_at_ = 0;     // of FAILED
  uint32_t not_found_ = 0;  // in a row
  uint32_t search_ = L4D_SEARCH_NONE;
  Search current_, next_;  // served, and the newest one behind it
  bool wants_play_ = false;
  bool has_begun_ = false;     // there is a timeline
  bool has_position_ = false;  // a seek came before that
  bool has_range_ = false;
  double range_begin_ = 0, range_end_ = 0;
  uint32_t mode_ = L4D_PLAY_ONCE;
  uint32_t shown_ = 0;  // rung
  ReadyInterval ready_;
  bool bytes_changed_ = false;  // since the last plan: bytes, losses or loads
  bool sorts_ = true;
  bool was_cut_ = false;
  double chosen_at_ = 0;
  bool choice_is_old_ = false;  // what is ready has changed since
  double waits_until_ = 0;      // of chunks
  double wake_at_ = 0;
  uint32_t last_load_ = 0;
  uint64_t received_bytes_ = 0, wasted_bytes_ = 0;
  // Of a playlist.
  Bytes list_text_;
  bool has_list_ = false;      // it was read
  uint32_t list_request_ = 0;  // id; 0: none is under way
  double list_at_ = 0;         // when to look at it
  uint64_t list_bytes_ = 0;    // of the answer; 0: not known
  uint32_t list_errors_ = 0, passed_over_ = 0;
  double older_since_ = -1;  // below 0: the last look found no older one
  bool follows_ = true;      // the end of a playlist that grows
  bool rebuffers_ = false;   // it waits for what was to be shown, and has not jumped since
  uint32_t live_state_ = L4D_LIVE_NONE;

  std::vector<l4d_playback_item> queue_;
  size_t queue_begin_ = 0;
  std::vector<ChunkEvent> chunk_events_;
  std::vector<Segment> segments_;
  std::vector<Part*> on_path_;
  mutable std::vector<Part*> stage_;
  struct LoadOrder {
    double distance;
    uint32_t rung, part, item;
  };
  std::vector<LoadOrder> load_order_;
  std::vector<uint32_t> lacks_tables_;  // by part: a bit for each layer
  std::vector<UnderWay> under_way_;
};

}  // namespace l4d::playback
