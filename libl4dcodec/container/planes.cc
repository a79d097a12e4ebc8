// SPDX-License-Identifier: Apache-2.0
#include "libl4dcodec/container/planes.h"

#include <algorithm>

namespace l4d {
namespace {

void add_component(const ComponentCoding& coding, unsigned c, unsigned dim,
                   std::vector<PlaneSpec>* planes) {
  const auto add = [&](PlaneKind kind, size_t index, unsigned contexts) {
    planes->push_back({kind, static_cast<uint8_t>(c), static_cast<uint8_t>(index),
                       static_cast<uint8_t>(contexts)});
  };
  if (coding.vq()) {
    if (coding.has_depth()) add(PlaneKind::kDepth, 0, 1);
    for (size_t s = 0; s < coding.stages.size(); ++s) add(PlaneKind::kIndex, s, 1);
    for (unsigned k = 0; coding.literals && k < dim; ++k) add(PlaneKind::kLiteral, k, 1);
  }
  if (coding.transform()) {
    add(PlaneKind::kClass, 0, kTransformClasses);
    if (coding.ladder.size() > 1) add(PlaneKind::kRung, 0, kTransformClasses);
    for (unsigned k = 0; k < coding.coefficients(); ++k) {
      add(PlaneKind::kCoefficient, k, kTransformClasses * (k == 0 ? 1 : kMagnitudes));
    }
  }
}

uint64_t num_contexts(const std::vector<PlaneSpec>& planes) {
  uint64_t sum = 0;
  for (const PlaneSpec& p : planes) sum += p.contexts;
  return sum;
}

}  // namespace

std::vector<PlaneSpec> page_planes(const SceneHeader& header, const LayerHeader& layer) {
  std::vector<PlaneSpec> planes;
  planes.push_back({PlaneKind::kPosition, 0, 0, 1});
  if (layer.has_mean_codes()) planes.push_back({PlaneKind::kMeanT, 0, 0, 1});
  if (layer.mean_t_fine) planes.push_back({PlaneKind::kMeanTFine, 0, 0, 1});
  if (header.opacity.coding == ScalarCodingId::kSq) {
    planes.push_back({PlaneKind::kOpacity, 0, 0, 1});
  }
  if (layer.scale_factor.coding == ScalarCodingId::kSq) {
    planes.push_back({PlaneKind::kScaleFactor, 0, 0, 1});
  }
  for (unsigned c = L4D_COMPONENT_SCALE; c < L4D_COMPONENT_COUNT; ++c) {
    add_component(layer.component[c], c, header.component_dim(layer, c), &planes);
  }
  add_component(header.sh, L4D_COMPONENT_SH, header.sh_dim(), &planes);
  return planes;
}

size_t first_detail_plane(const SceneHeader& header, const std::vector<PlaneSpec>& planes) {
  const auto is_detail = [&](const PlaneSpec& p) {
    if (p.kind < PlaneKind::kDepth || p.component != L4D_COMPONENT_SH) return false;
    return header.sh_base == 0 || (p.kind == PlaneKind::kCoefficient && p.index >= header.sh_base);
  };
  return static_cast<size_t>(std::find_if(planes.begin(), planes.end(), is_detail) -
                             planes.begin());
}

bool rans_codable(const SceneHeader& header, const LayerHeader& layer) {
  if (header.position_of(layer) == MeanCodingId::kRaw32 || layer.has_raw_means() ||
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
  return entries.size() * sizeof(uint32_t) + planes.size() * sizeof(PlaneSpec) +
         num_contexts(planes);
}

uint64_t max_entropy_bytes(const std::vector<PlaneSpec>& planes) {
  // Token counts and frequencies take at most two bytes each.
  return 2 + kMaxEntropyTables * 2 * (1 + kRansMaxTokens) + num_contexts(planes);
}

uint64_t entropy_memory(ByteSpan raw, const std::vector<PlaneSpec>& planes) {
  const uint64_t tables = ByteReader(raw).vlq();
  return std::min<uint64_t>(tables, kMaxEntropyTables) * kRansSlots * sizeof(uint32_t) +
         planes.size() * sizeof(PlaneSpec) + num_contexts(planes);
}

Status parse_entropy_tables(ByteSpan raw, uint64_t base, const SceneHeader& header,
                            const LayerHeader& layer, EntropyTables* out) {
  out->planes = page_planes(header, layer);
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
  for (const PlaneSpec& p : out->planes) {
    const uint64_t at = base + in.position();
    const ByteSpan map = in.take(p.contexts);
    if (in.failed()) return corrupt("RANS-1", at, "a context map ends early");
    const bool is_wide = p.kind == PlaneKind::kPosition;
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
