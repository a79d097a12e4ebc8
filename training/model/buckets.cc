// SPDX-License-Identifier: Apache-2.0
#include "training/model/buckets.h"

#include <xxhash.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>

#include "io/file/file.h"

namespace l4d::train {
namespace {

namespace fs = std::filesystem;

constexpr uint32_t kMaxLayer = 24;
constexpr const char* kSuffix = ".rows";
constexpr size_t kPackedRows = 1024;  // at a time

size_t record_words(const ModelState& model) {
  size_t words = 0;
  for_each_column([&](const std::string&, size_t numbers, const auto&) { words += numbers; },
                  model);
  return words;
}

// `rows` rows from `begin` on as words, [rows, words], and back: column by column, since names of
// columns take longer than the numbers of a row.
std::vector<uint32_t> packed(const ModelState& model, size_t begin, size_t rows, size_t words) {
  std::vector<uint32_t> records(rows * words);
  size_t first = 0;
  for_each_column(
      [&](const std::string&, size_t numbers, const auto& column) {
        for (size_t i = 0; i < rows; ++i) {
          std::memcpy(&records[i * words + first], column.data() + (begin + i) * numbers,
                      numbers * sizeof(uint32_t));
        }
        first += numbers;
      },
      model);
  return records;
}
void unpack(const std::vector<std::pair<uint32_t, const uint32_t*>>& records, ModelState* model) {
  size_t first = 0;
  for_each_column(
      [&](const std::string&, size_t numbers, auto& column) {
        for (size_t i = 0; i < records.size(); ++i) {
          std::memcpy(column.data() + i * numbers, records[i].second + first,
                      numbers * sizeof(uint32_t));
        }
        first += numbers;
      },
      *model);
}

// A file or a link of this name is somebody else's and stays, and so does a folder with files.
void remove_empty_folder(const std::string& folder) {
  std::error_code error;
  if (fs::is_directory(fs::symlink_status(folder, error))) fs::remove(folder, error);
}

std::string reason() { return std::strerror(errno); }

}  // namespace

std::vector<RowSpan> spans_of(const ModelState& model) {
  std::vector<RowSpan> spans;
  spans.reserve(static_cast<size_t>(model.count));
  for (size_t i = 0; i < model.count; ++i) {
    spans.push_back(span_of(model.value.rotor.data() + 8 * i, model.value.log_scale.data() + 4 * i,
                            model.value.mean_t[i], model.id[i]));
  }
  return spans;
}

BucketStore::Bucket BucketStore::bucket_of(const RowSpan& span) const {
  const double length = static_cast<double>(span.end) - static_cast<double>(span.begin);
  Bucket bucket{0, 0};
  if (!(length < options_.duration) || !(length > 0)) return bucket;
  while (bucket.layer < kMaxLayer &&
         std::ldexp(options_.duration, -1 - static_cast<int>(bucket.layer)) >= length) {
    ++bucket.layer;
  }
  const double buckets = std::ldexp(1.0, static_cast<int>(bucket.layer));
  const double middle = 0.5 * (static_cast<double>(span.begin) + static_cast<double>(span.end));
  const double at = std::floor(middle / options_.duration * buckets);
  bucket.index = static_cast<uint64_t>(std::clamp(at, 0.0, buckets - 1));
  return bucket;
}

// The arena of the bucket that has capacity for one row more.
BucketStore::Arena* BucketStore::open_arena(const Bucket& bucket) {
  const size_t most = std::max<size_t>(
      1, static_cast<size_t>(options_.arena_bytes) / (record_words_ * sizeof(uint32_t)));
  // The newest of a bucket is the last of its range.
  const auto [begin, end] = arenas_.equal_range(bucket);
  if (begin != end) {
    Arena* newest = &std::prev(end)->second;
    if (newest->path.empty() && newest->spans.size() < most) return newest;
  }
  Arena arena;
  arena.number = next_number_++;
  return &arenas_.emplace(bucket, std::move(arena))->second;
}

void BucketStore::append(const Bucket& bucket, const RowSpan& span, const uint32_t* record) {
  Arena* arena = open_arena(bucket);
  // Where memory ends between the two, no span is without its record: a copy of all goes by spans.
  arena->words.insert(arena->words.end(), record, record + record_words_);
  arena->spans.push_back(span);
  arena->whole.begin = std::min(arena->whole.begin, span.begin);
  arena->whole.end = std::max(arena->whole.end, span.end);
  memory_bytes_ += record_words_ * sizeof(uint32_t);
  ++rows_;
}

void BucketStore::add(const ModelState& rows) {
  if (rows.count == 0) return;
  record_words_ = record_words(rows);
  sh_degree_ = rows.sh_degree();
  const std::vector<RowSpan> spans = spans_of(rows);
  for (size_t begin = 0; begin < spans.size(); begin += kPackedRows) {
    const size_t count = std::min(kPackedRows, spans.size() - begin);
    const std::vector<uint32_t> records = packed(rows, begin, count, record_words_);
    for (size_t i = 0; i < count; ++i) {
      const RowSpan& span = spans[begin + i];
      append(bucket_of(span), span, &records[i * record_words_]);
    }
  }
  write_beyond_memory();
}

// Rows that came last are needed again last: windows of images go round.
void BucketStore::write_beyond_memory() {
  if (memory_bytes_ <= options_.memory) return;
  std::vector<std::pair<const Bucket*, Arena*>> in_memory;
  for (auto& [bucket, arena] : arenas_) {
    if (arena.path.empty()) in_memory.emplace_back(&bucket, &arena);
  }
  std::sort(in_memory.begin(), in_memory.end(),
            [](const auto& a, const auto& b) { return a.second->number > b.second->number; });
  for (size_t k = 0; k < in_memory.size() && memory_bytes_ > options_.memory; ++k) {
    write(*in_memory[k].first, in_memory[k].second);
  }
}

void BucketStore::write(const Bucket& bucket, Arena* arena) {
  std::error_code error;
  fs::create_directories(options_.folder, error);
  const std::string name = std::to_string(bucket.layer) + "-" + std::to_string(bucket.index) + "-" +
                           std::to_string(arena->number) + kSuffix;
  const std::string path = (fs::path(options_.folder) / name).string();
  const size_t bytes = arena->words.size() * sizeof(uint32_t);
  io::FileHandle file(std::fopen(path.c_str(), "wb"));
  if (!file) throw BucketError(L4D_ERR_IO, path + ": cannot be written: " + reason());
  const bool whole = std::fwrite(arena->words.data(), 1, bytes, file.get()) == bytes &&
                     std::fflush(file.get()) == 0;
  const std::string why = whole ? "" : reason();
  if (std::fclose(file.release()) != 0 || !whole) {
    fs::remove(path, error);
    throw BucketError(L4D_ERR_IO, path + ": cannot be written: " + (whole ? reason() : why));
  }
  arena->hash = XXH3_64bits(arena->words.data(), bytes);
  arena->path = path;
  arena->words = std::vector<uint32_t>();
  memory_bytes_ -= bytes;
  file_bytes_ += bytes;
}

std::vector<uint32_t> BucketStore::read(const Arena& arena) const {
  const size_t words = arena.spans.size() * record_words_, bytes = words * sizeof(uint32_t);
  std::vector<uint32_t> out(words + 1);  // one more, to notice what is longer
  io::FileHandle file(std::fopen(arena.path.c_str(), "rb"));
  if (!file) throw BucketError(L4D_ERR_IO, arena.path + ": cannot be read: " + reason());
  const size_t got = std::fread(out.data(), 1, bytes + 1, file.get());
  if (std::ferror(file.get()) != 0) {
    throw BucketError(L4D_ERR_IO, arena.path + ": cannot be read: " + reason());
  }
  if (got != bytes) {
    throw BucketError(L4D_ERR_CORRUPT, arena.path + ": byte " +
                                           std::to_string(std::min(got, bytes)) +
                                           ": the file of rows has another length than it had: " +
                                           std::to_string(bytes) + " bytes");
  }
  out.resize(words);
  if (XXH3_64bits(out.data(), bytes) != arena.hash) {
    throw BucketError(L4D_ERR_CORRUPT, arena.path + ": byte 0: the checksum of the rows is wrong");
  }
  return out;
}

// Its rows are in memory, or not wanted any more.
void BucketStore::forget_file(Arena* arena) {
  std::error_code ignored;
  fs::remove(arena->path, ignored);
  arena->path.clear();
  file_bytes_ -= arena->spans.size() * record_words_ * sizeof(uint32_t);
}

// records: ids, and the words of their rows, in any order.
ModelState BucketStore::unpacked(std::vector<std::pair<uint32_t, const uint32_t*>> records) const {
  std::sort(records.begin(), records.end());
  ModelState out;
  out.allocate(records.size(), sh_degree_);
  out.count = records.size();
  unpack(records, &out);
  return out;
}

bool BucketStore::has_any(const Arena& arena, const Wanted& wanted) {
  return wanted.may_have(arena.whole) &&
         std::any_of(arena.spans.begin(), arena.spans.end(), std::cref(wanted));
}

ModelState BucketStore::copy(const Wanted& wanted) const {
  std::vector<std::vector<uint32_t>> read_words;  // keep what records point to
  std::vector<std::pair<uint32_t, const uint32_t*>> records;
  for (const auto& [bucket, arena] : arenas_) {
    if (!has_any(arena, wanted)) continue;
    const uint32_t* words = arena.words.data();
    if (!arena.path.empty()) {
      read_words.push_back(read(arena));
      words = read_words.back().data();
    }
    for (size_t i = 0; i < arena.spans.size(); ++i) {
      if (wanted(arena.spans[i]))
        records.emplace_back(arena.spans[i].id, words + i * record_words_);
    }
  }
  return unpacked(std::move(records));
}

ModelState BucketStore::take(const Wanted& wanted) {
  std::vector<Arenas::iterator> found;
  std::vector<std::vector<uint32_t>> words;
  for (auto at = arenas_.begin(); at != arenas_.end(); ++at) {
    if (!has_any(at->second, wanted)) continue;
    found.push_back(at);
    words.push_back(at->second.path.empty() ? std::vector<uint32_t>() : read(at->second));
  }
  // All is read: nothing fails from here on.
  std::vector<std::pair<uint32_t, const uint32_t*>> records;
  std::vector<std::pair<Bucket, Arena>> gone;
  for (size_t k = 0; k < found.size(); ++k) {
    Arena arena = std::move(found[k]->second);
    if (arena.path.empty()) {
      memory_bytes_ -= arena.words.size() * sizeof(uint32_t);
    } else {
      forget_file(&arena);
      arena.words = std::move(words[k]);
    }
    rows_ -= arena.spans.size();
    gone.emplace_back(found[k]->first, std::move(arena));
    arenas_.erase(found[k]);
  }
  for (const auto& [bucket, arena] : gone) {
    for (size_t i = 0; i < arena.spans.size(); ++i) {
      const uint32_t* record = arena.words.data() + i * record_words_;
      if (wanted(arena.spans[i])) {
        records.emplace_back(arena.spans[i].id, record);
      } else {
        append(bucket, arena.spans[i], record);
      }
    }
  }
  return unpacked(std::move(records));
}

uint64_t BucketStore::count(const Wanted& wanted) const {
  uint64_t rows = 0;
  for (const auto& [bucket, arena] : arenas_) {
    if (!wanted.may_have(arena.whole)) continue;
    rows += static_cast<uint64_t>(
        std::count_if(arena.spans.begin(), arena.spans.end(), std::cref(wanted)));
  }
  return rows;
}

void BucketStore::clear() {
  for (auto& [bucket, arena] : arenas_) {
    if (!arena.path.empty()) forget_file(&arena);
  }
  arenas_.clear();
  rows_ = memory_bytes_ = file_bytes_ = 0;
  remove_empty_folder(options_.folder);
}

bool is_bucket_name(const std::string& name) {
  size_t at = 0;
  for (int part = 0; part < 3; ++part) {
    const size_t begin = at;
    while (at < name.size() && name[at] >= '0' && name[at] <= '9') ++at;
    if (at == begin) return false;
    if (part < 2 && (at == name.size() || name[at++] != '-')) return false;
  }
  return name.compare(at, std::strlen(kSuffix), kSuffix) == 0;
}

void remove_buckets(const std::string& folder) {
  std::error_code error;
  std::vector<fs::path> old;
  fs::directory_iterator entry(folder, error);
  for (; !error && entry != fs::directory_iterator(); entry.increment(error)) {
    const fs::path& path = entry->path();
    if (path.extension() == kSuffix && is_bucket_name(path.filename().string())) {
      old.push_back(path);
    }
  }
  for (const fs::path& path : old) fs::remove(path, error);
  remove_empty_folder(folder);
}

}  // namespace l4d::train
