// SPDX-License-Identifier: Apache-2.0
// What an l4d_decoder handle is: an open stream, the loops of a backend, and the bucket cache.
#pragma once

#include <map>
#include <memory>
#include <tuple>
#include <vector>

#include "decoder/expand/page_decoder.h"
#include "decoder/read/losses.h"
#include "decoder/read/plan.h"
#include "decoder/read/scene_file.h"
#include "decoder/session/bucket.h"
#include "l4d/decode.h"
#include "libl4dcodec/base/file_reader.h"

namespace l4d {

class Decoder {
 public:
  explicit Decoder(const l4d_decoder_options& options);

  Status open(ByteSource source);
  Status open_file(const char* path);
  void close();
  bool is_open() const { return file_ != nullptr; }
  SceneFile& file() { return *file_; }
  const SceneFile& file() const { return *file_; }
  PageDecoder& pages() { return *pages_; }
  int threads() const { return static_cast<int>(options_.threads); }

  Status select(const l4d_query& query, l4d_selection* out);
  Status ranges(const l4d_query& query, l4d_range* out, uint64_t capacity, uint64_t* count);
  Status reads(const l4d_query& query, uint32_t step, l4d_byte_range* out, uint64_t capacity,
               uint64_t* count);
  Status decode(const l4d_query& query, l4d_gaussian_buffers* out);
  Status decode_packed(const l4d_query& query, l4d_packed_buffers* out);
  Status slice(double time, l4d_splat_buffers* out);
  Status slice(double time, l4d_splat_columns* out);
  // Of slices; kept from stream to stream.
  Status set_detail(uint32_t detail);
  void counters(l4d_counters* out) const;
  const std::vector<l4d_loss>& losses() const { return losses_.query(); }
  void set_progress(l4d_progress_fn fn, void* user) {
    progress_ = fn;
    progress_user_ = user;
  }

 private:
  using BucketKey = std::tuple<uint32_t, uint32_t, uint32_t>;  // layer, bucket, detail
  struct CacheEntry {
    PreparedBucket bucket;
    Plan missing;  // pages that are lost, or their detail, to be asked for again
    size_t lost_parts = 0;
    uint64_t memory_bytes = 0;
    uint64_t last_use = 0;
    uint64_t number = 0;  // of all buckets that were ever cached here
  };
  Status start(ByteSource source);
  PageDecoder::Progress progress(const char* stage) const;
  Status begin_query(const l4d_query& query, Plan* plan);
  Losses* losses_if_tolerant() { return options_.tolerant != 0 ? &losses_ : nullptr; }
  // Makes every bucket of the plan present in the cache; *out points into it, one per range.
  Status prepare(const Plan& plan, std::vector<CacheEntry*>* out);
  // Those of an instant, which is clamped to the sequence.
  Status load_instant(double* time, std::vector<CacheEntry*>* buckets);
  // Sets still_key_ to what stands for the still rows of an output: their kind, and the numbers of
  // their buckets.
  void set_still(std::vector<uint64_t> rows);
  Status prepare_range(const Plan& plan, size_t range, size_t first_task, size_t end_task,
                       CacheEntry* out);
  // Whether pages that a cached bucket lacks can be had now; if not, they are lost again.
  Status has_recovered(const CacheEntry& entry, bool* recovered);
  void drop(std::map<BucketKey, CacheEntry>::iterator entry);
  void evict(uint64_t needed);
  void drop_cache();

  l4d_decoder_options options_;
  uint32_t detail_ = L4D_DETAIL_FULL;
  DecodeKernels kernels_;
  std::unique_ptr<FileReader> own_file_;
  std::unique_ptr<SceneFile> file_;
  std::unique_ptr<PageDecoder> pages_;
  l4d_progress_fn progress_ = nullptr;
  void* progress_user_ = nullptr;
  // Keyed by range: RCQ blocks never split a bucket, so (layer, bucket) names one range. Buckets of
  // one detail are of no use to slices of another.
  std::map<BucketKey, CacheEntry> cache_;
  uint64_t cache_bytes_ = 0;
  uint64_t clock_ = 0;
  uint64_t numbered_ = 0;
  std::vector<uint64_t> still_rows_;  // of the last slice
  uint64_t still_key_ = 1;
  uint64_t buckets_decoded_ = 0;
  uint64_t cache_hits_ = 0;
  Losses losses_;
};

}  // namespace l4d
