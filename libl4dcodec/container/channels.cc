// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/channels.h"

#include <algorithm>

namespace l4d {
namespace {

void add_component(const ComponentCoding& coding, unsigned c, unsigned dim,
                   std::vector<ChannelSpec>* channels) {
  const auto add = [&](ChannelKind kind, size_t index, unsigned contexts) {
    channels->push_back({kind, static_cast<uint8_t>(c), static_cast<uint8_t>(index),
                         static_cast<uint8_t>(contexts)});
  };
  if (coding.vq()) {
    if (coding.has_depth()) add(ChannelKind::kDepth, 0, 1);
    for (size_t s = 0; s < coding.stages.size(); ++s) add(ChannelKind::kIndex, s, 1);
    for (unsigned k = 0; coding.escapes && k < dim; ++k) add(ChannelKind::kEscape, k, 1);
  }
  if (coding.transform()) {
    add(ChannelKind::kStepExponent, 0, kTransformStepExponents);
    if (coding.eob_table.size() > 1) add(ChannelKind::kEobIndex, 0, kTransformStepExponents);
    for (unsigned k = 0; k < coding.coefficients(); ++k) {
      add(ChannelKind::kCoefficient, k, kTransformStepExponents * (k == 0 ? 1 : kMagnitudes));
    }
  }
}

uint64_t num_contexts(const std::vector<ChannelSpec>& channels) {
  uint64_t sum = 0;
  for (const ChannelSpec& p : channels) sum += p.contexts;
  return sum;
}

}  // namespace

std::vector<ChannelSpec> page_channels(const SceneHeader& header, const LayerHeader& layer) {
  std::vector<ChannelSpec> channels;
  channels.push_back({ChannelKind::kPosition, 0, 0, 1});
  if (layer.has_mean_codes()) channels.push_back({ChannelKind::kMeanT, 0, 0, 1});
  if (layer.mean_t_fine) channels.push_back({ChannelKind::kMeanTFine, 0, 0, 1});
  for (size_t k = 0; k < kWindowColumns; ++k) {
    if (layer.window_width(k) > 0) {
      channels.push_back({ChannelKind::kWindow, 0, static_cast<uint8_t>(k), 1});
    }
  }
  if (header.opacity.coding == ScalarCodingId::kSq) {
    channels.push_back({ChannelKind::kOpacity, 0, 0, 1});
  }
  if (layer.scale_factor.coding == ScalarCodingId::kSq) {
    channels.push_back({ChannelKind::kScaleFactor, 0, 0, 1});
  }
  for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
    add_component(layer.component[c], c, header.component_dim(layer, c), &channels);
  }
  add_component(header.sh, L4D_COMPONENT_SH, header.sh_dim(), &channels);
  return channels;
}

size_t first_detail_channel(const SceneHeader& header, const std::vector<ChannelSpec>& channels) {
  const auto is_detail = [&](const ChannelSpec& p) {
    if (p.kind < ChannelKind::kDepth || p.component != L4D_COMPONENT_SH) return false;
    return header.sh_base == 0 ||
           (p.kind == ChannelKind::kCoefficient && p.index >= header.sh_base);
  };
  return static_cast<size_t>(std::find_if(channels.begin(), channels.end(), is_detail) -
                             channels.begin());
}

uint64_t most_symbols(const SceneHeader& header, const LayerHeader& layer) {
  if (!layer.has_entropy) return 0;
  if (layer.symbols_per_gaussian != 0) return layer.symbols_per_gaussian;
  return page_channels(header, layer).size();
}

bool rans_codable(const SceneHeader& header, const LayerHeader& layer) {
  if (header.position_of(layer) == CoordinateCodingId::kRaw32 || layer.has_raw_means() ||
      header.opacity.coding == ScalarCodingId::kRaw32 ||
      layer.scale_factor.coding == ScalarCodingId::kRaw32) {
    return false;
  }
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (header.component(layer, c).coding == ComponentCodingId::kRaw32) return false;
  }
  return true;
}

uint64_t EntropyTables::memory_bytes() const {
  return entries.size() * sizeof(uint32_t) + channels.size() * sizeof(ChannelSpec) +
         num_contexts(channels);
}

uint64_t max_entropy_bytes(const std::vector<ChannelSpec>& channels) {
  // Token counts and frequencies take at most two bytes each.
  return 2 + kMaxEntropyTables * 2 * (1 + kRansMaxTokens) + num_contexts(channels);
}

uint64_t entropy_memory(ByteSpan raw, const std::vector<ChannelSpec>& channels) {
  const uint64_t tables = ByteReader(raw).vlq();
  return std::min<uint64_t>(tables, kMaxEntropyTables) * kRansSlots * sizeof(uint32_t) +
         channels.size() * sizeof(ChannelSpec) + num_contexts(channels);
}

Status parse_entropy_tables(ByteSpan raw, uint64_t base, const SceneHeader& header,
                            const LayerHeader& layer, EntropyTables* out) {
  out->channels = page_channels(header, layer);
  ByteReader in(raw);
  const uint64_t tables = in.vlq();
  if (in.failed()) return corrupt("RANS-1", base, "the entropy tables end early");
  if (tables < 1 || tables > kMaxEntropyTables) {
    return corrupt("RANS-5", base, std::to_string(tables) + " entropy tables");
  }
  // The first tables are of wide integers, whose tokens go further than those of the others.
  const uint64_t wide = in.vlq();
  if (in.failed()) return corrupt("RANS-1", base, "the entropy tables end early");
  if (wide < 1 || wide > tables) {
    return corrupt("RANS-5", base, std::to_string(wide) + " entropy tables of wide integers");
  }
  out->entries.resize(static_cast<size_t>(tables) * kRansSlots);
  for (uint64_t t = 0; t < tables; ++t) {
    L4D_RETURN_IF_ERROR(read_rans_table(in, base, t < wide ? kRansWideTokens : kRansHybridTokens,
                                        out->entries.data() + t * kRansSlots));
  }
  out->maps.clear();
  for (const ChannelSpec& p : out->channels) {
    const uint64_t at = base + in.position();
    const ByteSpan map = in.take(p.contexts);
    if (in.failed()) return corrupt("RANS-1", at, "a context map ends early");
    const bool is_wide = p.kind == ChannelKind::kPosition;
    for (const unsigned char t : map) {
      if (t >= tables || (t < wide) != is_wide) {
        return corrupt(
            "RANS-4", at,
            "a context maps to table " + std::to_string(t) + " of " + std::to_string(tables));
      }
    }
    out->maps.emplace_back(map.begin(), map.end());
  }
  if (in.remaining() != 0) {
    return corrupt("CHNK-7", base + in.position(),
                   std::to_string(in.remaining()) + " bytes left over at the end of a chunk");
  }
  return {};
}

}  // namespace l4d
