// SPDX-License-Identifier: Apache-2.0
#include "tests/hostile/session.h"

#include <algorithm>
#include <cstdlib>
#include <memory>

#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"
#include "libl4dcodec/base/hash.h"

namespace l4d::test {
namespace {

constexpr size_t kFloats = 3 + 1 + 1 + 4 + 8 + 1 + 48;  // of a Gaussian at SH degree 3
constexpr size_t kMaxRanges = 4096;

struct Destroy {
  void operator()(l4d_decoder* d) const { l4d_decoder_destroy(d); }
};
using Handle = std::unique_ptr<l4d_decoder, Destroy>;

Handle make_decoder() {
  const l4d_decoder_options options = session_options();
  l4d_decoder* decoder = nullptr;
  if (l4d_decoder_create(&options, &decoder) != L4D_OK) std::abort();
  return Handle(decoder);
}

uint32_t detail_of(uint32_t choice) {
  return choice % 7 == 3 ? L4D_DETAIL_BASE_COLOR : L4D_DETAIL_FULL;
}

l4d_query query_of(const l4d_info& info, uint32_t choice) {
  l4d_query query = L4D_INIT(l4d_query);
  query.point.detail = detail_of(choice);
  query.kind = choice % 3;
  query.point.levels = choice / 3 % 4 == 3 ? choice % 5 + 1 : 0;
  const double unit = info.duration / 16;
  query.time_begin = info.timeline.time_begin + unit * (choice / 12 % 20) - 2 * unit;
  query.time_end = query.time_begin + unit * (choice / 240 % 8);
  return query;
}

}  // namespace

l4d_decoder_options session_options() {
  l4d_decoder_options options = L4D_INIT(l4d_decoder_options);
  options.accept_needs = 1;
  options.threads = 1;
  options.max_memory_bytes = kSessionMemory;
  options.max_gaussians = kSessionGaussians;
  options.cache_bytes = kSessionMemory / 4;
  return options;
}

Session::Session()
    : floats_(kFloats * kSessionGaussians),
      halves_((6 + L4D_COMPONENT_COUNT * (L4D_MAX_STAGES + 48)) * kSessionGaussians),
      bytes_(kSessionGaussians),
      ranges_(kMaxRanges) {}

l4d_status Session::decode(l4d_decoder* decoder, const l4d_query& query, bool some_arrays,
                           uint64_t* digest) {
  l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
  const size_t n = kSessionGaussians;
  float* at = floats_.data();
  const auto next = [&](size_t dim) {
    float* array = at;
    at += dim * n;
    return array;
  };
  b.capacity = n;
  b.position = next(3);
  b.mean_t = next(1);
  b.mean_t_local = next(1);
  b.log_scale = next(4);
  b.rotor = next(8);
  b.opacity = next(1);
  b.sh = next(48);
  if (some_arrays) b.position = b.log_scale = b.sh = nullptr;
  b.spans = ranges_.data();
  b.span_capacity = ranges_.size();
  if (digest != nullptr) std::fill(floats_.begin(), floats_.end(), 0.0f);
  const l4d_status status = l4d_decoder_decode(decoder, &query, &b);
  if (status == L4D_OK && b.count > n) std::abort();
  if (digest != nullptr) {
    *digest = hash64(ByteSpan(reinterpret_cast<const unsigned char*>(floats_.data()),
                              floats_.size() * sizeof(float))) ^
              b.count;
  }
  return status;
}

l4d_status Session::decode_all(const Bytes& file, uint64_t* digest) {
  const Handle decoder = make_decoder();
  const l4d_status opened = l4d_decoder_open_memory(decoder.get(), file.data(), file.size());
  if (opened != L4D_OK) return opened;
  l4d_query all = L4D_INIT(l4d_query);
  return decode(decoder.get(), all, false, digest);
}

// What a player does: learns which buckets it needs, and decodes some of them.
l4d_status Session::decode_buckets(l4d_decoder* decoder, l4d_query query, uint32_t choice) {
  query.whole_buckets = choice & 1;
  uint64_t count = 0;
  const l4d_status status =
      l4d_decoder_get_spans(decoder, &query, ranges_.data(), ranges_.size(), &count);
  if (status != L4D_OK) return status;
  std::vector<l4d_bucket> buckets;
  for (size_t i = 0; i < std::min<uint64_t>(count, ranges_.size()); i += 1 + choice / 2 % 3) {
    buckets.push_back({ranges_[i].layer, ranges_[i].bucket});
  }
  query.kind = L4D_QUERY_BUCKETS;
  query.buckets = buckets.data();
  query.num_buckets = buckets.size();
  return decode(decoder, query, choice % 5 == 1, nullptr);
}

l4d_status Session::step(l4d_decoder* decoder, Step step, uint32_t choice) {
  l4d_info info = L4D_INIT(l4d_info);
  const l4d_status told = l4d_decoder_get_info(decoder, &info);
  if (told != L4D_OK) return told;
  if (info.num_gaussians > kSessionGaussians) std::abort();  // the limit was not honoured
  const l4d_query query = query_of(info, choice);
  const size_t n = kSessionGaussians;
  switch (step) {
    case Step::kSelect: {
      l4d_selection selection = L4D_INIT(l4d_selection);
      const l4d_status status = l4d_decoder_select(decoder, &query, &selection);
      if (status == L4D_OK && selection.num_gaussians > info.num_gaussians) std::abort();
      return status;
    }
    case Step::kDecode:
      return decode(decoder, query, choice % 7 == 6, nullptr);
    case Step::kPacked: {
      l4d_packed_buffers b = L4D_INIT(l4d_packed_buffers);
      b.capacity = n;
      uint16_t* at = halves_.data();
      const auto next = [&](size_t dim) {
        uint16_t* array = at;
        at += dim * n;
        return array;
      };
      b.position = next(3);
      b.mean_t = next(1);
      b.opacity = next(1);
      b.scale_factor = next(1);
      for (l4d_packed_component& c : b.component) {
        c.depth = bytes_.data();
        c.index = next(L4D_MAX_STAGES);
        c.escape = next(48);
        c.escape_capacity = n;
      }
      return l4d_decoder_decode_packed(decoder, &query, &b);
    }
    case Step::kSlice: {
      l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
      b.capacity = n;
      b.position = floats_.data();
      b.covariance = b.position + 3 * n;
      b.opacity = b.covariance + 6 * n;
      b.sh = b.opacity + n;
      b.point.detail = detail_of(choice);
      const l4d_status status = l4d_decoder_slice(decoder, query.time_begin, &b);
      if (status == L4D_OK && b.count > n) std::abort();
      return status;
    }
    case Step::kSections: {
      uint64_t sections[L4D_SECTION_COUNT];
      const l4d_status status =
          l4d_decoder_get_sections(decoder, sections, L4D_SECTION_COUNT, nullptr, nullptr, 0);
      l4d_stream_demand demand = L4D_INIT(l4d_stream_demand);
      demand.bytes_per_second = choice;
      const l4d_status measured = l4d_decoder_get_stream_demand(decoder, &demand);
      return status != L4D_OK ? status : measured;
    }
    case Step::kCodebook: {
      l4d_codebook codebook = L4D_INIT(l4d_codebook);
      const uint32_t block = choice % 3 == 0 ? 0 : L4D_NO_BLOCK;
      const l4d_status status = l4d_decoder_get_codebook(decoder, choice / 3 % 4, choice / 12 % 4,
                                                         choice / 48 % 3, block, &codebook);
      float sum = 0;
      for (size_t i = 0; status == L4D_OK && i < size_t{codebook.num_entries} * codebook.dim; ++i) {
        sum += codebook.entries[i];
      }
      floats_[0] = sum;
      return status;
    }
    case Step::kInfo: {
      l4d_layer_info layer = L4D_INIT(l4d_layer_info);
      const l4d_status status = l4d_decoder_get_layer_info(decoder, choice % 8, &layer);
      if (status != L4D_OK) return status;
      l4d_dequantization d = L4D_INIT(l4d_dequantization);
      return l4d_decoder_get_dequantization(decoder, choice % 8, &d);
    }
    case Step::kBuckets:
      return decode_buckets(decoder, query, choice);
    case Step::kCount:
      break;
  }
  return L4D_OK;
}

l4d_status Session::use(const Bytes& file) {
  const Handle decoder = make_decoder();
  const l4d_status opened = l4d_decoder_open_memory(decoder.get(), file.data(), file.size());
  if (opened != L4D_OK) return opened;
  const l4d_status status = step(decoder.get(), Step::kDecode, 0);
  (void)step(decoder.get(), Step::kDecode, 3);  // base colours
  (void)step(decoder.get(), Step::kSlice, 12 * 10);
  (void)step(decoder.get(), Step::kSlice, 12 * 10 + 2);
  (void)step(decoder.get(), Step::kPacked, 0);
  (void)step(decoder.get(), Step::kSections, 0);
  (void)step(decoder.get(), Step::kSelect, 12 * 5 + 1);
  for (const uint32_t choice : {0u, 12u, 15u, 27u}) {
    (void)step(decoder.get(), Step::kCodebook, choice);
  }
  (void)step(decoder.get(), Step::kDecode, 12 * 7 + 240 * 2 + 2);
  (void)step(decoder.get(), Step::kInfo, 1);
  (void)step(decoder.get(), Step::kBuckets, 0);
  (void)step(decoder.get(), Step::kBuckets, 12 * 5 + 3);
  return status;
}

}  // namespace l4d::test
