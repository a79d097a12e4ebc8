// SPDX-License-Identifier: Apache-2.0
// Channels of 12-bit codebook indices, ranked by use: rANS against zstd, which gets them as two
// byte planes. Pages of 4096 symbols, ten channels to a block under one table.
#include <benchmark/benchmark.h>
#include <hwy/highway.h>
#include <hwy/targets.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "encoder/search/random.h"
#include "libl4dcodec/entropy/rans_encoder.h"
#include "libl4dcodec/entropy/stream_kernels.h"
#include "libl4dcodec/entropy/zstd_codec.h"

namespace l4d {
namespace {

constexpr size_t kEntries = 4096, kChannel = 4096, kChannels = 10, kBlocks = 16;
constexpr size_t kSymbols = kChannel * kChannels * kBlocks;

struct Channels {
  std::vector<uint16_t> values;  // [kBlocks, kChannels, kChannel]
  double entropy_bytes = 0;      // order 0
};

// Ranks of a geometric distribution with the given mean, cut off at kEntries.
Channels make_channels(double mean) {
  Channels channels;
  Random random(1);
  std::vector<double> counts(kEntries, 0);
  while (channels.values.size() < kSymbols) {
    const double rank = -mean * std::log(1 - random.uniform());
    if (rank >= static_cast<double>(kEntries)) continue;
    channels.values.push_back(static_cast<uint16_t>(rank));
    ++counts[channels.values.back()];
  }
  for (const double count : counts) {
    if (count > 0) channels.entropy_bytes += count * std::log2(kSymbols / count) / 8;
  }
  return channels;
}

const Channels& channels(int64_t mean) {
  static const Channels skewed = make_channels(100);
  static const Channels mild = make_channels(700);
  static const Channels flat = make_channels(2500);
  return mean == 100 ? skewed : mean == 700 ? mild : flat;
}

RansTable table_of(const std::vector<uint16_t>& values) {
  std::vector<uint64_t> counts(kRansHybridTokens, 0);
  for (const uint16_t value : values) ++counts[hybrid_token(value).token];
  return RansTable(counts);
}

std::vector<Bytes> encode_blocks(const std::vector<uint16_t>& values, const RansTable& table) {
  std::vector<Bytes> blocks(kBlocks);
  RansBlockWriter writer;
  for (size_t b = 0; b < kBlocks; ++b) {
    for (size_t p = 0; p < kChannels; ++p) {
      const uint16_t* channel = values.data() + (b * kChannels + p) * kChannel;
      writer.add_hybrid(&table, nullptr, Span<const uint16_t>(channel, kChannel));
    }
    writer.finish(blocks[b]);
  }
  return blocks;
}

void report(benchmark::State& state, double bytes, double entropy_bytes) {
  const double symbols = static_cast<double>(state.iterations()) * kSymbols;
  state.counters["sym/s"] = benchmark::Counter(symbols, benchmark::Counter::kIsRate);
  state.counters["bits/sym"] = bytes * 8 / kSymbols;
  state.counters["over_H0_%"] = (bytes / entropy_bytes - 1) * 100;
}

double rans_bytes(const std::vector<Bytes>& blocks, const RansTable& table) {
  Bytes all;
  table.append_to(all);
  size_t bytes = all.size();
  for (const Bytes& block : blocks) bytes += block.size();
  return static_cast<double>(bytes);
}

void rans_encode(benchmark::State& state) {
  const Channels& p = channels(state.range(0));
  std::vector<Bytes> blocks;
  for (auto _ : state) {
    const RansTable table = table_of(p.values);
    blocks = encode_blocks(p.values, table);
    benchmark::DoNotOptimize(blocks.data());
  }
  report(state, rans_bytes(blocks, table_of(p.values)), p.entropy_bytes);
}

// target: a bit of Highway's, 0 = the reference loops. Null where this machine lacks it.
const RansKernels* kernels_of(int64_t target) {
  hwy::SetSupportedTargetsForTest(0);
  if (target == 0) return &rans_kernels_reference();
  if ((hwy::SupportedTargets() & target) == 0) return nullptr;
  hwy::SetSupportedTargetsForTest(target);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  const RansKernels* kernels = &rans_kernels_simd();
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  return kernels;
}

void rans_decode(benchmark::State& state, int64_t target) {
  const Channels& p = channels(state.range(0));
  const RansKernels* kernels = kernels_of(target);
  if (kernels == nullptr) {
    state.SkipWithError("not available on this machine");
    return;
  }
  const RansTable table = table_of(p.values);
  const std::vector<Bytes> blocks = encode_blocks(p.values, table);
  std::vector<uint32_t> entries(kRansSlots);
  table.expand(entries.data());
  std::vector<uint16_t> page(kChannel * kChannels);
  for (auto _ : state) {
    for (const Bytes& block : blocks) {
      RansLanes lanes;
      if (!open_rans_block(block, 0, &lanes).ok()) state.SkipWithError("block refused");
      for (size_t k = 0; k < kChannels; ++k) {
        kernels->hybrid(lanes, entries.data(), nullptr, kChannel, page.data() + k * kChannel);
      }
      if (!rans_block_finished(lanes)) state.SkipWithError("block damaged");
      benchmark::DoNotOptimize(page.data());
    }
  }
  if (!std::equal(page.begin(), page.end(), p.values.end() - kChannel * kChannels)) {
    state.SkipWithError("other values");
  }
  report(state, rans_bytes(blocks, table), p.entropy_bytes);
}

// Gaps of sorted 48-bit codes: geometric, with means from 2^8 to 2^30.
void rans_decode_gaps(benchmark::State& state, int64_t target) {
  const RansKernels* kernels = kernels_of(target);
  if (kernels == nullptr) {
    state.SkipWithError("not available on this machine");
    return;
  }
  Random random(2);
  std::vector<uint64_t> values(kSymbols / kBlocks), got(values.size());
  std::vector<uint64_t> counts(kRansWideTokens, 0);
  for (uint64_t& value : values) {
    const double mean = std::exp2(8 + 22 * random.uniform());
    value = static_cast<uint64_t>(-mean * std::log(1 - random.uniform()));
    ++counts[wide_token(value).token];
  }
  const RansTable table(counts);
  std::vector<uint32_t> entries(kRansSlots);
  table.expand(entries.data());
  RansBlockWriter writer;
  writer.add_wide(&table, nullptr, values);
  Bytes block;
  writer.finish(block);
  for (auto _ : state) {
    RansLanes lanes;
    if (!open_rans_block(block, 0, &lanes).ok()) state.SkipWithError("block refused");
    kernels->wide(lanes, entries.data(), nullptr, got.size(), got.data());
    benchmark::DoNotOptimize(got.data());
  }
  if (got != values) state.SkipWithError("other values");
  const double symbols =
      static_cast<double>(state.iterations()) * static_cast<double>(values.size());
  state.counters["sym/s"] = benchmark::Counter(symbols, benchmark::Counter::kIsRate);
  state.counters["bits/sym"] =
      static_cast<double>(block.size() * 8) / static_cast<double>(values.size());
}

// The two byte planes of each block.
std::vector<Bytes> zstd_blocks(const std::vector<uint16_t>& values, ZstdCompressor& zstd) {
  constexpr size_t kBlock = kChannel * kChannels;
  std::vector<Bytes> frames;
  Bytes plane(kBlock);
  for (size_t b = 0; b < kBlocks; ++b) {
    for (unsigned shift = 0; shift < 16; shift += 8) {
      for (size_t i = 0; i < kBlock; ++i) {
        plane[i] = static_cast<unsigned char>(values[b * kBlock + i] >> shift);
      }
      frames.push_back(zstd.compress(plane));
    }
  }
  return frames;
}

double total(const std::vector<Bytes>& frames) {
  size_t bytes = 0;
  for (const Bytes& frame : frames) bytes += frame.size();
  return static_cast<double>(bytes);
}

void zstd_encode(benchmark::State& state) {
  const Channels& p = channels(state.range(0));
  ZstdCompressor zstd(static_cast<int>(state.range(1)));
  std::vector<Bytes> frames;
  for (auto _ : state) frames = zstd_blocks(p.values, zstd);
  report(state, total(frames), p.entropy_bytes);
}

void zstd_decode(benchmark::State& state) {
  const Channels& p = channels(state.range(0));
  ZstdCompressor compressor(static_cast<int>(state.range(1)));
  const std::vector<Bytes> frames = zstd_blocks(p.values, compressor);
  constexpr size_t kBlock = kChannel * kChannels;
  ZstdDecompressor zstd;
  Bytes low(kBlock), high(kBlock);
  std::vector<uint16_t> page(kBlock);
  for (auto _ : state) {
    for (size_t b = 0; b < kBlocks; ++b) {
      if (!zstd.decompress(frames[2 * b], low.data(), kBlock) ||
          !zstd.decompress(frames[2 * b + 1], high.data(), kBlock)) {
        state.SkipWithError("frame refused");
      }
      stream_kernels_simd().merge_bytes(low.data(), high.data(), kBlock, page.data());
      benchmark::DoNotOptimize(page.data());
    }
  }
  report(state, total(frames), p.entropy_bytes);
}

void means(benchmark::internal::Benchmark* bench) {
  bench->ArgName("mean")->Arg(100)->Arg(700)->Arg(2500)->Unit(benchmark::kMillisecond);
}
void means_and_levels(benchmark::internal::Benchmark* bench) {
  bench->ArgNames({"mean", "level"})->ArgsProduct({{100, 700, 2500}, {3, 19}});
  bench->Unit(benchmark::kMillisecond);
}

BENCHMARK_CAPTURE(rans_decode, reference, 0)->Apply(means);
BENCHMARK_CAPTURE(rans_decode, ssse3, HWY_SSSE3)->Apply(means);
BENCHMARK_CAPTURE(rans_decode, avx2, HWY_AVX2)->Apply(means);
BENCHMARK_CAPTURE(rans_decode, avx512, HWY_AVX3)->Apply(means);
BENCHMARK_CAPTURE(rans_decode_gaps, reference, 0);
BENCHMARK_CAPTURE(rans_decode_gaps, ssse3, HWY_SSSE3);
BENCHMARK_CAPTURE(rans_decode_gaps, avx2, HWY_AVX2);
BENCHMARK_CAPTURE(rans_decode_gaps, avx512, HWY_AVX3);
BENCHMARK(zstd_decode)->Apply(means_and_levels);
BENCHMARK(rans_encode)->Apply(means);
BENCHMARK(zstd_encode)->Apply(means_and_levels);

}  // namespace
}  // namespace l4d
