// SPDX-License-Identifier: Apache-2.0
#include "decoder/cuda/layer_tables.h"

#include <algorithm>
#include <cfloat>

#include "libl4dcodec/entropy/rans.h"
#include "libl4dcodec/scene/attributes.h"

namespace l4d::cuda {
namespace {

DeviceScalar device_scalar(const ScalarCoding& coding) {
  return {coding.coding == ScalarCodingId::kSq ? 1u : 0u, coding.offset, coding.step};
}

DeviceComponent device_component(const ComponentCoding& coding, unsigned dim) {
  DeviceComponent out{};
  out.coding = static_cast<uint32_t>(coding.coding);
  out.num_stages = static_cast<uint32_t>(coding.stages.size());
  out.has_depth = coding.has_depth() ? 1 : 0;
  out.num_coefficients = coding.coefficients();
  out.num_eob_indices = static_cast<uint32_t>(coding.eob_table.size());
  out.dim = dim;
  std::copy(coding.eob_table.begin(), coding.eob_table.end(), out.eob_table);
  return out;
}

DeviceLayer device_layer(const SceneHeader& header, const LayerHeader& layer) {
  DeviceLayer out{};
  out.position_fixed = header.position == CoordinateCodingId::kFixed ? 1 : 0;
  out.position_bits = out.position_fixed != 0 ? header.position_bits : 16;
  out.mean_t_coded = layer.has_mean_codes() ? static_cast<uint32_t>(layer.mean_t) : 0;
  out.mean_t_shift = layer.mean_t_shift;
  out.mean_t_zero = layer.mean_t_zero;
  out.mean_t_fine = layer.mean_t_fine ? 1 : 0;
  out.mean_t_step = layer.mean_t_step;
  out.flat = layer.flat() ? 1 : 0;
  for (size_t k = 0; k < kWindowColumns; ++k) {
    out.window_columns |= layer.window_width(k) > 0 ? 1u << k : 0;
  }
  out.window_length = layer.window_length;
  out.permanent = layer.permanent ? 1 : 0;
  out.stereographic = SceneHeader::stereographic_rotor(layer) ? 1 : 0;
  std::copy_n(header.position_center, 3, out.position_center);
  out.position_scale = header.position_scale;
  out.log_scale_t = clamp_log_scale(layer.log_scale_t);
  out.min_opacity = header.opacity_logit ? -FLT_MAX : 0.0f;
  out.most_opacity = header.opacity_logit ? FLT_MAX : 1.0f;
  out.opacity = device_scalar(header.opacity);
  out.scale_factor = device_scalar(layer.scale_factor);
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    out.component[c] = device_component(header.component(layer, c), header.component_dim(layer, c));
  }
  return out;
}

// Values of channel `spec` are below this; a limit of 2^16 and more is none.
uint32_t channel_limit(const SceneHeader& header, const LayerHeader& layer,
                       const ChannelSpec& spec) {
  const ComponentCoding& coding = header.component(layer, spec.component);
  switch (spec.kind) {
    case ChannelKind::kMeanT:
      return 1u << layer.mean_t_width();
    case ChannelKind::kWindow:
      return 1u << layer.window_width(spec.index);
    case ChannelKind::kOpacity:
      return 1u << header.opacity.bits;
    case ChannelKind::kScaleFactor:
      return 1u << layer.scale_factor.bits;
    case ChannelKind::kDepth:
      return coding.escapes ? kEscapeDepth + 1u : kEscapeDepth;
    case ChannelKind::kIndex:
      return coding.stages[spec.index].num_entries;
    case ChannelKind::kEobIndex:
      return static_cast<uint32_t>(coding.eob_table.size() + 1);
    default:
      return 0;
  }
}

// EOB index or depth above which a Gaussian has to be to take part in the channel after `spec`; 0 =
// all that took part in this one.
uint8_t min_after(const ComponentCoding& coding, const ChannelSpec& spec) {
  if (spec.kind == ChannelKind::kIndex) {
    const bool is_last = spec.index + 1u == coding.stages.size();
    return coding.has_depth() && !is_last ? static_cast<uint8_t>(spec.index + 1) : uint8_t{0};
  }
  if (spec.kind != ChannelKind::kCoefficient || spec.index + 1u == coding.coefficients()) return 0;
  for (size_t s = 0; s < coding.eob_table.size(); ++s) {
    if (coding.eob_table[s] == spec.index + 1u) return static_cast<uint8_t>(s + 1);
  }
  return 0;
}

}  // namespace

Status copy_to_device(const void* from, size_t bytes, void* to) {
  L4D_RETURN_IF_CUDA_ERROR(cudaMemcpy(to, from, bytes, cudaMemcpyHostToDevice));
  L4D_RETURN_IF_CUDA_ERROR(cudaStreamSynchronize(nullptr));
  return {};
}

void pack_rans_table(const uint32_t* entries, uint64_t* records, uint8_t* tokens) {
  const auto frequency = [&](size_t slot) { return uint64_t{entries[slot] >> 20} + 1; };
  const auto bias = [&](size_t slot) { return uint64_t{entries[slot] >> 8} & (kRansSlots - 1); };
  std::fill_n(tokens, kTableRanks, uint8_t{0});
  uint64_t rank = 0;
  for (size_t r = 0; r < kTableRecords; ++r) {
    const size_t first = r * kRecordSlots, last = first + kRecordSlots - 1;
    uint64_t starts = 0;
    for (size_t slot = first; slot <= last; ++slot) {
      if (bias(slot) != 0) continue;
      if (slot > 0) ++rank;
      if (slot > first) starts |= uint64_t{1} << (slot - first);
      tokens[rank] = static_cast<uint8_t>(entries[slot] & 0xff);
    }
    const uint64_t rank_of_first = rank - static_cast<uint64_t>(__builtin_popcountll(starts));
    const uint64_t end = kRecordSlots - 1 - bias(last) + frequency(last);
    records[r] = starts | bias(first) << 32 | end << 44 | rank_of_first << 57;
  }
}

// What lanes without a symbol take: all slots are of one token, so that no state changes.
void idle_rans_table(uint64_t* records, uint8_t* tokens) {
  std::vector<uint32_t> entries(kRansSlots);
  const uint32_t all = kRansSlots;
  expand_rans_table(&all, 1, entries.data());
  pack_rans_table(entries.data(), records, tokens);
}

// Eight tables for each step exponent.
void append_map(const std::vector<uint8_t>& map, uint8_t idle, std::vector<uint8_t>* maps) {
  const size_t first = maps->size();
  const size_t of_exponent = map.size() / kTransformStepExponents;
  maps->resize(first + kMapBytes, map[0]);
  for (size_t i = 0; i < map.size(); ++i) {
    (*maps)[first + 8 * (i / of_exponent) + i % of_exponent] = map[i];
  }
  for (size_t c = 0; c < kTransformStepExponents; ++c) (*maps)[first + 8 * c + kIdleContext] = idle;
}

std::vector<ChannelProgram> channel_programs(const SceneHeader& header, const LayerHeader& layer,
                                             const EntropyTables& tables,
                                             std::vector<uint8_t>* maps) {
  std::vector<ChannelProgram> out;
  uint8_t with_step_exponents = 0xff;
  for (size_t p = 0; p < tables.channels.size(); ++p) {
    const ChannelSpec& spec = tables.channels[p];
    const ComponentCoding& coding = header.component(layer, spec.component);
    const std::vector<uint8_t>& map = tables.maps[p];
    ChannelProgram channel{};
    channel.kind = static_cast<uint8_t>(spec.kind);
    channel.component = spec.component;
    channel.index = spec.index;
    channel.table = map[0];
    channel.by_depth = spec.kind == ChannelKind::kIndex && coding.has_depth() ? 1 : 0;
    channel.keep_above = min_after(coding, spec);
    channel.context_of = with_step_exponents;
    channel.limit = channel_limit(header, layer, spec);
    if (spec.kind == ChannelKind::kStepExponent) with_step_exponents = spec.component;
    if (map.size() > 1) {
      channel.map = static_cast<uint32_t>(maps->size());
      append_map(map, static_cast<uint8_t>(tables.entries.size() / kRansSlots), maps);
    }
    out.push_back(channel);
  }
  return out;
}

LayerTables::LayerTables(SceneFile& file) : file_(file) {
  const SceneHeader& header = file.header();
  for (const LayerHeader& layer : header.layers) layers_.push_back(device_layer(header, layer));
  loaded_.resize(layers_.size());
}

Status LayerTables::upload(const void* data, size_t bytes, const void** out) {
  DeviceMemory memory;
  L4D_RETURN_IF_ERROR(memory.reserve(std::max<size_t>(bytes, 1)));
  L4D_RETURN_IF_ERROR(copy_to_device(data, bytes, memory.data()));
  *out = memory.data();
  memory_.push_back(std::move(memory));
  changed_ = true;
  return {};
}

Status LayerTables::load_entropy(uint32_t layer) {
  const EntropyTables* tables = nullptr;
  L4D_RETURN_IF_ERROR(file_.codebooks().entropy_tables(layer, &tables));
  const size_t idle = tables->entries.size() / kRansSlots;
  const size_t count = idle + 1;
  std::vector<uint64_t> records(count * kTableRecords);
  std::vector<uint8_t> tokens(count * kTableRanks), maps;
  idle_rans_table(records.data() + idle * kTableRecords, tokens.data() + idle * kTableRanks);
  for (size_t t = 0; t < idle; ++t) {
    pack_rans_table(tables->entries.data() + t * kRansSlots, records.data() + t * kTableRecords,
                    tokens.data() + t * kTableRanks);
  }
  const SceneHeader& header = file_.header();
  const std::vector<ChannelProgram> channels =
      channel_programs(header, header.layers[layer], *tables, &maps);
  DeviceLayer& to = layers_[layer];
  const void* at[4] = {};
  L4D_RETURN_IF_ERROR(upload(records.data(), records.size() * sizeof(uint64_t), &at[0]));
  L4D_RETURN_IF_ERROR(upload(tokens.data(), tokens.size(), &at[1]));
  L4D_RETURN_IF_ERROR(upload(maps.data(), maps.size(), &at[2]));
  L4D_RETURN_IF_ERROR(upload(channels.data(), channels.size() * sizeof(ChannelProgram), &at[3]));
  to.records = static_cast<const uint64_t*>(at[0]);
  to.tokens = static_cast<const uint8_t*>(at[1]);
  to.maps = static_cast<const uint8_t*>(at[2]);
  to.channels = static_cast<const ChannelProgram*>(at[3]);
  to.num_tables = static_cast<uint32_t>(count);
  to.map_bytes = static_cast<uint32_t>(maps.size());
  to.num_channels = static_cast<uint32_t>(channels.size());
  return {};
}

Status LayerTables::load_component(uint32_t layer, unsigned c) {
  const SceneHeader& header = file_.header();
  const ComponentCoding& coding = header.component(header.layers[layer], c);
  DeviceComponent& to = layers_[layer].component[c];
  // SH is the same for all layers.
  for (size_t l = 0; c == L4D_COMPONENT_SH && l < layers_.size(); ++l) {
    if (!loaded_[l][c]) continue;
    to = layers_[l].component[c];
    changed_ = true;
    return {};
  }
  for (unsigned s = 0; s < coding.num_codebooks(); ++s) {
    const CodebookData* codebook = nullptr;
    L4D_RETURN_IF_ERROR(file_.codebooks().codebook(layer, c, s, &codebook));
    const void* at = nullptr;
    L4D_RETURN_IF_ERROR(upload(codebook->entries.data(), codebook->memory_bytes(), &at));
    to.codebook[s] = static_cast<const float*>(at);
  }
  if (!coding.transform()) return {};
  const void* at = nullptr;
  if (c == L4D_COMPONENT_SH) {
    const CodebookData* basis = nullptr;
    L4D_RETURN_IF_ERROR(file_.codebooks().codebook(layer, c, 0, &basis));
    const IntegerBasis& integer = basis->integer;
    L4D_RETURN_IF_ERROR(
        upload(integer.vectors.data(), integer.vectors.size() * sizeof(int16_t), &at));
    to.integer_basis = static_cast<const int16_t*>(at);
    to.integer_scale = integer.scale;
    return {};
  }
  L4D_RETURN_IF_ERROR(upload(coding.steps.data(), coding.steps.size() * sizeof(float), &at));
  to.steps = static_cast<const float*>(at);
  return {};
}

Status LayerTables::load_codebooks(uint32_t layer, unsigned c) {
  const SceneHeader& header = file_.header();
  const ComponentCoding& coding = header.component(header.layers[layer], c);
  if (loaded_[layer][c] || coding.num_codebooks() == 0) return {};
  L4D_RETURN_IF_ERROR(load_component(layer, c));
  loaded_[layer][c] = true;
  return {};
}

Status LayerTables::load(uint32_t layer, const Wants& wants) {
  for (unsigned c = 0; c < L4D_COMPONENT_COUNT; ++c) {
    if (wants[c]) L4D_RETURN_IF_ERROR(load_codebooks(layer, c));
  }
  if (loaded_[layer][L4D_COMPONENT_COUNT]) return {};
  L4D_RETURN_IF_ERROR(load_entropy(layer));
  loaded_[layer][L4D_COMPONENT_COUNT] = true;
  return {};
}

Status LayerTables::update() {
  if (!changed_) return {};
  const size_t bytes = layers_.size() * sizeof(DeviceLayer);
  L4D_RETURN_IF_ERROR(device_layers_.reserve(bytes));
  L4D_RETURN_IF_ERROR(copy_to_device(layers_.data(), bytes, device_layers_.data()));
  changed_ = false;
  return {};
}

}  // namespace l4d::cuda
