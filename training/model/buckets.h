// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "io/scene/scene.h"
#include "training/model/span.h"
#include "training/model/state.h"

namespace l4d::train {

// A file of rows cannot be written, is missing, or is not as it was written.
class BucketError : public io::Error {
 public:
  using io::Error::Error;
};

struct BucketOptions {
  uint64_t memory = uint64_t{8} << 30;  // bytes of rows that stay in memory
  std::string folder;                   // for the others; it is made when one is needed
  uint64_t arena_bytes = uint64_t{1} << 20;
  double duration = 1;  // of the sequence, s
};

// Rows of a model that are not in the back end, with all that belongs to them. Rows lie in arenas,
// each for rows that are visible at about the same time: those of a layer, whose buckets are as
// long as the span in which a row is visible or longer, and of the bucket that contains its middle.
// Both are computed when a row comes, so rows may change them from one time to the next. Arenas
// that do not fit in the memory are files, which are removed when their rows go, and with the
// store.
class BucketStore {
 public:
  // Some of the rows.
  class Wanted {
   public:
    // Those that are visible at some instant of `times`. Arenas of other times are not looked into,
    // so that this takes as long as there are rows near to these times.
    explicit Wanted(std::vector<TimeInterval> times)
        : is_wanted_(
              [times = std::move(times)](const RowSpan& span) { return meets_any(span, times); }),
          by_time_(true) {}
    // Those for which a function returns true.
    explicit Wanted(std::function<bool(const RowSpan&)> is_wanted)
        : is_wanted_(std::move(is_wanted)) {}
    bool operator()(const RowSpan& row) const { return is_wanted_(row); }
    // False: no row of an arena is wanted. whole: contains the spans of all its rows.
    bool may_have(const RowSpan& whole) const { return !by_time_ || is_wanted_(whole); }

   private:
    std::function<bool(const RowSpan&)> is_wanted_;
    bool by_time_ = false;
  };

  explicit BucketStore(BucketOptions options) : options_(std::move(options)) {}
  ~BucketStore() { clear(); }
  BucketStore(const BucketStore&) = delete;
  BucketStore& operator=(const BucketStore&) = delete;

  // Takes rows in. Throws BucketError if a file cannot be written: all rows are in memory then.
  void add(const ModelState& rows);
  // Moves the wanted rows out; they are sorted by id. Throws BucketError if a file that has one of
  // them is missing or damaged: no row has moved then.
  ModelState take(const Wanted& wanted);
  // Likewise, without moving them.
  ModelState copy(const Wanted& wanted) const;
  uint64_t count(const Wanted& wanted) const;
  void clear();

  uint64_t rows() const { return rows_; }
  uint64_t memory_bytes() const { return memory_bytes_; }
  uint64_t file_bytes() const { return file_bytes_; }
  const BucketOptions& options() const { return options_; }

 private:
  struct Bucket {
    uint32_t layer;
    uint64_t index;
    bool operator<(const Bucket& o) const {
      return layer != o.layer ? layer < o.layer : index < o.index;
    }
  };
  struct Arena {
    std::vector<RowSpan> spans;             // of the rows
    RowSpan whole{0, INFINITY, -INFINITY};  // contains them
    std::vector<uint32_t> words;            // [rows, record words], empty if they are in a file
    uint64_t number = 0;                    // of arenas, in the order in which they began
    uint64_t hash = 0;                      // of the words in the file
    std::string path;                       // of the file, "" = none
  };
  using Arenas = std::multimap<Bucket, Arena>;

  Bucket bucket_of(const RowSpan& span) const;
  Arena* open_arena(const Bucket& bucket);
  void append(const Bucket& bucket, const RowSpan& span, const uint32_t* record);
  void write_beyond_memory();
  void write(const Bucket& bucket, Arena* arena);
  static bool has_any(const Arena& arena, const Wanted& wanted);
  std::vector<uint32_t> read(const Arena& arena) const;
  void forget_file(Arena* arena);
  ModelState unpacked(std::vector<std::pair<uint32_t, const uint32_t*>> records) const;

  BucketOptions options_;
  size_t record_words_ = 0;  // of a row; 0 = no row has come yet
  uint32_t sh_degree_ = 0;
  Arenas arenas_;
  uint64_t rows_ = 0, memory_bytes_ = 0, file_bytes_ = 0, next_number_ = 0;
};

// Whether a file has a name that a store gives: LAYER-INDEX-NUMBER.rows, or what a write of it had
// not ended yet.
bool is_bucket_name(const std::string& name);

// Removes the files of rows in a folder that a store of a process left that was killed.
void remove_buckets(const std::string& folder);

// The spans of the first `count` rows.
std::vector<RowSpan> spans_of(const ModelState& model);

}  // namespace l4d::train
