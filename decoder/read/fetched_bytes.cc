// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/fetched_bytes.h"

#include <algorithm>
#include <iterator>

namespace l4d {
namespace {

// Blocks seldom overlap: the one that holds a range is among the last that begin before it.
constexpr int kMostOverlapping = 4;

}  // namespace

FetchedBytes::Blocks::const_iterator FetchedBytes::block_with(uint64_t offset, uint64_t n) const {
  auto it = blocks_.upper_bound(offset);
  for (int tries = 0; tries < kMostOverlapping && it != blocks_.begin(); ++tries) {
    --it;
    const uint64_t begin = offset - it->first, size = it->second->bytes.size();
    if (begin <= size && n <= size - begin) return it;
  }
  return blocks_.end();
}

bool FetchedBytes::find(uint64_t offset, uint64_t n, ByteSpan* out) const {
  const auto it = block_with(offset, n);
  if (it == blocks_.end()) return false;
  *out = ByteSpan(it->second->bytes.data(), it->second->bytes.size())
             .subspan(static_cast<size_t>(offset - it->first), static_cast<size_t>(n));
  return true;
}

void FetchedBytes::keep_only(FetchedFor reason, const std::vector<ByteRange>& wanted) {
  std::vector<const Block*> kept;
  for (const ByteRange& range : wanted) {
    const auto it = block_with(range.offset, range.size);
    if (it != blocks_.end()) kept.push_back(it->second.get());
  }
  std::sort(kept.begin(), kept.end());
  for (auto it = blocks_.begin(); it != blocks_.end();) {
    const bool goes = it->second->reason == reason &&
                      !std::binary_search(kept.begin(), kept.end(), it->second.get());
    it = goes ? blocks_.erase(it) : std::next(it);
  }
}

void FetchedBytes::limit(FetchedFor reason, uint64_t bytes) {
  uint64_t sum = 0;
  for (const auto& [offset, block] : blocks_) {
    if (block->reason == reason) sum += block->bytes.size();
  }
  while (sum > bytes) {
    auto oldest = blocks_.end();
    for (auto it = blocks_.begin(); it != blocks_.end(); ++it) {
      if (it->second->reason != reason) continue;
      if (oldest == blocks_.end() || it->second->number < oldest->second->number) oldest = it;
    }
    sum -= oldest->second->bytes.size();
    blocks_.erase(oldest);
  }
}

unsigned char* FetchedBytes::add(uint64_t offset, uint64_t n, FetchedFor reason,
                                 MemoryBudget& memory) {
  if (n > memory.capacity() / 4) return nullptr;
  auto block = std::make_unique<Block>(n, reason, ++numbered_, memory);
  if (!block->memory.take(n, "bytes read ahead").ok()) return nullptr;
  unsigned char* const bytes = block->bytes.data();
  blocks_[offset] = std::move(block);
  return bytes;
}

}  // namespace l4d
