// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/source.h"

#include <algorithm>
#include <string>

namespace l4d {
namespace {

// Ranges of the file, in its order, as few as there are gaps of more than max_gap bytes.
std::vector<ByteRange> joined(std::vector<ByteRange> ranges, uint64_t max_gap) {
  std::sort(ranges.begin(), ranges.end(), [](const ByteRange& a, const ByteRange& b) {
    return a.offset < b.offset || (a.offset == b.offset && a.size > b.size);
  });
  size_t kept = 0;
  for (const ByteRange& range : ranges) {
    const uint64_t range_end = range.offset + range.size;
    if (kept > 0) {
      ByteRange& before = ranges[kept - 1];
      const uint64_t end = before.offset + before.size;
      if (range_end <= end) continue;
      const bool near = range.offset <= end || range.offset - end <= max_gap;
      if (near && range_end - before.offset <= kMaxReadBytes) {
        before.size = range_end - before.offset;
        continue;
      }
    }
    ranges[kept++] = range;
  }
  ranges.resize(kept);
  return ranges;
}

}  // namespace

ByteSource ByteSource::from_memory(ByteSpan data) {
  ByteSource s;
  s.memory_ = data;
  s.size_ = data.size();
  return s;
}

Status ByteSource::from_reader(const l4d_reader& reader, ByteSource* out) {
  if (reader.read_at == nullptr || reader.size == nullptr) {
    return invalid_argument("the reader lacks a callback");
  }
  const int64_t size = reader.size(reader.user);
  if (size < 0) return Status(L4D_ERR_IO, "the reader cannot tell its size");
  *out = ByteSource();
  out->reader_ = reader;
  out->reader_.block_bytes = std::min(reader.block_bytes, kMaxReadBytes);
  out->size_ = static_cast<uint64_t>(size);
  return {};
}

Status ByteSource::check_range(uint64_t offset, uint64_t n) const {
  if (offset <= size_ && n <= size_ - offset) return {};
  return Status(L4D_ERR_TRUNCATED, "CHNK-1", offset,
                std::to_string(n) + " bytes wanted, the file has " + std::to_string(size_));
}

Status ByteSource::read_apart(uint64_t offset, uint64_t n, unsigned char* to) const {
  L4D_RETURN_IF_ERROR(check_range(offset, n));
  if (reader_.read_at != nullptr) return call_reader(offset, n, to);
  std::copy_n(memory_.data() + offset, n, to);
  return {};
}

Status ByteSource::read(uint64_t offset, uint64_t n, Bytes& storage, ByteSpan* out) {
  L4D_RETURN_IF_ERROR(check_range(offset, n));
  if (reader_.read_at == nullptr) {
    count_reads(1, n);
    *out = memory_.subspan(static_cast<size_t>(offset), static_cast<size_t>(n));
    return {};
  }
  if (fetched_.find(offset, n, out)) return {};
  storage.resize(static_cast<size_t>(n));
  count_reads(1, n);
  L4D_RETURN_IF_ERROR(call_reader(offset, n, storage.data()));
  *out = ByteSpan(storage.data(), storage.size());
  return {};
}

Status ByteSource::call_reader(uint64_t offset, uint64_t n, unsigned char* to) const {
  uint64_t done = 0;
  while (done < n) {
    const int64_t got =
        reader_.read_at(reader_.user, to + done, static_cast<size_t>(n - done), offset + done);
    if (got < 0) {
      return Status(L4D_ERR_IO, "", offset + done, "the reader failed");
    }
    if (got == 0 || static_cast<uint64_t>(got) > n - done) {
      return Status(L4D_ERR_IO, "", offset + done, "the reader ended before its own size");
    }
    done += static_cast<uint64_t>(got);
  }
  return {};
}

bool ByteSource::is_fetched(uint64_t offset, uint64_t n) const {
  ByteSpan bytes;
  return fetches() && fetched_.find(offset, n, &bytes);
}

void ByteSource::fetch(std::vector<ByteRange> ranges, FetchedFor reason, MemoryBudget& memory) {
  if (!fetches()) return;
  if (reason == FetchedFor::kBase) {
    fetched_.limit(reason, kMaxReadBytes);
  } else if (reason != FetchedFor::kStream) {
    fetched_.keep_only(reason, ranges);
  }
  const auto not_wanted = [&](const ByteRange& r) {
    const bool in_file = r.offset <= size_ && r.size <= size_ - r.offset;
    return r.size == 0 || !in_file || is_fetched(r.offset, r.size);
  };
  ranges.erase(std::remove_if(ranges.begin(), ranges.end(), not_wanted), ranges.end());
  std::vector<l4d_read> reads;
  for (const ByteRange& run : joined(std::move(ranges), block_bytes())) {
    unsigned char* const to = fetched_.add(run.offset, run.size, reason, memory);
    if (to == nullptr) break;
    reads.push_back({run.offset, static_cast<size_t>(run.size), to});
  }
  for (const l4d_read& r : reads) count_reads(1, r.size);
  if (reader_.read_many == nullptr || reads.size() < 2) {
    for (const l4d_read& r : reads) {
      const bool read = call_reader(r.offset, r.size, static_cast<unsigned char*>(r.dst)).ok();
      if (!read) fetched_.remove(r.offset);
    }
    return;
  }
  if (reader_.read_many(reader_.user, reads.data(), reads.size()) == 0) return;
  for (const l4d_read& r : reads) fetched_.remove(r.offset);
}

}  // namespace l4d
