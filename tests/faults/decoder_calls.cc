// SPDX-License-Identifier: Apache-2.0
#include "tests/faults/decoder_calls.h"

#include <algorithm>

#include "l4d/experimental/inspect.h"
#include "l4d/experimental/packed.h"

namespace l4d::test {
namespace {

constexpr double kTime = 0.05;

// What a call does not write must not pass for its result.
template <typename... Vectors>
void wipe(Vectors&... vectors) {
  (std::fill(vectors.begin(), vectors.end(), typename Vectors::value_type{7}), ...);
}

}  // namespace

const char* name_of(Call call) {
  constexpr const char* kNames[] = {"open",   "select",   "decode",       "slice",
                                    "packed", "sections", "get_codebook", "demand"};
  return kNames[static_cast<size_t>(call)];
}

DecoderCalls::DecoderCalls(const Bytes& file) : file_(file) {
  const l4d_reader reader = memory_reader(file);
  const DecoderHandle d = opened(reader, 1);
  want_.info = d.info();
  num_layers_ = want_.info.num_layers;
  const size_t n = static_cast<size_t>(want_.info.num_gaussians);
  const size_t sh = 3 * (want_.info.sh_degree + 1) * (want_.info.sh_degree + 1);
  for (Results* r : {&want_, &got_}) {
    r->position.resize(3 * n);
    r->log_scale.resize(4 * n);
    r->rotor.resize(8 * n);
    r->sh.resize(sh * n);
    r->splats.resize(3 * n);
    r->opacity.resize(n);
    r->packed.resize(3 * n);
    r->index.resize(L4D_MAX_STAGES * n);
    r->codebook.reserve(size_t{1} << 16);
  }
  for (const Call call : kCalls) {
    EXPECT_EQ(make(call, d.get(), reader), L4D_OK) << name_of(call);
  }
  std::swap(want_, got_);
  EXPECT_GT(want_.visible, 0u);
}

DecoderHandle DecoderCalls::opened(const l4d_reader& reader, uint32_t threads) const {
  const l4d_decoder_options o = decoder_options(L4D_BACKEND_AUTO, threads);
  DecoderHandle d(&o);
  d.open(reader);
  return d;
}

l4d_status DecoderCalls::make(Call call, l4d_decoder* decoder, const l4d_reader& reader) {
  const l4d_query all = all_query();
  const size_t n = got_.opacity.size();
  switch (call) {
    case Call::kOpen: {
      const l4d_status status = l4d_decoder_open(decoder, &reader);
      got_.info = L4D_INIT(l4d_info);
      const l4d_status informed = l4d_decoder_get_info(decoder, &got_.info);
      // A stream that could not be opened leaves none behind.
      EXPECT_EQ(informed, status == L4D_OK ? L4D_OK : L4D_ERR_INVALID_STATE);
      return status;
    }
    case Call::kSelect:
      got_.selection = L4D_INIT(l4d_selection);
      return l4d_decoder_select(decoder, &all, &got_.selection);
    case Call::kDecode: {
      l4d_gaussian_buffers b = L4D_INIT(l4d_gaussian_buffers);
      b.capacity = n;
      wipe(got_.position, got_.log_scale, got_.rotor, got_.sh);
      b.position = got_.position.data();
      b.log_scale = got_.log_scale.data();
      b.rotor = got_.rotor.data();
      b.sh = got_.sh.data();
      return l4d_decoder_decode(decoder, &all, &b);
    }
    case Call::kSlice: {
      l4d_splat_buffers b = L4D_INIT(l4d_splat_buffers);
      b.capacity = n;
      wipe(got_.splats, got_.opacity);
      b.position = got_.splats.data();
      b.opacity = got_.opacity.data();
      const l4d_status status = l4d_decoder_slice(decoder, kTime, &b);
      got_.visible = b.count;
      return status;
    }
    case Call::kPacked: {
      l4d_packed_buffers b = L4D_INIT(l4d_packed_buffers);
      b.capacity = n;
      wipe(got_.packed, got_.index);
      b.position = got_.packed.data();
      b.component[L4D_COMPONENT_SCALE].index = got_.index.data();
      const l4d_status status = l4d_decoder_decode_packed(decoder, &all, &b);
      got_.packed_count = b.count;
      return status;
    }
    case Call::kSections:
      wipe(got_.sections);
      return l4d_decoder_get_sections(decoder, got_.sections.data(), L4D_SECTION_COUNT, nullptr,
                                      nullptr, 0);
    case Call::kCodebooks:
      got_.codebook.clear();
      for (uint32_t l = 0; l < num_layers_; ++l) {
        for (uint32_t c = 0; c < L4D_COMPONENT_COUNT; ++c) {
          l4d_codebook codebook = L4D_INIT(l4d_codebook);
          const l4d_status status =
              l4d_decoder_get_codebook(decoder, l, c, 0, L4D_NO_BLOCK, &codebook);
          if (status != L4D_OK) return status;
          if (codebook.entries == nullptr) continue;
          const size_t size = size_t{codebook.num_entries} * codebook.dim;
          got_.codebook.insert(got_.codebook.end(), codebook.entries, codebook.entries + size);
        }
      }
      return L4D_OK;
    case Call::kStreamDemand:
      got_.demand = L4D_INIT(l4d_stream_demand);
      return l4d_decoder_get_stream_demand(decoder, &got_.demand);
  }
  return L4D_ERR_INTERNAL;
}

bool DecoderCalls::right(Call call) const {
  switch (call) {
    case Call::kOpen:
      return got_.info.num_gaussians == want_.info.num_gaussians;
    case Call::kSelect:
      return got_.selection.bytes == want_.selection.bytes;
    case Call::kDecode:
      return same_bits("position", want_.position, got_.position) &&
             same_bits("log_scale", want_.log_scale, got_.log_scale) &&
             same_bits("rotor", want_.rotor, got_.rotor) && same_bits("sh", want_.sh, got_.sh);
    case Call::kSlice:
      return got_.visible == want_.visible && same_bits("splats", want_.splats, got_.splats) &&
             same_bits("opacity", want_.opacity, got_.opacity);
    case Call::kPacked:
      return got_.packed == want_.packed && got_.index == want_.index &&
             got_.packed_count == want_.packed_count;
    case Call::kSections:
      return got_.sections == want_.sections;
    case Call::kCodebooks:
      return same_bits("codebooks", want_.codebook, got_.codebook);
    case Call::kStreamDemand:
      return got_.demand.instant_bytes == want_.demand.instant_bytes &&
             got_.demand.memory_bytes == want_.demand.memory_bytes &&
             got_.demand.start_bytes == want_.demand.start_bytes;
  }
  return false;
}

}  // namespace l4d::test
