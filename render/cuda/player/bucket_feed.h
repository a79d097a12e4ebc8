// SPDX-License-Identifier: Apache-2.0
// Feeds a store with the buckets that frames are about to show: an engine of playback.h, the thread
// that drives it and loads what it asks for, and callers that wait. It knows no device: tests feed
// stores of their own.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "l4d/experimental/cuda_player.h"
#include "libl4dcodec/base/status.h"
#include "render/cuda/player/resident_buckets.h"

namespace l4d::render {

// A bucket that the engine wants loaded, and where it goes.
struct BucketPlace {
  BucketKey key{};
  uint32_t id = 0;      // of the load
  uint32_t detail = 0;  // L4D_DETAIL_*
  uint64_t units = 0;   // Gaussians at most
  bool urgent = false;  // the instant needs it
  // What its stream says of it.
  uint32_t slots = 0;
  double center = 0;          // of its time, seconds
  double begin = 0, end = 0;  // when some of it may be visible
  uint32_t group = 0;         // MotionGroup
  std::vector<uint32_t> chunks;
};

// What is fed, on the thread of the feed. Batches are of one stream and one detail, and ascend.
class BucketStore {
 public:
  virtual ~BucketStore() = default;
  // Once, before all else: what the store is to be like. Nobody else uses the decoder, here and in
  // prepare().
  virtual Status open(l4d_decoder* decoder) = 0;
  // Reads and checks what the buckets of a query are stored as.
  virtual Status prepare(l4d_decoder* decoder, const l4d_query& query, uint64_t gaussians) = 0;
  // Decodes them, beside the store.
  virtual Status decode() = 0;
  // Makes room for so many chunks and keeps what there is. No frame begins meanwhile.
  virtual Status reserve(uint32_t chunks) = 0;
  // Begins to put them into their chunks, after all frames so far. shown: frames may show some of
  // these chunks, none begins meanwhile, and those that follow come after this.
  virtual Status place(const std::vector<BucketPlace>& batch, bool shown) = 0;
  // Waits until they are there.
  virtual Status finish() = 0;
};

class BucketFeed {
 public:
  static constexpr uint64_t kMostSlots = (1u << 30) - 1;  // of a store
  using Lock = std::unique_lock<std::mutex>;
  BucketFeed(BucketStore* store, uint32_t chunk_slots) : store_(*store), residents_(chunk_slots) {}
  ~BucketFeed() { stop(); }
  BucketFeed(const BucketFeed&) = delete;
  BucketFeed& operator=(const BucketFeed&) = delete;

  // Begins to play what `options` say, which have been checked. Of a local file, waits until it is
  // open.
  Status open(const l4d_cuda_player_options& options);
  // Ends the thread. Before the store goes.
  void stop();

  // ---- of the thread that draws. Under the lock nothing is loaded or unloaded.
  Lock lock() { return Lock(mutex_); }
  // Time of the presentation that frames of `time` show.
  double clamped(double time) const;
  // Until all that `time` shows is there. `time` is not NaN.
  Status await(double time, Lock* lock);
  const ResidentBuckets& residents() const { return residents_; }
  // Another number after each change of residents().
  uint64_t revision() const { return revision_; }
  // What it counts; the rest stays.
  void count(l4d_cuda_player_counters* out) const;

  // ---- of any thread. As the functions of playback.h.
  uint32_t take(l4d_playback_item* items, uint32_t capacity);
  l4d_status answered(uint32_t id, const l4d_answer* answer);
  l4d_status received(uint32_t id, const void* data, size_t n);
  l4d_status finished(uint32_t id, uint32_t outcome);
  l4d_status set_rate(double rate);
  l4d_playback_state state() const;

 private:
  static constexpr size_t kLinkItems = 256;
  using Batch = std::vector<BucketPlace>;
  struct Destroy {
    void operator()(l4d_playback* p) const { l4d_playback_destroy(p); }
  };

  Status make_engine(const l4d_cuda_player_options& options);
  double now() const;
  bool is_ready(double time) const;
  void ask(double time);
  void wake();
  template <typename Body>
  l4d_status on_engine(const Body& body);
  // Of the feed's thread.
  void work();
  Status drive();
  void give_back(double now);
  void take_items(double now, std::vector<BucketKey>* unloads, Status* failed, uint32_t* failed_id);
  Status open_store(uint32_t stream);
  Batch next_batch();
  Status load(Batch batch);
  Status prepare(Batch* batch);
  Status load_whole(Batch* batch);
  Status put(Batch* batch);
  Status make_room(const BucketPlace& bucket, ResidentBucket** out);
  void fail(const Status& status);
  void start_over();

  BucketStore& store_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  bool is_local_ = false, waits_ = true;
  double ahead_ = 0;
  uint32_t most_chunks_ = 0;  // 0: as many as it takes

  // Who has both locks has taken this one first.
  std::mutex engine_mutex_;
  std::unique_ptr<l4d_playback, Destroy> engine_;
  std::deque<l4d_playback_item> link_items_;
  bool is_store_open_ = false;

  mutable std::mutex mutex_;
  std::condition_variable to_feed_, to_caller_;
  ResidentBuckets residents_;
  uint64_t revision_ = 0;
  l4d_playback_state state_{};        // when the engine planned last
  std::vector<l4d_time_span> ready_;  // what frames may show, near the instant
  uint32_t asked_ = 0;                // number of the last wish
  double asked_time_ = 0;
  bool urgent_ = false;  // a caller waits for it
  bool is_open_ = false;
  double step_ = 0;  // seconds from one wish to the next
  Status failure_;   // of the wish failed_
  uint32_t failed_ = 0;
  bool may_retry_ = false;  // it says nothing of the stream
  Status broken_;           // for good
  bool woken_ = false;      // the engine has something to do
  bool stop_ = false;
  l4d_cuda_player_counters counters_{};

  // Of the feed's thread alone.
  uint32_t sought_ = 0;  // the last wish that the engine knows
  bool paused_ = false;  // until the next wish: loading has failed
  bool lost_items_ = false;
  std::deque<BucketPlace> loads_;
  std::thread thread_;
};

}  // namespace l4d::render
