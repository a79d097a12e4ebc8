// SPDX-License-Identifier: Apache-2.0
#include <sstream>

#include "libl4dcodec/base/ordered.h"
#include "tests/kernels/kernel_call.h"

namespace l4d::test {

std::string CallOptions::text() const {
  static constexpr const char* kNames[] = {"random", "low", "high", "edges"};
  std::ostringstream s;
  s << "n " << n << ", fill " << kNames[static_cast<int>(fill)] << ", offset " << offset
    << ", past_cache " << past_cache << ", seed " << seed;
  return s.str();
}

std::vector<uint16_t> integers(const CallOptions& options, size_t n, unsigned width) {
  Random random(options.seed + width);
  const uint32_t limit = 1u << width;
  std::vector<uint16_t> v(n);
  for (uint16_t& x : v) {
    switch (options.fill) {
      case Fill::kRandom:
        x = static_cast<uint16_t>(random.below(limit));
        break;
      case Fill::kLow:
        x = static_cast<uint16_t>(random.below(8) == 0 ? random.below(2) : 0);
        break;
      case Fill::kHigh:
        x = static_cast<uint16_t>(limit - 1 - (random.below(8) == 0 ? random.below(2) : 0));
        break;
      case Fill::kEdges: {
        const uint32_t edges[] = {0, 1, limit / 2 - 1, limit / 2, limit - 2, limit - 1};
        x = static_cast<uint16_t>(edges[random.below(6)] & (limit - 1));
        break;
      }
    }
  }
  return v;
}

std::vector<uint16_t> halves(const CallOptions& options, size_t n) {
  Random random(options.seed + 99);
  static constexpr uint16_t kEdges[] = {0x0000, 0x8000, 0x0001, 0x8001, 0x03ff, 0x83ff,
                                        0x0400, 0x8400, 0x7bff, 0xfbff, 0x3c00, 0xbc00};
  std::vector<uint16_t> v(n);
  for (uint16_t& x : v) {
    const uint16_t bits = static_cast<uint16_t>(random.bits());
    switch (options.fill) {
      case Fill::kRandom:
        x = half_is_finite(bits) ? bits : static_cast<uint16_t>(bits & 0xbfffu);
        break;
      case Fill::kLow:  // zeros and subnormals
        x = static_cast<uint16_t>(bits & 0x83ffu);
        break;
      case Fill::kHigh:
        x = static_cast<uint16_t>((bits & 0x83ffu) | 0x7800u);
        break;
      case Fill::kEdges:
        x = kEdges[random.below(12)];
        break;
    }
  }
  return v;
}

namespace {

template <unsigned kWidth>
std::unique_ptr<Call> make_unpack(const CallOptions& o) {
  const auto values = integers(o, o.n, kWidth);
  // Exactly the bytes needed, or more: what lies behind them must not matter.
  const size_t extra = o.seed % 3;
  std::vector<unsigned char> packed((o.n * kWidth + 7) / 8 + extra, 0);
  for (size_t i = 0; i < values.size(); ++i) {
    for (unsigned b = 0; b < kWidth; ++b) {
      const size_t bit = i * kWidth + b;
      packed[bit / 8] =
          static_cast<unsigned char>(packed[bit / 8] | (values[i] >> b & 1) << (bit % 8));
    }
  }
  for (size_t i = 0; i < extra; ++i) packed[packed.size() - 1 - i] = 0xff;
  return std::make_unique<ArrayCall<uint16_t>>(
      o.n, o.offset, std::vector<uint16_t>(),
      [packed, n = o.n](const Kernels& k, uint16_t* out) -> uint64_t {
        k.stream->unpack_bits(packed.data(), packed.size(), n, kWidth, out);
        return 0;
      });
}

std::vector<unsigned char> bytes_of(const CallOptions& o, uint64_t salt) {
  CallOptions salted = o;
  salted.seed += salt;
  const auto v = integers(salted, o.n + o.offset, 8);
  return std::vector<unsigned char>(v.begin(), v.end());
}

std::unique_ptr<Call> make_merge(const CallOptions& o) {
  return std::make_unique<ArrayCall<uint16_t>>(
      o.n, o.offset, std::vector<uint16_t>(),
      [low = bytes_of(o, 1), high = bytes_of(o, 2), o](const Kernels& k,
                                                       uint16_t* out) -> uint64_t {
        k.stream->merge_bytes(low.data() + o.offset, high.data() + o.offset, o.n, out);
        return 0;
      });
}

std::unique_ptr<Call> make_widen(const CallOptions& o) {
  return std::make_unique<ArrayCall<uint16_t>>(
      o.n, o.offset, std::vector<uint16_t>(),
      [src = bytes_of(o, 3), o](const Kernels& k, uint16_t* out) -> uint64_t {
        k.stream->widen_bytes(src.data() + o.offset, o.n, out);
        return 0;
      });
}

std::unique_ptr<Call> make_undelta(const CallOptions& o) {
  return std::make_unique<ArrayCall<uint16_t>>(
      o.n, o.offset, integers(o, o.n, 16), [n = o.n](const Kernels& k, uint16_t* out) -> uint64_t {
        k.stream->undelta(out, n);
        return 0;
      });
}

// All 16-bit patterns, also those of infinities and NaN: finding them is this kernel's task.
std::unique_ptr<Call> make_unorder(const CallOptions& o) {
  return std::make_unique<ArrayCall<uint16_t>>(
      o.n, o.offset, integers(o, o.n, 16), [n = o.n](const Kernels& k, uint16_t* out) -> uint64_t {
        return k.stream->unorder_halves(out, n);
      });
}

std::unique_ptr<Call> make_max(const CallOptions& o) {
  return std::make_unique<ArrayCall<uint16_t>>(
      o.n, o.offset, integers(o, o.n, 16), [n = o.n](const Kernels& k, uint16_t* out) -> uint64_t {
        return k.stream->max_value(out, n);
      });
}

std::unique_ptr<Call> make_split_morton(const CallOptions& o) {
  std::vector<uint64_t> codes(o.n + o.offset, 0);
  for (unsigned part = 0; part < 4; ++part) {
    CallOptions salted = o;
    salted.seed += part;
    const auto bits = integers(salted, codes.size(), 16);
    for (size_t i = 0; i < codes.size(); ++i) codes[i] |= uint64_t{bits[i]} << (16 * part);
  }
  for (uint64_t& code : codes) code &= ~uint64_t{0} >> 1;
  return std::make_unique<ArrayCall<uint32_t>>(
      3 * o.n, o.offset, std::vector<uint32_t>(),
      [codes, o](const Kernels& k, uint32_t* out) -> uint64_t {
        uint32_t* const columns[3] = {out, out + o.n, out + 2 * o.n};
        k.stream->split_morton(codes.data() + o.offset, o.n, columns);
        return 0;
      });
}

std::unique_ptr<Call> make_unzigzag(const CallOptions& o) {
  return std::make_unique<ArrayCall<uint16_t>>(
      o.n + (o.n + 1) / 2, o.offset, std::vector<uint16_t>(),
      [codes = integers(o, o.n + o.offset, 16), o](const Kernels& k, uint16_t* out) -> uint64_t {
        k.stream->unzigzag(codes.data() + o.offset, o.n, reinterpret_cast<int16_t*>(out),
                           reinterpret_cast<uint8_t*>(out + o.n));
        return 0;
      });
}

std::vector<uint8_t> small_bytes(const CallOptions& o, uint64_t salt, unsigned width) {
  CallOptions salted = o;
  salted.seed += salt;
  const auto v = integers(salted, o.n + o.offset, width);
  return std::vector<uint8_t>(v.begin(), v.end());
}

std::unique_ptr<Call> make_contexts(const CallOptions& o) {
  return std::make_unique<ArrayCall<uint8_t>>(
      o.n, o.offset, std::vector<uint8_t>(),
      [step_exponent = small_bytes(o, 1, 4), last = small_bytes(o, 2, 4),
       before = small_bytes(o, 3, 4), o](const Kernels& k, uint8_t* out) -> uint64_t {
        k.stream->coefficient_contexts(step_exponent.data() + o.offset, last.data() + o.offset,
                                       before.data() + o.offset, o.n, out);
        return 0;
      });
}

// Also in place, where results have to be indices again, so that calls can be repeated.
template <unsigned kEntries, bool kInPlace>
std::unique_ptr<Call> make_map(const CallOptions& o) {
  Random random(o.seed);
  std::vector<uint8_t> map((kEntries + 15) / 16 * 16);
  for (uint8_t& v : map) v = static_cast<uint8_t>(random.below(kInPlace ? kEntries : 256));
  std::vector<uint8_t> src = small_bytes(o, 1, 7);
  for (uint8_t& v : src) v = static_cast<uint8_t>(v % kEntries);
  std::vector<uint8_t> content;
  if (kInPlace) content.assign(src.begin() + static_cast<std::ptrdiff_t>(o.offset), src.end());
  return std::make_unique<ArrayCall<uint8_t>>(
      o.n, o.offset, content, [map, src, o](const Kernels& k, uint8_t* out) -> uint64_t {
        k.stream->map_bytes(map.data(), kEntries, kInPlace ? out : src.data() + o.offset, o.n, out);
        return 0;
      });
}

std::unique_ptr<Call> make_keep(const CallOptions& o) {
  constexpr size_t kArrays = 3;
  std::vector<uint8_t> content = small_bytes(o, 1, 2);
  content.resize(o.n);
  for (size_t a = 1; a < kArrays; ++a) {
    const std::vector<uint8_t> more = small_bytes(o, 1 + a, 8);
    content.insert(content.end(), more.begin(), more.begin() + static_cast<std::ptrdiff_t>(o.n));
  }
  return std::make_unique<ArrayCall<uint8_t>>(
      kArrays * o.n, o.offset, content, [o](const Kernels& k, uint8_t* out) -> uint64_t {
        uint8_t* const arrays[kArrays] = {out, out + o.n, out + 2 * o.n};
        const size_t kept = k.stream->keep_above(arrays, kArrays, o.n, 1);
        for (uint8_t* array : arrays) std::memset(array + kept, 0, o.n - kept);
        return kept;
      });
}

}  // namespace

const std::vector<Operation>& stream_operations() {
  static const std::vector<Operation> kOperations = {{"unpack_bits_1", make_unpack<1>},
                                                     {"unpack_bits_2", make_unpack<2>},
                                                     {"unpack_bits_3", make_unpack<3>},
                                                     {"unpack_bits_4", make_unpack<4>},
                                                     {"unpack_bits_5", make_unpack<5>},
                                                     {"unpack_bits_6", make_unpack<6>},
                                                     {"unpack_bits_7", make_unpack<7>},
                                                     {"unpack_bits_8", make_unpack<8>},
                                                     {"unpack_bits_9", make_unpack<9>},
                                                     {"unpack_bits_10", make_unpack<10>},
                                                     {"unpack_bits_11", make_unpack<11>},
                                                     {"unpack_bits_12", make_unpack<12>},
                                                     {"unpack_bits_13", make_unpack<13>},
                                                     {"unpack_bits_14", make_unpack<14>},
                                                     {"unpack_bits_15", make_unpack<15>},
                                                     {"unpack_bits_16", make_unpack<16>},
                                                     {"merge_bytes", make_merge},
                                                     {"widen_bytes", make_widen},
                                                     {"undelta", make_undelta},
                                                     {"unorder_halves", make_unorder},
                                                     {"max_value", make_max},
                                                     {"split_morton", make_split_morton},
                                                     {"unzigzag", make_unzigzag},
                                                     {"coefficient_contexts", make_contexts},
                                                     {"map_bytes_5", make_map<5, false>},
                                                     {"map_bytes_80", make_map<80, true>},
                                                     {"map_bytes_128", make_map<128, false>},
                                                     {"keep_above", make_keep}};
  return kOperations;
}

}  // namespace l4d::test
