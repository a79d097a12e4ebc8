// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cstddef>
#include <cstring>

#include "libl4dcodec/entropy/rans_kernels.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "libl4dcodec/entropy/rans_simd.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace l4d {
namespace HWY_NAMESPACE {
namespace {
#if HWY_TARGET == HWY_SCALAR || HWY_HAVE_SCALABLE
// All states have to stay in an array of vectors, which vectors of unknown size cannot form.
const RansKernels* kernels() { return &rans_kernels_reference(); }
#else
namespace hn = hwy::HWY_NAMESPACE;

using D = hn::ScalableTag<uint32_t>;
using V = hn::Vec<D>;
constexpr size_t kWidth = HWY_LANES(uint32_t);
constexpr size_t kVectors = kRansLanes / kWidth;
static_assert(kWidth == 4 || kWidth == 8 || kWidth == 16, "no way to expand words");

// A group takes at most a word per lane and step.
constexpr std::ptrdiff_t kHybridBytes = 2 * kRansLanes * 2;
constexpr std::ptrdiff_t kWideBytes = 5 * kRansLanes * 2;

#if HWY_TARGET == HWY_AVX2
// kRanks[mask][lane]: how many lanes of the mask lie below this one.
constexpr auto make_ranks() {
  std::array<std::array<uint8_t, 8>, 256> ranks{};
  for (size_t mask = 0; mask < 256; ++mask) {
    uint8_t rank = 0;
    for (size_t lane = 0; lane < 8; ++lane) {
      ranks[mask][lane] = rank;
      rank = static_cast<uint8_t>(rank + (mask >> lane & 1));
    }
  }
  return ranks;
}
#elif HWY_TARGET > HWY_AVX2
// kBytes[mask]: which byte of four words goes to which byte of four lanes; 0x80 = zero.
constexpr auto make_bytes() {
  std::array<std::array<uint8_t, 16>, 16> bytes{};
  for (size_t mask = 0; mask < 16; ++mask) {
    uint8_t at = 0;
    for (size_t lane = 0; lane < 4; ++lane) {
      const bool used = (mask >> lane & 1) != 0;
      bytes[mask][4 * lane] = used ? at : uint8_t{0x80};
      bytes[mask][4 * lane + 1] = used ? static_cast<uint8_t>(at + 1) : uint8_t{0x80};
      bytes[mask][4 * lane + 2] = bytes[mask][4 * lane + 3] = 0x80;
      at = static_cast<uint8_t>(at + (used ? 2 : 0));
    }
  }
  return bytes;
}
#endif

// Shifts the next words into the lanes whose state is below kRansLow. Reads 2 * kWidth bytes.
HWY_INLINE V renormalise(V x, const unsigned char*& next) {
  const D d;
  const auto low = hn::Lt(x, hn::Set(d, kRansLow));
#if HWY_TARGET <= HWY_AVX3
  const hn::Rebind<uint16_t, D> d16;
  const V words = hn::PromoteTo(d, hn::LoadU(d16, reinterpret_cast<const uint16_t*>(next)));
  next += 2 * hn::CountTrue(d, low);
  // Highway 1.0 has no Expand.
  const V expanded{_mm512_maskz_expand_epi32(low.raw, words.raw)};
#else
  uint8_t mask[8];
  hn::StoreMaskBits(d, low, mask);
#if HWY_TARGET == HWY_AVX2
  static constexpr auto kRanks = make_ranks();
  const hn::Rebind<uint16_t, D> d16;
  const hn::Rebind<uint8_t, D> d8;
  const V words = hn::PromoteTo(d, hn::LoadU(d16, reinterpret_cast<const uint16_t*>(next)));
  const V ranks = hn::PromoteTo(d, hn::LoadU(d8, kRanks[mask[0]].data()));
  const V expanded = hn::TableLookupLanes(words, hn::IndicesFromVec(d, ranks));
#else
  static constexpr auto kBytes = make_bytes();
  const hn::Repartition<uint8_t, D> d8;
  const auto words = hn::ZeroExtendVector(d8, hn::LoadU(hn::Half<decltype(d8)>(), next));
  const auto bytes = hn::LoadU(d8, kBytes[mask[0]].data());
  const V expanded = hn::BitCast(d, hn::TableLookupBytesOr0(words, bytes));
#endif
  next += 2 * hwy::PopCount(mask[0]);
#endif
  return hn::IfThenElse(low, hn::Or(hn::ShiftLeft<16>(x), expanded), x);
}

// Entries of tables. Loads one by one: gather instructions take longer on most processors of today.
HWY_INLINE V look_up(const uint32_t* HWY_RESTRICT tables, V index) {
#if HWY_ARCH_X86_64 && HWY_TARGET <= HWY_AVX2
  const auto four = [&](__m128i at) HWY_ATTR {
    const uint64_t low = static_cast<uint64_t>(_mm_cvtsi128_si64(at));
    const uint64_t high = static_cast<uint64_t>(_mm_extract_epi64(at, 1));
    __m128i v = _mm_cvtsi32_si128(static_cast<int>(tables[low & 0xffffffffu]));
    v = _mm_insert_epi32(v, static_cast<int>(tables[low >> 32]), 1);
    v = _mm_insert_epi32(v, static_cast<int>(tables[high & 0xffffffffu]), 2);
    return _mm_insert_epi32(v, static_cast<int>(tables[high >> 32]), 3);
  };
  const auto eight = [&](__m256i at) HWY_ATTR {
    return _mm256_inserti128_si256(_mm256_castsi128_si256(four(_mm256_castsi256_si128(at))),
                                   four(_mm256_extracti128_si256(at, 1)), 1);
  };
#if HWY_TARGET == HWY_AVX2
  return V{eight(index.raw)};
#else
  return V{_mm512_inserti64x4(_mm512_castsi256_si512(eight(_mm512_castsi512_si256(index.raw))),
                              eight(_mm512_extracti64x4_epi64(index.raw, 1)), 1)};
#endif
#elif HWY_TARGET == HWY_WASM
  const v128_t at = index.raw;
  v128_t v = wasm_v128_load32_zero(tables + wasm_u32x4_extract_lane(at, 0));
  v = wasm_v128_load32_lane(tables + wasm_u32x4_extract_lane(at, 1), v, 1);
  v = wasm_v128_load32_lane(tables + wasm_u32x4_extract_lane(at, 2), v, 2);
  return V{wasm_v128_load32_lane(tables + wasm_u32x4_extract_lane(at, 3), v, 3)};
#else
  return hn::GatherIndex(D(), tables, hn::BitCast(hn::RebindToSigned<D>(), index));
#endif
}

// The lanes of vector v that the last `count` symbols of a channel belong to.
HWY_INLINE hn::Mask<D> active_lanes(size_t v, size_t count) {
  return hn::FirstN(D(), count < v * kWidth ? 0 : count - v * kWidth);
}

// The lanes of a page, in registers. What the compiler would declare by itself has not the
// instructions of the target.
struct Page {
  HWY_ATTR Page() {}  // NOLINT: all is loaded
  V x[kVectors];
  const unsigned char* next;
};

HWY_INLINE void load_states(const RansLanes& lanes, Page& page) {
  for (size_t v = 0; v < kVectors; ++v) page.x[v] = hn::LoadU(D(), lanes.x + v * kWidth);
  page.next = lanes.next;
}

HWY_INLINE void store_states(const Page& page, RansLanes& lanes) {
  for (size_t v = 0; v < kVectors; ++v) hn::StoreU(page.x[v], D(), lanes.x + v * kWidth);
  lanes.next = page.next;
}

// The tokens of a group of kRansLanes symbols, or of fewer, of each page: lanes from `count` on
// stay as they are, and their tokens are 0.
template <bool kContexts, bool kWhole, size_t kPages>
HWY_INLINE void take_tokens(Page (&pages)[kPages], const uint32_t* tables,
                            const uint8_t* const (&contexts)[kPages], size_t count,
                            V (&tokens)[kPages][kVectors]) {
  const D d;
  const hn::Rebind<uint8_t, D> d8;
  const V slot_mask = hn::Set(d, kRansSlots - 1);
  for (size_t p = 0; p < kPages; ++p) {
    for (size_t v = 0; v < kVectors; ++v) {
      V index = hn::And(pages[p].x[v], slot_mask);
      if (kContexts) {
        const V context = hn::PromoteTo(d, hn::LoadU(d8, contexts[p] + v * kWidth));
        index = hn::Or(index, hn::ShiftLeft<kRansScaleBits>(context));
      }
      tokens[p][v] = look_up(tables, index);
    }
  }
  for (size_t p = 0; p < kPages; ++p) {
    for (size_t v = 0; v < kVectors; ++v) {
      V& x = pages[p].x[v];
      V& token = tokens[p][v];
      // The packed frequency is one too low: frequency * high = packed * high + high.
      const V high = hn::ShiftRight<kRansScaleBits>(x);
      const V bias = hn::And(hn::ShiftRight<8>(token), slot_mask);
      const V taken = hn::Add(hn::Mul(hn::ShiftRight<20>(token), high), hn::Add(high, bias));
      token = hn::And(token, hn::Set(d, 0xff));
      if constexpr (kWhole) {
        x = renormalise(taken, pages[p].next);
      } else {
        const auto active = active_lanes(v, count);
        x = renormalise(hn::IfThenElse(active, taken, x), pages[p].next);
        token = hn::IfThenElseZero(active, token);
      }
    }
  }
}

// counts: 0..16 each. Lanes with 0 are at kRansLow or above already, so that they take no word.
HWY_INLINE V take_bits(V& x, const unsigned char*& next, V counts) {
  const D d;
  const V one = hn::Set(d, 1);
  const V bits = hn::And(x, hn::Sub(hn::Shl(one, counts), one));
  x = renormalise(hn::Shr(x, counts), next);
  return bits;
}

HWY_INLINE bool all_zero(const V (&a)[kVectors]) {
  const D d;
  V any = a[0];
  for (size_t v = 1; v < kVectors; ++v) any = hn::Or(any, a[v]);
  return hn::AllTrue(d, hn::Eq(any, hn::Zero(d)));
}

// The values of a group of symbols of each page, or of fewer; each dst has room for a group.
template <bool kContexts, bool kWhole, size_t kPages>
HWY_INLINE void hybrid_group(Page (&pages)[kPages], const uint32_t* tables,
                             const uint8_t* const (&contexts)[kPages], size_t count,
                             uint16_t* const (&dst)[kPages]) {
  const D d;
  const hn::RebindToSigned<D> di;
  const hn::Rebind<uint16_t, D> d16;
  const V one = hn::Set(d, 1);
  V values[kPages][kVectors];
  take_tokens<kContexts, kWhole>(pages, tables, contexts, count, values);
  for (size_t p = 0; p < kPages; ++p) {
    V counts[kVectors];
    for (size_t v = 0; v < kVectors; ++v) {
      // Tokens 16.. have raw bits: token / 8 - 1 of them.
      counts[v] = hn::Sub(hn::Max(hn::ShiftRight<3>(values[p][v]), one), one);
    }
    if (!all_zero(counts)) {
      for (size_t v = 0; v < kVectors; ++v) {
        // 8 + token mod 8 where there are raw bits, else the token itself.
        const V top = hn::Sub(values[p][v], hn::ShiftLeft<3>(counts[v]));
        values[p][v] =
            hn::Or(hn::Shl(top, counts[v]), take_bits(pages[p].x[v], pages[p].next, counts[v]));
      }
    }
    for (size_t v = 0; v < kVectors; ++v) {
      hn::StoreU(hn::DemoteTo(d16, hn::BitCast(di, values[p][v])), d16, dst[p] + v * kWidth);
    }
  }
}

// The symbols behind the last whole group, fewer than kRansLanes. Without contexts they have
// context 0.
HWY_NOINLINE void last_group(RansLanes& lanes, const uint32_t* tables, const uint8_t* contexts,
                             size_t n, uint16_t* dst) {
  Page page[1];
  load_states(lanes, page[0]);
  uint8_t padded[kRansLanes] = {};
  uint16_t values[kRansLanes];
  if (contexts != nullptr) std::memcpy(padded, contexts, n);
  hybrid_group<true, false>(page, tables, {padded}, n, {values});
  std::memcpy(dst, values, n * sizeof(uint16_t));
  store_states(page[0], lanes);
}

// Whole groups of pages in turns, while none can run out of words before its end, and how many
// symbols of each that were. While one page waits for its states, others have theirs. Not inlined:
// it is long where vectors are short.
template <bool kContexts, size_t kPages>
HWY_NOINLINE size_t whole_groups(const uint32_t* tables, const RansHybridTask (&tasks)[kPages]) {
  Page pages[kPages];
  const unsigned char* ends[kPages];
  size_t n = tasks[0].count;
  for (size_t p = 0; p < kPages; ++p) {
    load_states(*tasks[p].lanes, pages[p]);
    ends[p] = tasks[p].lanes->end;
    if (tasks[p].count < n) n = tasks[p].count;
  }
  size_t i = 0;
  for (; i + kRansLanes <= n; i += kRansLanes) {
    const uint8_t* contexts[kPages];
    uint16_t* dst[kPages];
    bool enough = true;
    for (size_t p = 0; p < kPages; ++p) {
      enough = enough && ends[p] - pages[p].next >= kHybridBytes;
      contexts[p] = kContexts ? tasks[p].contexts + i : nullptr;
      dst[p] = tasks[p].dst + i;
    }
    if (!enough) break;
    hybrid_group<kContexts, true>(pages, tables, contexts, kRansLanes, dst);
  }
  for (size_t p = 0; p < kPages; ++p) store_states(pages[p], *tasks[p].lanes);
  return i;
}

// Decodes symbols while they cannot run out of words before `end`, and says how many that were.
template <bool kContexts>
HWY_INLINE size_t hybrid_groups(RansLanes& lanes, const uint32_t* tables, const uint8_t* contexts,
                                size_t n, uint16_t* dst) {
  size_t i = whole_groups<kContexts>(tables, {{&lanes, contexts, n, dst}});
  if (i < n && n - i < kRansLanes && lanes.end - lanes.next >= kHybridBytes) {
    last_group(lanes, tables, kContexts ? contexts + i : nullptr, n - i, dst + i);
    i = n;
  }
  return i;
}

// The symbols that the last bytes of a block hold: from a copy of these with zeros behind, which is
// what words past the end count as.
template <bool kContexts>
HWY_NOINLINE void hybrid_end(RansLanes& lanes, const uint32_t* tables, const uint8_t* contexts,
                             size_t n, uint16_t* dst) {
  unsigned char words[2 * kHybridBytes] = {};
  const unsigned char* const from = lanes.next;
  const std::ptrdiff_t left = (lanes.end - from) & ~std::ptrdiff_t{1};
  std::memcpy(words, from, static_cast<size_t>(left));
  const unsigned char* const end = lanes.end;
  lanes.next = words;
  for (size_t i = 0; i < n; i += kRansLanes) {
    const size_t count = n - i < kRansLanes ? n - i : kRansLanes;
    lanes.end = lanes.next + kHybridBytes;
    hybrid_groups<kContexts>(lanes, tables, kContexts ? contexts + i : nullptr, count, dst + i);
    if (lanes.next - words > left) {
      lanes.failed = true;
      lanes.next = words + left;
    }
  }
  lanes.next = from + (lanes.next - words);
  lanes.end = end;
}

// Stores top << bits | high << 32 | low as 64-bit integers.
HWY_INLINE void store_wide(V top, V bits, V low, V high, uint64_t* dst) {
  const hn::Half<D> dh;
  const hn::Repartition<uint64_t, D> d64;
  const auto join = [&](auto t, auto b, auto l, auto h) {
    const auto raw = hn::Or(hn::PromoteTo(d64, l), hn::ShiftLeft<32>(hn::PromoteTo(d64, h)));
    return hn::Or(hn::Shl(hn::PromoteTo(d64, t), hn::PromoteTo(d64, b)), raw);
  };
  hn::StoreU(join(hn::LowerHalf(dh, top), hn::LowerHalf(dh, bits), hn::LowerHalf(dh, low),
                  hn::LowerHalf(dh, high)),
             d64, dst);
  hn::StoreU(join(hn::UpperHalf(dh, top), hn::UpperHalf(dh, bits), hn::UpperHalf(dh, low),
                  hn::UpperHalf(dh, high)),
             d64, dst + kWidth / 2);
}

HWY_INLINE size_t wide_groups(RansLanes& lanes, const uint32_t* tables, size_t n, uint64_t* dst) {
  const D d;
  const V one = hn::Set(d, 1);
  const V sixteen = hn::Set(d, 16);
  Page page[1];
  load_states(lanes, page[0]);
  V(&x)[kVectors] = page[0].x;
  const unsigned char*& next = page[0].next;
  size_t i = 0;
  for (; i + kRansLanes <= n && lanes.end - next >= kWideBytes; i += kRansLanes) {
    V all[1][kVectors], left[kVectors], raw[2][kVectors];
    take_tokens<false, true>(page, tables, {nullptr}, kRansLanes, all);
    const V(&tokens)[kVectors] = all[0];
    for (size_t v = 0; v < kVectors; ++v) {
      // Tokens 2.. have token / 2 - 1 raw bits.
      left[v] = hn::Sub(hn::Max(hn::ShiftRight<1>(tokens[v]), one), one);
      raw[0][v] = raw[1][v] = hn::Zero(d);
    }
    for (size_t half = 0; half < 2 && !all_zero(left); ++half) {
      for (size_t v = 0; v < kVectors; ++v) {
        const V counts = hn::Min(left[v], sixteen);
        raw[half][v] = take_bits(x[v], next, counts);
        left[v] = hn::Sub(left[v], counts);
      }
      if (all_zero(left)) break;
      for (size_t v = 0; v < kVectors; ++v) {
        const V counts = hn::Min(left[v], sixteen);
        raw[half][v] = hn::Or(raw[half][v], hn::ShiftLeft<16>(take_bits(x[v], next, counts)));
        left[v] = hn::Sub(left[v], counts);
      }
    }
    for (size_t v = 0; v < kVectors; ++v) {
      const V bits = hn::Sub(hn::Max(hn::ShiftRight<1>(tokens[v]), one), one);
      // 2 + token mod 2 where there are raw bits, else the token itself.
      const V top = hn::Sub(tokens[v], hn::ShiftLeft<1>(bits));
      store_wide(top, bits, raw[0][v], raw[1][v], dst + i + v * kWidth);
    }
  }
  store_states(page[0], lanes);
  return i;
}

template <bool kContexts>
HWY_INLINE void hybrid_of(RansLanes& lanes, const uint32_t* tables, const uint8_t* contexts,
                          size_t n, uint16_t* dst) {
  const size_t done = hybrid_groups<kContexts>(lanes, tables, contexts, n, dst);
  if (done == n) return;
  hybrid_end<kContexts>(lanes, tables, kContexts ? contexts + done : nullptr, n - done, dst + done);
}

void hybrid(RansLanes& lanes, const uint32_t* tables, const uint8_t* contexts, size_t n,
            uint16_t* dst) {
  if (contexts != nullptr) {
    hybrid_of<true>(lanes, tables, contexts, n, dst);
  } else {
    hybrid_of<false>(lanes, tables, nullptr, n, dst);
  }
}

void hybrid_pair(const uint32_t* tables, const RansHybridTask& first,
                 const RansHybridTask& second) {
  const bool contexts = first.contexts != nullptr || second.contexts != nullptr;
  const size_t done = contexts ? whole_groups<true>(tables, {first, second})
                               : whole_groups<false>(tables, {first, second});
  for (const RansHybridTask* task : {&first, &second}) {
    const uint8_t* rest = task->contexts == nullptr ? nullptr : task->contexts + done;
    hybrid(*task->lanes, tables, rest, task->count - done, task->dst + done);
  }
}

void wide(RansLanes& lanes, const uint32_t* tables, const uint8_t* contexts, size_t n,
          uint64_t* dst) {
  // No channel of wide integers has contexts (spec: "rANS pages").
  const size_t done = contexts != nullptr ? 0 : wide_groups(lanes, tables, n, dst);
  rans_kernels_reference().wide(lanes, tables, contexts != nullptr ? contexts + done : nullptr,
                                n - done, dst + done);
}

const RansKernels* kernels() {
  // Of short vectors, a page has as many as wait for each other without being late.
  if constexpr (kVectors > 4) {
    static constexpr RansKernels kKernels = {hybrid, wide, nullptr};
    return &kKernels;
  }
  static constexpr RansKernels kKernels = {hybrid, wide, hybrid_pair};
  return &kKernels;
}
#endif

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace l4d
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace l4d {
HWY_EXPORT(kernels);
const RansKernels& rans_kernels_simd() { return *HWY_DYNAMIC_DISPATCH(kernels)(); }
}  // namespace l4d
#endif
