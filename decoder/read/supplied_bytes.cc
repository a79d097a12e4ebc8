// SPDX-License-Identifier: Apache-2.0
#include "decoder/read/supplied_bytes.h"

#include <algorithm>
#include <cstring>
#include <iterator>
#include <utility>

namespace l4d {

SuppliedBytes::Pieces::const_iterator SuppliedBytes::at_or_after(uint64_t offset) const {
  const auto it = pieces_.upper_bound(offset);
  const bool held = it != pieces_.begin() && end_of(std::prev(it)) > offset;
  return held ? std::prev(it) : it;
}

uint64_t SuppliedBytes::gap_begin(uint64_t offset) const {
  for (auto it = at_or_after(offset); it != pieces_.end() && it->first <= offset; ++it) {
    offset = end_of(it);
  }
  return offset;
}

bool SuppliedBytes::holds(uint64_t offset, uint64_t n) const {
  return gap_begin(offset) - offset >= n;
}

Status SuppliedBytes::add(uint64_t offset, ByteSpan data, MemoryBudget& memory) {
  const uint64_t end = offset + data.size();
  ++numbered_;
  for (uint64_t at = gap_begin(offset); at < end; at = gap_begin(at)) {
    const auto next = at_or_after(at);
    const uint64_t gap_end = next == pieces_.end() ? end : std::min(end, next->first);
    MemoryCharge charge(memory);
    L4D_RETURN_IF_ERROR(charge.take(gap_end - at + kNodeBytes, "supplied bytes"));
    const unsigned char* const from = data.data() + (at - offset);
    pieces_.emplace(at, Piece{Bytes(from, from + (gap_end - at)), numbered_});
    charge.keep();
  }
  return {};
}

ByteSpan SuppliedBytes::get(uint64_t offset, uint64_t n, Bytes& storage) const {
  if (n == 0) return {};
  auto it = at_or_after(offset);
  if (end_of(it) - offset >= n) {
    return ByteSpan(it->second.bytes.data(), it->second.bytes.size())
        .subspan(static_cast<size_t>(offset - it->first), static_cast<size_t>(n));
  }
  storage.resize(static_cast<size_t>(n));
  for (uint64_t done = 0; done < n; ++it) {
    const uint64_t some = std::min(n - done, end_of(it) - (offset + done));
    std::memcpy(storage.data() + done, it->second.bytes.data() + (offset + done - it->first),
                static_cast<size_t>(some));
    done += some;
  }
  return ByteSpan(storage.data(), storage.size());
}

void SuppliedBytes::drop(uint64_t offset, uint64_t n, MemoryBudget& memory) {
  const uint64_t end = offset + n;
  for (auto it = at_or_after(offset); it != pieces_.end() && it->first < end;) {
    const uint64_t first = it->first, last = end_of(it);
    // What of the piece lies before and after the range stays.
    const unsigned char* const bytes = it->second.bytes.data();
    Piece before{{}, it->second.number}, after{{}, it->second.number};
    if (first < offset) before.bytes.assign(bytes, bytes + (offset - first));
    if (last > end) after.bytes.assign(bytes + (end - first), bytes + (last - first));
    memory.release(last - first + kNodeBytes);
    it = pieces_.erase(it);
    // No more than was just given back, but for a node of the map.
    const auto keep = [&](uint64_t at, Piece piece) {
      if (piece.bytes.empty()) return;
      MemoryCharge charge(memory);
      if (!charge.take(piece.bytes.size() + kNodeBytes, "supplied bytes").ok()) return;
      pieces_.emplace(at, std::move(piece));
      charge.keep();
    };
    keep(first, std::move(before));
    keep(end, std::move(after));
  }
}

void SuppliedBytes::make_room(uint64_t n, MemoryBudget& memory) {
  while (!pieces_.empty() && !memory.has_capacity(n + kNodeBytes)) {
    const auto oldest = std::min_element(
        pieces_.begin(), pieces_.end(),
        [](const auto& a, const auto& b) { return a.second.number < b.second.number; });
    memory.release(oldest->second.bytes.size() + kNodeBytes);
    pieces_.erase(oldest);
  }
}

}  // namespace l4d
