// SPDX-License-Identifier: Apache-2.0
#include "decoder/playback/blocks.h"

#include <algorithm>
#include <cstring>
#include <utility>

namespace l4d::playback {

void Blocks::set_limit(uint64_t max_bytes) {
  // Slots are numbers of 32 bits, of which the last one is none.
  const uint64_t most = (uint64_t{1} << 32) / kPerSlab - 1;
  max_slabs_ = std::clamp<uint64_t>(max_bytes / kSlabBytes, 1, most);
}

bool Blocks::add_slab() {
  if (slabs_.size() >= max_slabs_) return false;
  // All that can fail comes first, so that a failure changes nothing.
  slabs_.reserve(slabs_.size() + 1);
  blocks_.resize(slots_.capacity() + kPerSlab);
  auto slab = std::make_unique<unsigned char[]>(kSlabBytes);
  slots_.grow(kPerSlab);
  slabs_.push_back(std::move(slab));
  return true;
}

bool Blocks::evict() {
  const uint32_t slot = slots_.oldest();
  if (slot == kNone || blocks_[slot].epoch == epoch_) return false;
  slots_.remove(slot);
  ++num_evicted_;
  return true;
}

uint32_t Blocks::make(uint64_t number) {
  if (!slots_.has_free() && !add_slab() && !evict()) return kNone;
  const uint32_t slot = slots_.insert(number);
  blocks_[slot] = {0, epoch_};
  return slot;
}

uint64_t Blocks::append(uint64_t offset, ByteSpan data) {
  uint64_t done = 0;
  while (done < data.size()) {
    const uint64_t at = (offset + done) % kBlockBytes;
    const uint64_t n = std::min<uint64_t>(kBlockBytes - at, data.size() - done);
    uint32_t slot = slots_.find((offset + done) / kBlockBytes);
    if (slot == kNone && at > 0) break;
    if (slot == kNone) slot = make((offset + done) / kBlockBytes);
    if (slot == kNone) break;
    const uint64_t fill = blocks_[slot].fill;
    if (at > fill) break;
    if (at + n > fill) {
      std::memcpy(bytes_of(slot) + fill, data.data() + done + (fill - at),
                  static_cast<size_t>(at + n - fill));
      num_stored_ += at + n - fill;
      blocks_[slot].fill = static_cast<uint32_t>(at + n);
    }
    blocks_[slot].epoch = epoch_;
    slots_.use(slot);
    done += n;
  }
  return done;
}

void Blocks::overwrite(uint64_t offset, ByteSpan data) {
  for (uint64_t done = 0; done < data.size();) {
    const uint64_t at = (offset + done) % kBlockBytes;
    const uint64_t n = std::min<uint64_t>(kBlockBytes - at, data.size() - done);
    const uint32_t slot = slots_.find((offset + done) / kBlockBytes);
    if (slot != kNone && blocks_[slot].fill > at) {
      std::memcpy(bytes_of(slot) + at, data.data() + done,
                  static_cast<size_t>(std::min(n, blocks_[slot].fill - at)));
    }
    done += n;
  }
}

uint64_t Blocks::gap_begin(uint64_t offset, uint64_t end) const {
  while (offset < end) {
    const uint64_t begin = offset / kBlockBytes * kBlockBytes;
    const uint32_t slot = slots_.find(offset / kBlockBytes);
    const uint64_t valid = slot == kNone ? begin : begin + blocks_[slot].fill;
    if (valid <= offset) return offset;
    if (valid < begin + kBlockBytes) return std::min(valid, end);
    offset = valid;
  }
  return end;
}

uint64_t Blocks::gap_end(uint64_t offset, uint64_t end) const {
  while (true) {
    offset = (offset / kBlockBytes + 1) * kBlockBytes;
    if (offset >= end) return end;
    if (slots_.find(offset / kBlockBytes) != kNone) return offset;
  }
}

void Blocks::read(uint64_t offset, uint64_t n, unsigned char* to) const {
  for (uint64_t done = 0; done < n;) {
    const uint64_t at = (offset + done) % kBlockBytes;
    const uint64_t some = std::min(kBlockBytes - at, n - done);
    std::memcpy(to + done, bytes_of(slots_.find((offset + done) / kBlockBytes)) + at,
                static_cast<size_t>(some));
    done += some;
  }
}

void Blocks::use(uint64_t offset, uint64_t n) {
  if (n == 0) return;
  for (uint64_t b = offset / kBlockBytes; b <= (offset + n - 1) / kBlockBytes; ++b) {
    const uint32_t slot = slots_.find(b);
    if (slot == kNone) continue;
    blocks_[slot].epoch = epoch_;
    slots_.use(slot);
  }
}

uint64_t Blocks::fill_mark(uint64_t offset) const {
  const uint32_t slot = slots_.find(offset / kBlockBytes);
  const uint64_t begin = offset / kBlockBytes * kBlockBytes;
  return slot == kNone ? begin : begin + blocks_[slot].fill;
}

void Blocks::clear() {
  slabs_.clear();
  blocks_.clear();
  slots_.clear();
}

uint64_t Blocks::memory_bytes() const {
  return slabs_.size() * kSlabBytes + blocks_.capacity() * sizeof(Block) + slots_.memory_bytes();
}

}  // namespace l4d::playback
